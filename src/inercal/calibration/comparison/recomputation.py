"""The difference of a calibration from stored values of the same data: of rounding alone."""

from collections.abc import Sequence

import numpy as np

from inercal.basics.arrays import Array
from inercal.calibration import Calibration


def largest_change(
    calibration: Calibration, names: Sequence[str], values: Array, u: Array
) -> float:
    """Return the largest difference of a value or of its u from stored ones, in stored u.

    Parameters
    ----------
    calibration : Calibration
    names : sequence of str
        The stored coefficients; inf where those of the calibration are others.
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
