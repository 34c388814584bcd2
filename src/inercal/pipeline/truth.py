"""What a simulated sensor truly is, in the frame of its calibration.

[sensor.truth] is stated in the frame of the mounting. A calibration in the symmetric frame has
other misalignments, and a little other scale factors and biases, of the same sensor.
"""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from inercal.calibration import Calibration
from inercal.errors import InputError


def true_coefficients(calibration: Calibration, truth: Mapping[str, float]) -> Mapping[str, float]:
    """Return the true coefficients, SI, of the calibration by full name.

    Where terms beyond bias, scale factor and misalignment are among them, which do not turn, the
    truth is as stated.

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
        turned = true.in_frame("symmetric")
    except InputError:
        return stated
    return {name: turned.value(name) for name in names}
