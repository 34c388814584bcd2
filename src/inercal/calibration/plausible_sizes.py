"""Warn about estimated coefficients that are far larger than those of any sensor.

If a plan leaves few or no degrees of freedom, a wrong reading shows in no residual, but the terms
beyond bias, scale factor and misalignment become large. In healthy MEMS sensors, these terms change
the reading by at most 0.2 % of 1 g or 1 rad/s, at 1 g or 1 rad/s. The limit is ten times as large.
"""

from collections.abc import Iterator

import numpy as np

from inercal.basics.units import format_value_and_uncertainty
from inercal.estimation import Estimate
from inercal.physics.quantities import ANGULAR_RATE, SPECIFIC_FORCE
from inercal.physics.sensors import Sensor
from inercal.recordings import Finding

_GROUPS = ("nonlinearity", "asymmetry", "cross", "g", "g2")
_LARGEST = 0.02  # of the natural size
_FAR_SCALE = 0.1  # the scale factors of most sensors are within a few percent of nominal
_SIGMAS = 6.0  # standard deviations by which a coefficient must exceed the limit


def scale_remarks(estimate: Estimate, sensor: Sensor) -> Iterator[str]:
    """Yield a remark for each kind of sensor whose scale factors are far from the stated one."""
    value = dict(zip(sensor.coefficients, estimate.value.tolist(), strict=False))
    for kind in (SPECIFIC_FORCE, ANGULAR_RATE):
        axes = (axis.name for axis in sensor.axes if axis.measures == kind.symbol)
        errors = (value.get(f"{name}.{kind.scale}", 0.0) for name in axes)
        size = max(errors, key=abs, default=0.0)
        if abs(size) > _FAR_SCALE:
            yield (
                f"The scale factors of the {kind.sensors} differ by up to {100 * abs(size):.0f} % "
                f"from the stated one: check the scale and the unit in [sensor.{kind.sensor}]"
            )


def implausible_sizes(estimate: Estimate, sensor: Sensor) -> Iterator[Finding]:
    """Yield a warning for each implausibly large coefficient of an estimate without trial axis."""
    sds = np.sqrt(np.diag(estimate.covariance)).tolist()
    for name, value, sd in zip(sensor.coefficients, estimate.value.tolist(), sds, strict=False):
        line = sensor.coefficient(name)
        if line.group in _GROUPS and abs(value) > _LARGEST * line.unit_scale + _SIGMAS * sd:
            size = f"{format_value_and_uncertainty(value / line.si, sd / line.si)[0]} {line.unit}"
            yield Finding(
                "warning",
                "size",
                f"{name} is {size}, implausibly large; look for a wrong reading",
            )
