"""Remark coefficients of implausible size, with the unit that would explain a scale factor.

If a plan leaves few or no degrees of freedom, a wrong reading shows in no residual, but the terms
beyond bias, scale factor and misalignment become large. In healthy MEMS sensors, these terms change
the reading by at most 0.2 % of 1 g or 1 rad/s, at 1 g or 1 rad/s. The limit is ten times as large.

The scale factors of most sensors are within a few percent of nominal, and their biases are below
1 g or 30 °/s. A sensor with a wide range may have a bias of up to a tenth of its range. Readings in
counts are not judged, because their nominal scale is often only approximate.
"""

from collections.abc import Iterator
from math import pi, radians

import numpy as np

from inercal.basics.errors import InputError
from inercal.basics.units import format_value_and_uncertainty, si_factor
from inercal.estimation import Estimate
from inercal.physics.quantities import ANGULAR_RATE, QUANTITIES, SPECIFIC_FORCE, Measures
from inercal.physics.sensors import G0, Axis, Sensor
from inercal.physics.sensors.coefficient_selection import axis_words
from inercal.recordings import Finding

_GROUPS = ("nonlinearity", "asymmetry", "cross", "g", "g2")
_LARGEST = 0.02  # of the natural size
_FAR_SCALE = 0.1  # the scale factors of most sensors are within a few percent of nominal
_FAR_BIAS = {"f": G0, "w": radians(30.0)}
_RANGE = 0.1  # of the full scale: a larger bias is implausible even for a wide range
_SIGMAS = 6.0  # standard deviations by which a coefficient must exceed the limit
_TOLERANCE = 0.1  # relative, for recognising a scale factor as a ratio of units
_LEAST_COUNTS = 100.0  # times nominal, if no ratio of units fits
_COUNTS = "LSB"
_RATIOS: dict[Measures, tuple[tuple[float, str, str], ...]] = {
    "f": ((G0, "m/s²", "g"), (1000.0, "mg", "g"), (1000 / G0, "mg", "m/s²")),
    "w": ((180 / pi, "°/s", "rad/s"), (1000.0, "m°/s", "°/s"), (180e3 / pi, "m°/s", "rad/s")),
    "m": (),
}


def wrong_unit(axis: Axis, scale: float) -> str:
    """Return the unit that would explain a scale factor, nominally 1, in words.

    The result is empty if no unit explains it, or if the axis reads counts or volts.
    """
    if axis.readout.unit != "SI":
        try:
            si_factor(axis.readout.unit, QUANTITIES[axis.measures].unit)
        except InputError:
            return ""
    for ratio, one, other in _RATIOS[axis.measures]:
        for size, used, stated in ((ratio, one, other), (1 / ratio, other, one)):
            if abs(scale / size - 1) < _TOLERANCE:
                return f"its column looks like {used} stated as {stated}"
    return "its column looks like counts" if abs(scale) > _LEAST_COUNTS else ""


def counts_remark(estimate: Estimate, sensor: Sensor) -> Iterator[str]:
    """Yield the estimated scale factors of accelerometers that read counts, if there are any."""
    value = dict(zip(sensor.coefficients, estimate.value.tolist(), strict=False))
    found = [
        f"{axis.name} {G0 * axis.readout.scale * (1 + value[f'{axis.name}.k1']):.6g}"
        for axis in sensor.axes
        if axis.readout.unit == _COUNTS and f"{axis.name}.k1" in value
    ]
    if found:
        yield f"The scale factors of the accelerometers are {', '.join(found)} LSB/g"


def scale_remarks(estimate: Estimate, sensor: Sensor) -> Iterator[str]:
    """Yield a remark for each kind of sensor whose scale factors are far from the stated one."""
    value = dict(zip(sensor.coefficients, estimate.value.tolist(), strict=False))
    for kind in (SPECIFIC_FORCE, ANGULAR_RATE):
        axes = (
            axis.name
            for axis in sensor.axes
            if axis.measures == kind.symbol and axis.readout.unit != _COUNTS
        )
        errors = (value.get(f"{name}.{kind.scale}", 0.0) for name in axes)
        size = max(errors, key=abs, default=0.0)
        if abs(size) > _FAR_SCALE:
            yield (
                f"The scale factors of the {kind.sensors} differ by up to {100 * abs(size):.0f} % "
                f"from the stated one: check the scale and the unit in [sensor.{kind.sensor}]"
            )


def bias_remarks(estimate: Estimate, sensor: Sensor) -> Iterator[str]:
    """Yield a remark for each kind of sensor with an implausibly large bias."""
    value = dict(zip(sensor.coefficients, estimate.value.tolist(), strict=False))
    for kind in (SPECIFIC_FORCE, ANGULAR_RATE):
        sizes: dict[str, float] = {}
        for axis in sensor.axes:
            name = f"{axis.name}.{kind.bias}"
            if axis.measures != kind.symbol or name not in value or axis.readout.unit == _COUNTS:
                continue
            reach = (axis.readout.full_scale or 0.0) / abs(axis.readout.scale)
            if abs(value[name]) > max(_FAR_BIAS[kind.symbol], _RANGE * reach):
                sizes[axis.name] = value[name]
        if sizes:
            name = max(sizes, key=lambda one: abs(sizes[one]))
            size = sizes[name] / (G0 if kind is SPECIFIC_FORCE else radians(1.0))
            yield (
                f"The bias of {axis_words(sensor, name)} is {size:.3g} {kind.reading_unit}, "
                f"unusually large: check the offset and the unit in [sensor.{kind.sensor}]"
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
