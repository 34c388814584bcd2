"""The white noise that a sensor is stated to have, against what a recording at rest shows.

Uncertainties are by the noise that is found, except in filters, which take the stated one. Either
way a sensor that is far from its statement has another noise, another unit or another scale than
was believed.

Beyond white noise N a mean over T holds bias instability B, random walk K and the rounding to
steps q: of these at most B² + K² T/3 + q²/12 of variance, which is allowed for.
"""

from collections.abc import Sequence

import numpy as np

from inercal.plan import Rotation, Spin, Step, Turn
from inercal.recording import Finding, Observations
from inercal.sensors import Sensor
from inercal.units import format_value_and_uncertainty, si_factor

_APART = 2.0  # times: what 20 batches find of white noise is within 20 %
_UNITS = {"f": ("accelerometer", "m/s²", "µg/√Hz"), "w": ("gyro", "rad/s", "°/√h")}


def check_stated_noise(
    observations: Observations, sensor: Sensor, steps: Sequence[Step], *, by_hand: bool
) -> tuple[Finding, ...]:
    """Return a warning for each kind of axes whose noise is not as stated.

    Parameters
    ----------
    observations : Observations
        Means of sections of a recording, without a trial axis.
    sensor : Sensor
    steps : sequence of r Step
        Of each row. In motion and in a hand readings hold more than the sensor's noise.
    by_hand : bool
    """
    variance = np.diagonal(observations.covariance, axis1=-2, axis2=-1)
    resting = np.array([not by_hand and _is_at_rest(step) for step in steps])
    lasting = observations.duration[:, None]
    found: list[Finding] = []
    for kind, (words, like, unit) in _UNITS.items():
        own = [k for k, axis in enumerate(sensor.axes) if axis.measures == kind]
        noises = [sensor.axes[k].noise for k in own]
        if not any(noise.white for noise in noises):
            continue
        stated = np.array([noise.white**2 for noise in noises])
        slow = np.array([n.bias_instability**2 + n.quantisation**2 / 12 for n in noises])
        walk = np.array([n.random_walk**2 for n in noises])
        most = stated + slow * lasting + walk * lasting**2 / 3
        density = variance[:, own] * lasting
        low = np.median(density / stated, axis=0)
        high = np.median((density / most)[resting], axis=0) if resting.any() else np.ones(len(own))
        off = np.where(low < _APART**-2, low, np.where(high > _APART**2, high, 1.0))
        k = int(np.argmax(np.abs(np.log(off))))
        if off[k] == 1.0:
            continue
        size = si_factor(unit, f"({like})/√Hz")
        mean = float(np.sqrt(np.median(density[:, k])))
        found.append(
            Finding(
                "warning",
                "noise",
                f"{sensor.axes[own[k]].name}: the noise of the recording is "
                f"{format_value_and_uncertainty(0.0, mean / size)[1]} {unit}, but [sensor.{words}] "
                f"white states {format_value_and_uncertainty(0.0, noises[k].white / size)[1]} "
                f"{unit}: check it, the unit and the scale",
                sensor.axes[own[k]].name,
            )
        )
    return tuple(found)


def _is_at_rest(step: Step) -> bool:
    """Return whether a step is at rest."""
    if isinstance(step, Spin):
        return step.rate == 0
    return not isinstance(step, Turn | Rotation)
