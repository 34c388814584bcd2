"""Warm-ups with a coarse thermometer over many seeds: errors of lag and coefficients.

`python -m tests.evidence.coarse_thermometers 40` prints the rows of the method's note.
"""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from tests.accuracy import warm_ups
from tests.accuracy.warm_ups import WarmUp

from inercal.basics.errors import NotObserved
from inercal.basics.units import Measured
from inercal.benches import Hand
from inercal.estimation import Estimate
from inercal.methods import METHODS
from inercal.methods.temperature_ramp import ramp, rest
from inercal.physics.sensors import Noise, Readout, Sensor, triad
from inercal.recordings import Observations, Track
from inercal.recordings.environment import Environment

# The generator rounds: an error that truncation may add is known to be none.
ROUNDS = Environment("ramp", temperature_sd=1e-9)
GOOD = {
    "1 K": WarmUp(),
    "0.5 K": WarmUp(step=0.5),
    "1 K, 30 min, lag 20 s, constant 500 s": WarmUp(lag=20.0, constant=500.0, minutes=30.0),
    "1 K, 45 min, lag 60 s, constant 800 s": WarmUp(lag=60.0, constant=800.0, minutes=45.0),
    "1 K, 60 s of rest first": WarmUp(before=60.0),
    "1 K, refreshed every 5 s": WarmUp(refreshed=5.0),
    "0.1 K": WarmUp(step=0.1),
}
BAD = {
    "first 300 s lost": WarmUp(lost=300.0),
    "lag 5 s": WarmUp(lag=5.0),
    "constant 1800 s, 45 min": WarmUp(constant=1800.0, minutes=45.0),
    "noise ten times larger": WarmUp(louder=10.0),
    "5 K": WarmUp(step=5.0),
}


class Row(NamedTuple):
    """Errors over many seeds: of the lag, s, and of the terms of temperature in their u."""

    runs: int
    refused: int
    rms: float
    u: float
    coverage: float
    coefficients: float
    nees: float


def gyros(louder: float = 1.0, *also: str) -> Sensor:
    """Return three gyros with the noise of the generator and the terms of a quadratic."""
    noise = Noise(louder * warm_ups.WHITE, 0.0, 0.0)
    sensor = triad("gyro", "w", "g", Readout(1.0, 0.0, "rad/s", None), noise)
    sensor = replace(sensor, reference_temperature=warm_ups.ZERO + 20.0)
    return METHODS["temperature_ramp"].prepare(sensor, also=("bias", "bias_dT", "bias_dT2", *also))


def observed(warm: WarmUp, seed: tuple[int, ...]) -> Observations:
    """Return a recording as the estimator takes it."""
    time, kelvin, reading = warm_ups.made(warm, np.random.default_rng(seed))
    n = time.size
    track = Track(time, reading, np.zeros((n, 0)), np.zeros(n, dtype=np.int64), kelvin)
    return Observations(
        ("rest",),
        reading.mean(axis=0)[None],
        np.diag(reading.var(axis=0) / n)[None],
        np.array([float(n)]),
        np.array([n]),
        np.array([n / 2]),
        ("gx", "gy", "gz"),
        temperature=np.array([kelvin.mean()]),
        track=track,
    )


def fitted(
    warm: WarmUp, seed: tuple[int, ...], environment: Environment | None = ROUNDS
) -> Estimate:
    """Return the estimate of one recording."""
    seen, bench = observed(warm, seed), Hand(Measured(9.81, 1e-4))
    return ramp(seen, gyros(warm.louder), bench, rest(), environment=environment)


def errors(estimate: Estimate, warm: WarmUp) -> tuple[float, float, np.ndarray]:
    """Return the error of the lag and its u, s, and those of the six terms in their u."""
    sd = np.sqrt(np.diag(estimate.stated_covariance))
    at = [
        estimate.names.index(f"g{axis}.{term}")
        for axis in "xyz"
        for term in ("bias_dT", "bias_dT2")
    ]
    off = estimate.value[at] - warm_ups.BIAS[:, 1:].reshape(-1)
    lag = estimate.names.index("lag")
    return float(estimate.value[lag]) - warm.lag, float(sd[lag]), off / sd[at]


def row(warm: WarmUp, runs: int, seed: int) -> Row:
    """Return the errors over many seeds."""
    found: list[tuple[float, float, np.ndarray]] = []
    for k in range(runs):
        try:
            found.append(errors(fitted(warm, (seed, k)), warm))
        except NotObserved:
            continue
    if not found:
        return Row(runs, runs, np.nan, np.nan, np.nan, np.nan, np.nan)
    off, u = (np.array([one[k] for one in found]) for k in (0, 1))
    terms = np.stack([one[2] for one in found])
    return Row(
        runs,
        runs - len(found),
        float(np.sqrt((off**2).mean())),
        float(u.mean()),
        float((np.abs(off) <= 2 * u).mean()),
        float((np.abs(terms) <= 2).mean()),
        float((terms**2).mean()),
    )


if __name__ == "__main__":
    import sys

    for name, warm in (GOOD | BAD).items():
        print(name, row(warm, int(sys.argv[1]), 1), flush=True)
