"""Warn about estimated coefficients that are far larger than those of any sensor.

If a plan leaves few or no degrees of freedom, a wrong reading shows in no residual, but the terms
beyond bias, scale factor and misalignment become large. In healthy MEMS sensors, these terms change
the reading by at most 0.2 % of 1 g or 1 rad/s, at 1 g or 1 rad/s. The limit is ten times as large.

A latitude φ with the wrong sign changes the vertical earth rate by 2 ω sin φ. If the force on the
gyros is gravity, this acts like a g-sensitivity along I that all gyros have in common and that no
residual shows::

    Δg_i = −2 ω sin φ / g

The n sensitivities to acceleration of a sensor are assumed to be normally distributed with an
unknown standard deviation. The sign is doubtful if their likelihood without Δg_i is 500 times as
large: (Σ x² / Σ ((x − Δ)² + u²))^(n/2).
"""

from collections.abc import Iterator

import numpy as np

from inercal.basics.keys import CoefficientName
from inercal.basics.units import Measured, format_value_and_uncertainty
from inercal.estimation import Estimate
from inercal.physics.earth import earth_rate_up_north
from inercal.physics.sensors import G0, Sensor
from inercal.recordings import Finding

_GROUPS = ("nonlinearity", "asymmetry", "cross", "g", "g2")
_LARGEST = 0.02  # of the natural size
_SIGMAS = 6.0  # standard deviations by which a coefficient must exceed the limit
_LIKELY = 500.0
_FEWEST = 2  # gyros that can have a sensitivity in common


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


def wrong_latitude_sign(
    estimate: Estimate, sensor: Sensor, latitude: Measured | float | None
) -> Iterator[Finding]:
    """Yield a warning if the g-sensitivities imply that the latitude, rad, has the wrong sign."""
    names = [CoefficientName(name).term for name in sensor.coefficients]
    at = [k for k, name in enumerate(names) if name in ("g_i", "g_p", "g_o")]
    along = np.array([names[k] == "g_i" for k in at])
    if latitude is None or along.sum() < max(_FEWEST, sensor.rank("w")):
        return
    x, u = estimate.value[at], np.sqrt(np.diag(estimate.covariance))[at]
    place = latitude.value if isinstance(latitude, Measured) else latitude
    shift = -2 * earth_rate_up_north(place)[0] / G0
    ratio = np.sum(x**2) / np.sum((x - shift * along) ** 2 + u**2)
    if len(at) / 2 * np.log(ratio) > np.log(_LIKELY):
        size = f"{shift / sensor.coefficient(sensor.coefficients[at[0]]).si:.3g} °/h/g"
        text = f"the sign of the latitude seems wrong, because all g_i are near {size}"
        yield Finding("warning", "latitude", f"{text}; check the sign of [bench] latitude")
