"""Ramps at rest over many gyros: error of b(T) − b(25 °C), coverage and the lag found."""

from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from tests.accuracy import ramps

from inercal.basics.units import Measured
from inercal.benches import Hand
from inercal.methods import METHODS
from inercal.methods.temperature_ramp import ramp, rest
from inercal.physics.sensors import Noise, Readout, Sensor, triad
from inercal.recordings import Observations, Track
from inercal.recordings.environment import Environment

Array = NDArray[np.float64]
TERMS = ("bias", "bias_dT", "bias_dT2", "bias_dT3")


class RampRow(NamedTuple):
    """Errors of one profile over many gyros, °/h and s; NEES of the three terms over 3."""

    profile: str
    runs: int
    rms: float
    coverage: float
    nees: float
    lag: float
    lag_scatter: float


def gyro() -> Sensor:
    """Return one gyro with the noise of the generator and the terms of a cubic."""
    whole = triad(
        "gyro",
        "w",
        "g",
        Readout(1.0, 0.0, "rad/s", None),
        Noise(ramps.WHITE, ramps.FLICKER, ramps.WALK),
    )
    one = replace(whole, axes=whole.axes[:1], reference_temperature=ramps.REFERENCE)
    return METHODS["temperature_ramp"].prepare(one, also=TERMS)


def observed(made: ramps.Ramp) -> Observations:
    """Return the recording as the estimator takes it."""
    n = made.time.size
    track = Track(
        made.time,
        made.reading[:, None],
        np.zeros((n, 0)),
        np.zeros(n, dtype=np.int64),
        made.recorded,
    )
    return Observations(
        ("rest",),
        np.array([[made.reading.mean()]]),
        np.array([[[made.reading.var() / n]]]),
        np.array([float(n)]),
        np.array([n]),
        np.array([n / 2]),
        ("gx",),
        temperature=np.array([made.recorded.mean()]),
        track=track,
    )


def errors_of_run(
    made: ramps.Ramp, environment: Environment | None = None
) -> tuple[Array, Array, float, float]:
    """Return errors of b(T) − b(25 °C) and u, rad/s, at `ramps.COMPARED`; lag, s; NEES/3."""
    sensor = gyro()
    bench = Hand(Measured(9.81, 1e-4))
    estimate = ramp(observed(made), sensor, bench, rest(), environment=environment)
    warmth = ramps.COMPARED - ramps.REFERENCE
    by = np.stack([np.zeros(warmth.size), warmth, warmth**2, warmth**3], axis=-1)
    error = by @ estimate.value[:4] - ramps.change(ramps.COMPARED)
    u = np.sqrt(np.einsum("ki,ij,kj->k", by, estimate.stated_covariance[:4, :4], by))
    lag = estimate.value[estimate.names.index("lag")] if "lag" in estimate.names else np.nan
    off, covariance = estimate.value[1:4] - ramps.BIAS[1:], estimate.stated_covariance[1:4, 1:4]
    size = np.sqrt(np.diag(covariance))
    nees = (off / size) @ np.linalg.solve(covariance / size[:, None] / size, off / size)
    return error, u, float(lag), float(nees) / 3


def row(
    name: str,
    profile: Callable[[], Array],
    runs: int,
    seed: int,
    environment: Environment | None = None,
) -> RampRow:
    """Return the errors of one profile over many runs."""
    element, found = profile(), list[tuple[Array, Array, float, float]]()
    for k in range(runs):
        made = ramps.record(np.random.default_rng([seed, k]), element)
        found.append(errors_of_run(made, environment))
    error, u = (np.stack([one[k] for one in found]) for k in (0, 1))
    inside = (element.min() + ramps.ZERO <= ramps.COMPARED) & (
        element.max() + ramps.ZERO >= ramps.COMPARED
    )
    away = (ramps.COMPARED != ramps.REFERENCE) & inside
    lag = np.array([one[2] for one in found])
    return RampRow(
        name,
        runs,
        float(np.sqrt((error[:, away] ** 2).mean())) / ramps.DEG_H,
        float((np.abs(error) <= 2 * u)[:, away].mean()),
        float(np.mean([one[3] for one in found])),
        float(lag.mean()),
        float(lag.std()),
    )


if __name__ == "__main__":
    import sys

    for name, profile in ramps.PROFILES.items():
        print(row(name, profile, int(sys.argv[1]), 1))
