"""Choose the temperature orders of a model by AIC, with the terms that they include.

AIC = χ² + 2 p. If the terms d are removed from a fit with estimate θ and covariance C, χ² increases
by θ_d' C_dd⁻¹ θ_d. This is exact for a model that is linear in its coefficients, so one fit is
enough to compare all orders.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from inercal.basics.arrays import Array
from inercal.basics.errors import InputError, NotObserved
from inercal.basics.keys import CoefficientName
from inercal.estimation import Estimate
from inercal.estimation.scores import SIGNIFICANCE_LEVEL, chi2_tail_probability
from inercal.physics.quantities import KINDS, Measures
from inercal.physics.sensors import Sensor
from inercal.runfile.environment_section import MAX_ORDERS, order_terms, orders_of_terms

Orders = tuple[int, int, int]
_SURE = 1e-3  # probability that noise asks for a higher order


@dataclass(frozen=True)
class OrderTest:
    """A set of orders for a kind of axes, with the AIC relative to the smallest AIC."""

    kind: str
    orders: Orders
    excess: float
    ratio: float  # χ²/ν


def with_orders(sensor: Sensor, orders: Mapping[Measures, Sequence[int]]) -> Sensor:
    """Return the sensor with only the terms that belong to some orders."""
    ordered = {kind: set(order_terms(kind, MAX_ORDERS)) for kind in orders}
    wanted = {kind: set(order_terms(kind, most)) for kind, most in orders.items()}

    def kept(name: str) -> bool:
        axis, term = CoefficientName(name).parts
        kind = sensor.measures[axis]
        return kind not in orders or term not in ordered[kind] or term in wanted[kind]

    return replace(sensor, coefficients=tuple(n for n in sensor.coefficients if kept(n)))


def used_orders(sensor: Sensor) -> dict[Measures, Orders]:
    """Return the highest orders of bias, scale factor and misalignment by kind of axes."""
    result: dict[Measures, Orders] = {}
    for kind in KINDS:
        if all(axis.measures != kind for axis in sensor.axes):
            continue
        own = sensor.select_axes(kind).coefficients
        result[kind] = orders_of_terms(kind, {CoefficientName(name).term for name in own})
    return result


def choose_orders(estimate: Estimate, sensor: Sensor) -> tuple[Sensor, tuple[OrderTest, ...]]:
    """Return the sensor with the terms of smallest AIC for each kind of axes, and all tests.

    Parameters
    ----------
    estimate : Estimate
        Estimate from one trial, with the highest orders.
    sensor : Sensor
        Sensor whose coefficients are among those of the estimate.
    """
    names, chosen, tests = sensor.coefficients, sensor, list[OrderTest]()
    for kind, most in used_orders(sensor).items():
        compared: list[tuple[float, Orders, float]] = []
        for orders in product(*(range(n + 1) for n in most)):
            kept = with_orders(sensor, {kind: orders}).coefficients
            dropped = [estimate.names.index(name) for name in names if name not in kept]
            theta = estimate.value[dropped]
            lost = float(theta @ _solve(estimate, dropped, theta))
            ratio = (float(estimate.chi2) + lost) / max(estimate.dof + len(dropped), 1)
            compared.append((lost - 2 * len(dropped), (orders[0], orders[1], orders[2]), ratio))
        least = min(compared)
        tests += [OrderTest(kind, orders, aic - least[0], ratio) for aic, orders, ratio in compared]
        chosen = with_orders(chosen, {kind: least[1]})
    return chosen, tuple(tests)


def is_untested(sensor: Sensor, levels: int) -> bool:
    """Return whether every polynomial in temperature passes through all soaks.

    Misalignments do not count, because most of them hardly change with temperature.
    """
    orders = [n for most in used_orders(sensor).values() for n in most[:2] if n]
    return bool(orders) and min(orders) >= levels - 1


def last_terms(
    sensor: Sensor, levels: int, final: Estimate, solve: Callable[[Sensor], Estimate]
) -> tuple[str, ...]:
    """Return the terms that explain the residuals, but leave no soak to test them."""
    orders = used_orders(sensor)
    full = {kind: [(levels - 1) * (n > 0) for n in most[:2]] for kind, most in orders.items()}
    further = [
        f"{axis.name}.{term}"
        for axis in sensor.axes
        for term in order_terms(axis.measures, (*full[axis.measures], 0))
        if f"{axis.name}.{term}" not in sensor.coefficients
    ]
    raised = sensor.with_coefficients(*sensor.coefficients, *further)
    one_below = not is_untested(sensor, levels) and is_untested(sensor, levels - 1)
    if not (one_below and final.dof and is_untested(raised, levels)):
        return ()
    try:
        other = solve(raised)
    except (InputError, NotObserved):
        return ()
    drop, lost = max(float(final.chi2 - other.chi2), 0.0), final.dof - other.dof
    left = chi2_tail_probability(float(other.chi2), other.dof, other.noise_dof)
    if chi2_tail_probability(drop, lost, final.noise_dof) > _SURE or left < SIGNIFICANCE_LEVEL:
        return ()
    return tuple(dict.fromkeys(CoefficientName(name).term for name in further))


def _solve(estimate: Estimate, at: Sequence[int], theta: Array) -> Array:
    """Return C⁻¹ θ for some parameters, whose units may differ by orders of magnitude."""
    covariance = estimate.covariance[np.ix_(at, at)]
    sd = np.sqrt(np.diag(covariance))
    return np.linalg.solve(covariance / sd[:, None] / sd, theta / sd) / sd
