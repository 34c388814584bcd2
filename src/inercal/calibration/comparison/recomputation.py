"""Compare a calibration with stored values from the same data, except for rounding errors."""

from collections.abc import Sequence

import numpy as np

from inercal.basics.arrays import Array
from inercal.calibration import Calibration


def largest_change(
    calibration: Calibration, names: Sequence[str], values: Array, u: Array
) -> float:
    """Return the largest difference of a value or u from the stored one, in units of the stored u.

    Parameters
    ----------
    calibration : Calibration
    names : sequence of str
        Names of the stored coefficients. If the calibration has other names, the result is inf.
    values, u : (p,) array
        Stored values and standard uncertainties, SI.
    """
    if tuple(calibration.sensor.coefficients) != tuple(names):
        return float("inf")
    changes = np.abs([calibration.values - values, calibration.std - u])
    known = u > 0
    if np.any(changes[:, ~known] > 0):
        return float("inf")
    return float(np.max(changes[:, known] / u[known], initial=0.0))
