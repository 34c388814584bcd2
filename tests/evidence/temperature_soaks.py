"""Soaks of six positions over many triads: errors, coverage and predictions.

`python -m tests.evidence.temperature_soaks` works out the tables of docs/evidence/temperature.md.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from tests.accuracy import soaks

from inercal.basics.units import Measured
from inercal.benches import Hand
from inercal.estimation import Estimate
from inercal.methods import METHODS
from inercal.methods.hand_likelihood import ml
from inercal.physics.plan import Hold
from inercal.physics.sensors import Sensor, imu
from inercal.pipeline.temperature_orders import choose_orders
from inercal.recordings import Observations
from inercal.recordings.environment import Environment
from inercal.recordings.soaks import with_soak_errors
from inercal.runfile.environment_section import order_terms

Array = NDArray[np.float64]
ENVIRONMENT = Environment("soaks", soaks.TEMPERATURE_SD, soaks.REPEATABILITY)
BENCH = Hand(Measured(*soaks.GRAVITY), None, tilt=soaks.FIXTURE, placement=soaks.PLACEMENT)
TRUE_ORDERS = (3, 2, 1)


class Fits(NamedTuple):
    """Triads, the sensor's model and the estimates."""

    made: soaks.SoakedTriads
    sensor: Sensor
    estimate: Estimate


class TermRow(NamedTuple):
    """Errors of one kind of coefficient over all axes: rms, SI, and share within 2 u."""

    term: str
    rms: float
    coverage: float


class SoakTable(NamedTuple):
    """The rows, NEES over the number of coefficients, χ²/ν, and changes left out.

    `changes` has the temperatures, °C, rms error and rms u of b(T) − b(25 °C), m/s²; `covered` is
    the share of all within 2 u.
    """

    trials: int
    rows: tuple[TermRow, ...]
    nees: float
    ratio: float
    changes: tuple[tuple[float, float, float], ...]
    covered: float


def observed(made: soaks.SoakedTriads, sensor: Sensor) -> Observations:
    """Return the means as the estimator takes them."""
    r = len(made.labels)
    return Observations(
        made.labels,
        made.mean,
        np.broadcast_to(soaks.NOISE**2 * np.eye(3), (r, 3, 3)),
        np.full(r, 20.0),
        np.ones(r, dtype=np.int64),
        np.arange(r, dtype=float),
        sensor.channels,
        temperature=made.temperature,
        timed=False,
    )


def fits(
    seed: int,
    trials: int,
    orders: Sequence[int] = TRUE_ORDERS,
    *,
    fourth: float = 0.0,
    environment: Environment = ENVIRONMENT,
) -> Fits:
    """Return the estimates of many triads, all soaks together."""
    made = soaks.triads(np.random.default_rng([seed, 27]), trials, fourth=fourth)
    chosen = METHODS["six_position"].prepare(imu().select_axes("f"), also=order_terms("f", orders))
    sensor = replace(chosen, reference_temperature=soaks.REFERENCE)
    seen = observed(made, sensor)
    steps = [
        Hold(name, (x, y, z), 20.0)
        for name, (x, y, z) in zip(made.labels, made.up.tolist(), strict=True)
    ]
    p = len(sensor.coefficients)
    first = ml(seen, sensor, BENCH, steps)
    seen = with_soak_errors(seen, sensor, first.value[:, :p], environment)
    return Fits(made, sensor, ml(seen, sensor, BENCH, steps))


def table(found: Fits) -> SoakTable:
    """Return errors against what is stated."""
    made, sensor, estimate = found
    names, p = sensor.coefficients, len(sensor.coefficients)
    error = estimate.value[:, :p] - np.stack([made.truth(name) for name in names], axis=-1)
    covariance = estimate.covariance[:, :p, :p]
    sd = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
    rows: list[TermRow] = []
    for term in dict.fromkeys(name.partition(".")[2] for name in names):
        at = [k for k, name in enumerate(names) if name.partition(".")[2] == term]
        inside = np.abs(error[:, at]) <= 2 * sd[:, at]
        rows.append(TermRow(term, float(np.sqrt((error[:, at] ** 2).mean())), float(inside.mean())))
    weighed = np.linalg.solve(covariance, error[..., None])[..., 0]
    changes: list[tuple[float, float, float]] = []
    within: list[float] = []
    for celsius in soaks.LEFT_OUT:
        dT = celsius + soaks.ZERO - soaks.REFERENCE
        off, u = np.empty((len(error), 3)), np.empty((len(error), 3))
        for i, axis in enumerate(("ax", "ay", "az")):
            by = np.array([_change(name, axis, dT) for name in names])
            off[:, i] = error @ by
            u[:, i] = np.sqrt(np.einsum("i,tij,j->t", by, covariance, by))
        changes.append((celsius, float(np.sqrt((off**2).mean())), float(np.sqrt((u**2).mean()))))
        within.append(float((np.abs(off) <= 2 * u).mean()))
    return SoakTable(
        len(error),
        tuple(rows),
        float((error * weighed).sum() / error.size),
        float((estimate.chi2 / estimate.dof).mean()),
        tuple(changes),
        float(np.mean(within)),
    )


def _change(name: str, axis: str, dT: float) -> float:
    """Return the derivative of b(T) − b(25 °C) of an axis to a coefficient."""
    own, _, term = name.partition(".")
    if own != axis or not term.startswith("k0_dT"):
        return 0.0
    return dT ** int(term.removeprefix("k0_dT") or 1)


def orders_chosen(found: Fits) -> list[tuple[int, int, int]]:
    """Return the orders of least AIC of each triad."""
    estimate, chosen = found.estimate, list[tuple[int, int, int]]()
    for k in range(len(estimate.value)):
        one = replace(
            estimate,
            value=estimate.value[k],
            covariance=estimate.covariance[k],
            chi2=estimate.chi2[k],
        )
        _, tests = choose_orders(one, found.sensor)
        chosen.append(min(tests, key=lambda test: test.excess).orders)
    return chosen


if __name__ == "__main__":
    import sys

    trials = int(sys.argv[1])
    print(table(fits(1, trials)))
