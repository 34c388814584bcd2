"""Terms with the sign of the input, in readings of axes without a nominal input.

A gyro across the table's axis senses Ω t, t the error of the setting, and its asymmetry adds
½ κ′ |Ω t|. As the misalignments are as good as free, the estimate of t is near zero, where this
term has a kink that stops a search. Its sign is that of an error, and its size, 0.1 °/h at κ′ = 500
ppm, 200 °/s and 0.05°, below the noise of a dwell: these terms are left out there.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from inercal.basics.arrays import Array
from inercal.benches.rate_platform.bench import RatePlatform
from inercal.benches.rate_platform.sections import PlatformStep, RateDwell
from inercal.estimation import Problem
from inercal.physics.sensors import G0, Sensor

_NOTHING = 1e-6  # of g, or of 1 rad/s


def readings_without_input(
    sensor: Sensor, bench: RatePlatform, steps: Sequence[PlatformStep]
) -> NDArray[np.bool_]:
    """Return whether each reading, row after row, (r m,), has no nominal input.

    In a pose a gyro senses the earth's rate alone, whose level part is unknown: that is none.
    """
    motion = bench.mean_motion(steps, {}).motion
    dwells = np.array([isinstance(step, RateDwell) for step in steps])
    inputs = {"f": motion.f / G0, "w": motion.w * dwells[:, None]}
    sensed = [inputs[axis.measures] @ np.array(axis.i) for axis in sensor.axes]
    return (np.abs(np.stack(sensed, axis=-1)) < _NOTHING).ravel()


def without_signs(whole: Problem, sensor: Sensor, unsigned: NDArray[np.bool_]) -> Problem:
    """Return the problem without terms that depend on a sign in some readings.

    Parameters
    ----------
    whole : Problem
        Of m observations; the sensor's coefficients come first.
    sensor : Sensor
    unsigned : (m,) array of bool
        Those without a nominal input.
    """
    terms = [
        k
        for k, name in enumerate(sensor.coefficients)
        if sensor.coefficient(name).basis.uses("si", "swi")
    ]
    if not terms or not unsigned.any():
        return whole

    def linearise(x: Array) -> tuple[Array, Array]:
        residual, jacobian = whole.linearise(x)
        without = x.copy()
        without[..., terms] = 0.0
        plain, slope = whole.linearise(without)
        slope[..., terms] = 0.0
        return (
            np.where(unsigned, plain, residual),
            np.where(unsigned[:, None], slope, jacobian),
        )

    return replace(whole, linearise=linearise, normal_equations=None)
