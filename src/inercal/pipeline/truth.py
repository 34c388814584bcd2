"""True coefficients of a simulated sensor, in the frame of its calibration.

[sensor.truth] states coefficients in the mounting frame. In the symmetric frame, the same sensor
has different misalignments, and slightly different scale factors and biases.
"""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from inercal.basics.errors import InputError
from inercal.calibration import Calibration


def true_coefficients(calibration: Calibration, truth: Mapping[str, float]) -> Mapping[str, float]:
    """Return the true coefficients by full name, in SI and in the frame of the calibration.

    Only bias, scale factor and misalignment can be rotated. If there are other terms, the true
    coefficients are returned as stated.

    Parameters
    ----------
    calibration : Calibration
    truth : mapping of str to float
        Stated true coefficients, SI; missing coefficients are zero.
    """
    names = calibration.sensor.coefficients
    stated: dict[str, float] = {name: truth.get(name, 0.0) for name in names}
    if calibration.frame != "symmetric":
        return stated
    true = replace(calibration, values=np.array(list(stated.values())), frame="mount")
    try:
        rotated = true.in_frame("symmetric")
    except InputError:
        return stated
    return {name: rotated.value(name) for name in names}
