"""Describe the motion at a sensor: specific force, angular rate and acceleration, and field.

All vectors are in the sensor's frame. `f` is specific force: an accelerometer at rest reads +g
along the upward vertical. Arrays may have leading dimensions for trials: `(..., n, 3)`.
"""

from dataclasses import dataclass, field

import numpy as np

from inercal.basics.arrays import Array


def _zero_vector() -> Array:
    return np.zeros((1, 3))


@dataclass(frozen=True, eq=False)
class Motion:
    """Specific force, angular rate and its derivative, temperature and field, sample by sample.

    Parameters
    ----------
    f : (..., n, 3) array
        Specific force at the sensor's origin, m/s².
    w : (..., n, 3) array
        Angular rate relative to inertial space, rad/s.
    dw : (..., n, 3) array
        Time derivative of `w`, rad/s².
    dT : (..., n) array or float
        Temperature minus the sensor's reference temperature, K.
    dTdt : (..., n) array or float
        Time derivative of the temperature, K/s.
    m : (..., n, 3) array
        Magnetic flux density, T.
    """

    f: Array
    w: Array = field(default_factory=_zero_vector)
    dw: Array = field(default_factory=_zero_vector)
    dT: Array | float = 0.0
    dTdt: Array | float = 0.0
    m: Array = field(default_factory=_zero_vector)
