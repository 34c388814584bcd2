"""Turntable with biases that flicker: errors against what is stated, over devices of a generator.

Errors are those of the biases' means over the recording (`methods.turntable.drift`). The table's
moves are S-curves. Where an ideal trapezoid begins exactly at a sample, as it does here with rates
and accelerations that are whole, what rates miss within a sample has one sign at all kinks. No
table does so; scale factors of a navigation-grade gyro at 100 Hz would show it (z² of 2).
"""

from math import radians, sqrt
from typing import NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray
from tests.accuracy import turntable
from tests.methods.turntable_cases import bench, errors, observations, sensor

from inercal.methods.turntable_kalman import METHOD

Array = NDArray[np.float64]
HZ, BATCH = 100.0, 6
TABLE = turntable.Table(jerk=radians(300))
TACTICAL = turntable.grade(0.1, 0.5, 60, 15, flicker=True)
TEN_SECONDS = [("warm-up", (0, 0, 0), 120.0), *turntable.positions(10.0), *turntable.turns()]
CASES = {
    "navigation grade": (turntable.NAVIGATION, turntable.whole()),
    "navigation grade, holds of 10 s": (turntable.NAVIGATION, TEN_SECONDS),
    "holds of 10 s": (TACTICAL, TEN_SECONDS),
    "tactical grade": (TACTICAL, turntable.whole()),
}


class Nees(NamedTuple):
    """Normalised error squared, a coefficient, of gyros, accelerometers and all; of how many."""

    gyros: float
    accelerometers: float
    whole: float
    devices: int

    @property
    def band(self) -> float:
        """Three standard deviations of `whole`."""
        return 3 * sqrt(2 / (24 * self.devices))


def nees(case: str, devices: int, seed: int) -> Nees:
    """Return the NEES of one of `CASES`; 60 devices and seeds 1 to 3 are the full evidence."""
    grade, path = CASES[case]
    made = sensor(grade)
    kinds = np.array([name[0] for name in made.coefficients])
    found = {"g": list[float](), "a": list[float](), "ga": list[float]()}
    for batch in range(0, devices, BATCH):
        count = min(BATCH, devices - batch)
        draw = turntable.draw(50_000 + 1000 * seed + batch, count, path, grade, TABLE, hz=HZ)
        estimate = METHOD.estimator("full")(observations(draw, made), made, bench(TABLE), ())
        off, covariance = errors(estimate, draw, made)
        for key, rows in found.items():
            at = np.flatnonzero([kind in key for kind in kinds])
            inverse = np.linalg.inv(covariance[:, at][:, :, at])
            rows += (np.einsum("ti,tij,tj->t", off[:, at], inverse, off[:, at]) / at.size).tolist()
    gyros, accelerometers, whole = (float(np.mean(rows)) for rows in found.values())
    return Nees(gyros, accelerometers, whole, devices)


@pytest.mark.slow
@pytest.mark.parametrize("case", CASES)
def test_errors_under_flicker_are_as_large_as_stated(case: str):
    found = nees(case, 12, seed=1)
    print(case, found)
    assert abs(found.whole - 1) <= found.band
