"""True coefficients of a simulated sensor, in the frame of its calibration.

[sensor.truth] is stated in the frame of the mounting. In the symmetric frame the same sensor has
other misalignments, and slightly other scale factors and biases.
"""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from inercal.basics.errors import InputError
from inercal.calibration import Calibration


def true_coefficients(calibration: Calibration, truth: Mapping[str, float]) -> Mapping[str, float]:
    """Return the true coefficients, SI, of the calibration by full name.

    Terms beyond bias, scale factor and misalignment cannot be rotated: with them the truth is
    rerotated as stated.

    Parameters
    ----------
    calibration : Calibration
    truth : mapping of str to float
        As stated, SI; those missing are zero.
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
