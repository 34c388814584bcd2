"""Fit a run over several temperatures: include the errors of each soak, and choose the orders.

1. A first fit with the highest orders gives the slopes ∂y/∂T, which convert an error of a soak's
   temperature into an error of the readings (`inercal.recordings.soaks`).
2. The orders of bias, scale factor and misalignment with the smallest AIC are chosen
   (`inercal.pipeline.temperature_orders`).
3. Each soak is omitted once. The rows of a soak increase χ² by χ²(all) − χ²(without this soak).
   This difference is the squared prediction error of the n readings, in units of its uncertainty.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from inercal.basics.arrays import Array
from inercal.basics.errors import InputError, NotObserved
from inercal.basics.units import ZERO_CELSIUS, format_quantity
from inercal.calibration.next_steps import SOAK_OR_ORDER, WRONG_SOAK
from inercal.calibration.suspect_text import chi2_text
from inercal.calibration.verdict import UNSEEN
from inercal.estimation import Estimate
from inercal.estimation.scores import SIGNIFICANCE_LEVEL, chi2_tail_probability
from inercal.methods import Fit, Remarks
from inercal.physics.quantities import QUANTITIES, Measures
from inercal.physics.section_settings import key_error
from inercal.physics.sensors import Axis, Sensor
from inercal.physics.sensors.coefficient_tables import BIAS_UNITS
from inercal.pipeline.temperature_orders import (
    Orders,
    OrderTest,
    choose_orders,
    is_untested,
    last_terms,
    used_orders,
    with_orders,
)
from inercal.recordings import Finding, Observations, soaks
from inercal.recordings.data import EstimatorInput
from inercal.recordings.environment import Environment
from inercal.recordings.soaks import SoakLoop
from inercal.runfile import Run
from inercal.runfile.environment_section import MAX_ORDERS, ORDERED

LEAST_SPAN = 10.0  # K
LARGEST_PREDICTION_RATIO = 1.3  # rms prediction error divided by its standard uncertainty
_UNRELIABLE_RATIO = 2.0  # the same ratio, above which a result is not to be relied on
_AS_LIKELY = 10.0  # soaks whose χ² differ by less cannot be told apart
_TOO_LOW = 100.0  # χ²/ν above which an order is called too low
_NO_SOAKS = np.zeros(0)


@dataclass(frozen=True)
class SoakLeftOut:
    """The prediction of the rows of a soak from the other soaks.

    Parameters
    ----------
    temperature : float
        Temperature of the soak, K.
    ratio : float
        Prediction error divided by its standard uncertainty, as rms over the readings.
    components : int
        Number of readings.
    inside : bool
        Whether there are both colder and warmer soaks.
    rest : float
        Probability of a larger χ² of the other soaks.
    """

    temperature: float
    ratio: float
    components: int
    inside: bool
    rest: float = 1.0

    @property
    def chi2(self) -> float:
        """The part of χ² that the soak causes."""
        return self.components * self.ratio**2


@dataclass(frozen=True, eq=False)
class TemperatureFit:
    """How the temperatures of a run were treated.

    Parameters
    ----------
    soaks : (s,) array
        Temperatures of the soaks in order, K; empty for a ramp.
    orders : mapping of "f", "w" or "m" to Orders
        Orders that were used; empty if no orders were stated or tested.
    tests : tuple of OrderTest
        All orders that were compared.
    left_out : tuple of SoakLeftOut
    ratio : float
        χ²/ν of the fit.
    loops : tuple of SoakLoop
        Differences between soaks whose temperature was reached from below and from above.
    axes : tuple of m Axis
        Axes to which the loops refer.
    drift : float
        Largest change of the recorded temperature within a section, K; NaN for tables of means.
    untested : bool
        Whether every polynomial passes through all soaks.
    higher : tuple of str
        Terms that the data ask for, with which every polynomial would pass through all soaks.
    double : float or None
        Temperature of a soak with twice as many rows as the median of the soaks, K.
    """

    soaks: NDArray[np.float64]
    orders: Mapping[Measures, Orders]
    tests: tuple[OrderTest, ...] = ()
    left_out: tuple[SoakLeftOut, ...] = ()
    ratio: float = 1.0
    loops: tuple[SoakLoop, ...] = ()
    axes: tuple[Axis, ...] = ()
    drift: float = np.nan
    untested: bool = False
    higher: tuple[str, ...] = ()
    double: float | None = None

    @property
    def findings(self) -> tuple[Finding, ...]:
        """Warnings about orders that are too low, and soaks that the other soaks do not predict."""
        too_large = bool(self.orders) and self.ratio > _TOO_LOW
        exhausted = bool(self.tests) or MAX_ORDERS in self.orders.values()
        if self.double is not None and too_large and exhausted:
            text = (
                f"the soak at {self.double - ZERO_CELSIUS:.1f} °C has at least twice as many rows "
                "as the others, so it may be two soaks; check the temperature of each soak"
            )
            cause = "the thermometer was stuck or lost its sign, so two soaks look like one"
            return (Finding("warning", WRONG_SOAK, text, cause=cause),)
        if self.untested:
            text = (
                "no soak is left to test the others, because the polynomials in temperature pass "
                "through all of them; check the temperature of each soak, and add a soak"
            )
            unseen = Finding("note", UNSEEN, "an error of the temperature of one soak")
            return (Finding("warning", "temperature_order", text), unseen)
        if self.higher:
            text = (
                f"a wrong temperature of one soak and {' or '.join(self.higher)} explain the data "
                "equally well, and no soak would be left to test these terms; check the "
                "temperature of each soak, or add a soak"
            )
            return (Finding("warning", SOAK_OR_ORDER, text),)
        if too_large:
            size = f"χ²/ν is {chi2_text(self.ratio)}"
            text = (
                f"the orders in temperature are too low: {size}; state higher ones, or [method] "
                'temperature_order = "auto"'
            )
            if exhausted:
                text = (
                    f"no possible order in temperature explains the data: {size}; check the "
                    "temperature of each soak, and the lag of the thermometer"
                )
            return (Finding("warning", "temperature_order", text),)
        known = [one for one in self.left_out if one.components]
        wrong = [one for one in known if one.ratio > _UNRELIABLE_RATIO * _bound(one)]
        if wrong and max(one.rest for one in wrong) >= SIGNIFICANCE_LEVEL:
            return (_wrong_soak(wrong),)
        inner = [one for one in known if one.inside]
        bad = [one for one in inner if one.ratio > LARGEST_PREDICTION_RATIO * _bound(one)]
        if not bad:
            return ()
        worst = max(bad, key=lambda one: one.ratio)
        text = (
            f"the soak at {worst.temperature - ZERO_CELSIUS:.1f} °C is {worst.ratio:.2f} u (rms) "
            "from what the others predict; more than "
            f"{LARGEST_PREDICTION_RATIO * _bound(worst):.2f} u means that the order or the noise "
            "is wrong"
        )
        return (Finding("refused" if wrong else "warning", "prediction", text),)

    @property
    def notes(self) -> tuple[str, ...]:
        """Text lines on orders and prediction errors."""
        lines: list[str] = []
        for kind, orders in self.orders.items():
            by = "by AIC" if any(one.kind == kind for one in self.tests) else "as stated"
            by += ", linear terms only" if kind == "m" else ""
            lines.append(
                f"temperature orders of {QUANTITIES[kind].sensors}, {by}: bias {orders[0]}, "
                "scale factor "
                f"{orders[1]}, misalignment {orders[2]}"
            )
        if self.loops:
            lines.append(self._largest_loop())
        if np.isfinite(self.drift):
            lines.append(f"within a section the temperature changes by at most {self.drift:.2g} K")
        ratios = [one.ratio for one in self.left_out if one.components]
        if ratios:
            lines.append(
                "rms prediction error of a soak that is left out, in units of its uncertainty: at "
                f"most {max(ratios):.2f}"
            )
        return tuple(lines)

    def _largest_loop(self) -> str:
        """Describe the largest loop of each kind of axes."""
        texts: list[str] = []
        for kind, (_, unit) in BIAS_UNITS.items():
            own = [k for k, axis in enumerate(self.axes) if axis.measures == kind]
            if not own:
                continue
            at, k = max(
                ((one, k) for one in self.loops for k in own),
                key=lambda pair: abs(float(pair[0].half[pair[1]])),
            )
            celsius = at.temperature - ZERO_CELSIUS
            half = format_quantity(abs(float(at.half[k])), 0.0, unit, 3)
            texts.append(f"{half} of {self.axes[k].name} at {celsius:.1f} °C")
        return (
            f"half the hysteresis loop between rising and falling temperature is at most "
            f"{', '.join(texts)}; it is not corrected"
        )


def _wrong_soak(wrong: Sequence[SoakLeftOut]) -> Finding:
    """Return the finding about a soak without which the other soaks agree with the model."""
    worst = max(wrong, key=lambda one: one.chi2)
    alike = [one for one in wrong if one.chi2 > worst.chi2 - _AS_LIKELY]
    named = " or ".join(f"{one.temperature - ZERO_CELSIUS:.1f} °C" for one in alike)
    text = (
        f"the soak at {named} does not fit the others: the rms error of their prediction is "
        f"{worst.ratio:.2f} times its uncertainty; check its temperature, or repeat this soak"
    )
    return Finding("refused", WRONG_SOAK, text)


def _double_soak(observations: Observations) -> float | None:
    """Return the temperature of the soak with twice as many rows as the median soak, K."""
    rows = np.bincount(soaks.soak_numbers(observations))
    double = rows.max() >= 2 * np.median(rows)
    return float(soaks.soak_temperatures(observations)[rows.argmax()]) if double else None


def _bound(one: SoakLeftOut) -> float:
    """Return the largest ratio that chance may cause: two standard deviations of χ²/n."""
    return float(np.sqrt(1 + 2 * np.sqrt(2 / one.components)))


def fit_over_temperatures(
    run: Run, inputs: EstimatorInput
) -> tuple[Run, EstimatorInput, TemperatureFit | None]:
    """Choose the orders; return run and observations for the final estimate, and the tests.

    If the run file states neither [environment] nor [method] temperature_order, run and
    observations are unchanged, and the tests are None.

    Parameters
    ----------
    run : Run
        Run that includes the terms of the highest orders, if orders are to be tested.
    inputs : EstimatorInput

    Raises
    ------
    InputError
        If the temperatures do not determine the terms of these orders.
    """
    environment, stated = run.environment, run.temperature_order
    if environment is None and stated is None:
        return run, inputs, None
    environment = environment or Environment("soaks")
    observations = inputs.observations
    known = _are_known(run)
    _require_temperatures(run, observations, least=0.0 if known else LEAST_SPAN)
    if run.method.follows_rest:
        return _ordered_ramp(run, inputs)
    weighs = run.method.weighs_common_errors and environment.kind == "soaks"
    if stated == "auto" and not weighs:
        raise key_error(
            "[method] temperature_order",
            f"method {run.method.name} cannot test orders for {environment.kind}: state them, such "
            "as [1, 1, 0]",
        )
    if environment.kind == "ramp" or (observations.track is not None and run.environment is None):
        return run, inputs, TemperatureFit(_NO_SOAKS, _orders_of(run))
    temperatures = soaks.soak_temperatures(observations)
    levels = soaks.distinct_levels(temperatures)
    run = _within_levels(run, levels)
    known = known and float(np.ptp(temperatures)) < LEAST_SPAN
    if not weighs:
        untested = not known and is_untested(run.sensor, levels)
        return run, inputs, TemperatureFit(temperatures, _orders_of(run), untested=untested)
    solver = _Solver(run, inputs)
    first = solver.solve(observations, run.sensor)
    c = first.value[..., : len(run.sensor.coefficients)]
    rates = _row_rates(inputs)
    observations = soaks.with_soak_errors(observations, run.sensor, c, environment, rates)
    if known:  # the soaks need not determine the orders
        return run, replace(inputs, observations=observations), TemperatureFit(temperatures, {})
    tests: tuple[OrderTest, ...] = ()
    if stated == "auto":
        sensor, tests = choose_orders(solver.solve(observations, run.sensor), run.sensor)
        run = replace(run, sensor=sensor)
    final = solver.solve(observations, run.sensor)
    found = TemperatureFit(
        temperatures,
        _orders_of(run),
        tests,
        solver.leave_out(observations, run.sensor, final),
        float(final.chi2) / max(final.dof, 1),
        soaks.soak_loops(observations, final.residual),
        run.sensor.axes,
        np.nan if rates is None else float(np.abs(rates * observations.duration).max()),
        is_untested(run.sensor, levels),
        last_terms(run.sensor, levels, final, partial(solver.solve, observations)),
        _double_soak(observations),
    )
    return run, replace(inputs, observations=observations), found


def with_magnetometers(
    run: Run, fit: Fit[Any, Any], thermal: TemperatureFit | None
) -> tuple[Run, Estimate, Remarks, TemperatureFit | None]:
    """Add the magnetometers to a fit, with the orders in temperature that the run states or tests.

    Raises
    ------
    InputError or NotObserved
        See `AddMagnetometers`.
    """
    field, add = run.magnetometer, run.method.add_magnetometers
    if field is None or add is None:
        return run, fit.estimate, Remarks(), thermal
    estimate, remarks = add(fit, field)
    if thermal is None or run.temperature_order is None:
        return run, estimate, remarks, thermal
    tests: tuple[OrderTest, ...] = ()
    if run.temperature_order == "auto":
        chosen, tests = choose_orders(estimate, field)
        if chosen.coefficients != field.coefficients:
            field, (estimate, remarks) = chosen, add(fit, chosen)
    orders = {**thermal.orders, **used_orders(field)}
    thermal = replace(thermal, orders=orders, tests=(*thermal.tests, *tests))
    notes = tuple(dict.fromkeys((*estimate.notes, *thermal.notes)))
    return replace(run, magnetometer=field), replace(estimate, notes=notes), remarks, thermal


def _orders_of(run: Run) -> dict[Measures, Orders]:
    """Return the orders in use, by kind of axes; empty if no orders were stated or tested."""
    return {} if run.temperature_order is None else used_orders(run.sensor)


def with_common_errors(run: Run, inputs: EstimatorInput, estimate: Estimate) -> Estimate:
    """Add common errors from [environment] that the estimate does not yet include.

    Parameters
    ----------
    run : Run
    inputs : EstimatorInput
        Observations that were used for the estimate.
    estimate : Estimate
    """
    environment = run.environment
    if environment is None or run.method.follows_rest:
        return estimate
    if environment.kind == "ramp":
        return soaks.with_temperature_shift(estimate, run.sensor, environment.temperature_sd)
    if run.method.weighs_common_errors:
        return estimate
    added, solver = np.zeros(estimate.covariance.shape), _Solver(run, inputs)
    for changed in soaks.changed_by_soak_errors(inputs.observations, run.sensor, environment):
        moved = solver.solve(changed, run.sensor).value - estimate.value
        added += np.outer(moved, moved)
    return soaks.with_added_covariance(estimate, added)


def _ordered_ramp(run: Run, inputs: EstimatorInput) -> tuple[Run, EstimatorInput, TemperatureFit]:
    """Return the run of a ramp with the orders of smallest AIC, if orders are tested."""
    tests: tuple[OrderTest, ...] = ()
    if run.temperature_order == "auto":
        fit = _Solver(run, inputs).solve(inputs.observations, run.sensor)
        sensor, tests = choose_orders(fit, run.sensor)
        run = replace(run, sensor=sensor)
    return run, inputs, TemperatureFit(_NO_SOAKS, _orders_of(run), tests)


def _row_rates(inputs: EstimatorInput) -> Array | None:
    """Return the slope of the temperature in each section, (r,), K/s; None for tables of means.

    A slope is computed only from the samples of its section, because the next section may belong to
    another soak.
    """
    recording = inputs.recording
    if recording is None or recording.temperature is None or not inputs.marks:
        return None
    by_label: dict[str, float] = {}
    for mark in inputs.marks:
        time = recording.time[mark.start : mark.stop]
        time = time - time.mean()
        square = float(time @ time)
        product = float(time @ recording.temperature[mark.start : mark.stop])
        by_label[mark.label] = product / square if square else 0.0
    return np.array([by_label[label] for label in inputs.observations.labels])


def _are_known(run: Run) -> bool:
    """Return whether the run states a prior of each temperature coefficient, and no orders."""
    stated = {name for prior in run.priors for name in prior.names}
    wanted = {name for name in run.whole_sensor.coefficients if "_dT" in name}
    return run.temperature_order is None and bool(wanted) and wanted <= stated


def _require_temperatures(run: Run, observations: Observations, least: float) -> None:
    """Raise an error if temperatures are missing, or span less than `least`, K."""
    kelvin = (observations.track or observations).temperature
    names = ", ".join(n for n in run.whole_sensor.coefficients if "_dT" in n)
    if kelvin is None:
        raise key_error(
            "[data] temperature",
            f"it is missing, but {names} need the sensor's temperature; name its column",
        )
    span = float(np.ptp(kelvin))
    if span < least:
        shown = np.floor(100 * span) / 100  # never rounded up to the limit
        low, high = float(kelvin.min()) - ZERO_CELSIUS, float(kelvin.max()) - ZERO_CELSIUS
        raise key_error(
            "[data] temperature",
            f"the temperatures are {low:.2f} to {high:.2f} °C, a span of {shown:.2f} K; "
            f"temperature coefficients need {least:g} K or more, or a prior of each of them",
        )


def _within_levels(run: Run, levels: int) -> Run:
    """Limit terms to the orders that the number of temperatures determines, or raise an error."""
    stated = run.temperature_order
    if isinstance(stated, tuple):
        for quantity, order in zip(ORDERED, stated, strict=True):
            if order >= levels:
                raise key_error(
                    "[method] temperature_order",
                    f"order {order} of the {quantity} needs {order + 1} soaks at different "
                    f"temperatures, but there are {levels} (more than {soaks.SOAK_SPREAD:g} K "
                    "apart)",
                )
    if stated != "auto":
        return run
    most = [min(order, levels - 1) for order in MAX_ORDERS]
    return replace(run, sensor=with_orders(run.sensor, {"f": most, "w": most}))


@dataclass(frozen=True, eq=False)
class _Solver:
    """The estimator of a run, for repeated fits."""

    run: Run
    inputs: EstimatorInput

    def solve(self, observations: Observations, sensor: Sensor) -> Estimate:
        inputs, bench = self.inputs, self.inputs.bench or self.run.bench
        solver_sensor, plan = inputs.sensor_of_samples(sensor), inputs.plan
        if len(observations.labels) < len(inputs.observations.labels):
            by_label = {step.label: step for step in plan}
            plan = tuple(by_label[label] for label in observations.labels)
        return self.run.solver()(observations, solver_sensor, bench, plan, self.run.priors)

    def leave_out(
        self, observations: Observations, sensor: Sensor, whole: Estimate
    ) -> tuple[SoakLeftOut, ...]:
        """Omit each soak that is not essential, and return the prediction errors."""
        number = soaks.soak_numbers(observations)
        temperatures = soaks.soak_temperatures(observations)
        if not whole.dof:
            return ()
        chi2 = float(whole.chi2)
        result: list[SoakLeftOut] = []
        for k, kelvin in enumerate(temperatures.tolist()):
            kept = np.flatnonzero(number != k).tolist()
            components = (len(number) - len(kept)) * len(sensor.axes)
            try:
                rest = self.solve(observations.rows(kept), sensor)
            except (InputError, NotObserved):
                continue
            squares = max(chi2 - float(rest.chi2), 0.0)
            others = np.delete(temperatures, k)
            inside = bool(others.min() < kelvin < others.max())
            ratio = float(np.sqrt(squares / components))
            tail = chi2_tail_probability(float(rest.chi2), rest.dof, rest.noise_dof)
            result.append(SoakLeftOut(kelvin, ratio, components, inside, tail))
        return tuple(result)
