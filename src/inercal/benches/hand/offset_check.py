"""Recognise accelerometers that are off by about gravity, such as by a firmware that removes it."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from inercal.basics.arrays import Array
from inercal.physics.sensors import Sensor
from inercal.recordings import Finding
from inercal.recordings.segments.gravity_turns import sphere

_FAR = 0.5  # of gravity; larger than the bias of any accelerometer in order
_NEAR = 0.1  # relative difference between the radius and gravity, from scale factors


def far_off(means: Array, sensor: Sensor, gravity: float) -> dict[str, float]:
    """Return the accelerometers whose bias is about gravity, with their bias, m/s².

    Parameters
    ----------
    means : (r, m) array
        Mean readings at rest in several attitudes, SI.
    sensor : Sensor
    gravity : float
        Local gravity, m/s².
    """
    columns = [k for k, axis in enumerate(sensor.axes) if axis.measures == "f"]
    if len(columns) != len("xyz"):
        return {}
    centre, radius = sphere(means[:, columns])
    if centre is None or radius is None or abs(radius / gravity - 1) > _NEAR:
        return {}
    if float(np.ptp(means[:, columns], axis=0).max()) < radius:
        return {}  # the attitudes are too much alike for a centre
    found = zip((sensor.channels[k] for k in columns), centre.tolist(), strict=True)
    return {name: bias for name, bias in found if abs(bias) > _FAR * gravity}


def explain_norm(
    findings: Sequence[Finding], means: Array, sensor: Sensor, gravity: float
) -> tuple[Finding, ...]:
    """Return the findings; the one about the norm at rest names accelerometers that are far off."""
    far = far_off(means, sensor, gravity)
    text = " and ".join(
        f"{k} is off by {v / gravity:+.2f} g".replace("-", "−") for k, v in far.items()
    )
    if not far:
        return tuple(findings)
    advice = (
        f"{text}, which the estimated bias contains: check whether the firmware removes gravity"
    )
    return tuple(
        replace(one, message=advice) if one.what == "units" and one.severity == "warning" else one
        for one in findings
    )
