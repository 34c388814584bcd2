"""Determine the static radius of the arm of a centrifuge or rate table, and its stretch.

With a coordinate measuring machine, the radius is the mean of the readings. An accelerometer whose
scale factor S is known, and whose input axis points to the axis of rotation, gives at the rates ω::

    S reading = (1 + s) a + k₂ a² + e,   a = R (1 + κ R ω²) (ω (1 + ρ))²

s is the error of its scale factor, k₂ its quadratic term, and ρ the relative error of the rate, so
that

    u_R/R = √(u_s² + (u_g/g)² + 4 u_ρ² + …)

if the scale factor was determined with gravity g. Then s contains the error of g, and R is
correlated with it. The effects of the stretch κ and of k₂/R grow with the rate in the same way. κ
is therefore not known better than k₂, which must be known from a measurement at 1 g. R and κ are
correlated.

Source: IEEE Std 836-2009, 7 (radius by the sensor).
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from inercal.basics.arrays import Array
from inercal.basics.errors import InputError
from inercal.basics.units import Measured, format_count
from inercal.benches.qualification.linear_fit import (
    LinearFit,
    MeasuredParameters,
    from_fit,
    linear_fit,
)

_FEWEST = 3  # speeds needed to estimate a stretch
_STEPS = 5  # Gauss-Newton steps


def radius_by_machine(reading: Array, sd: float, certificate_sd: float) -> MeasuredParameters:
    """Estimate the parameter "radius" from readings of a coordinate measuring machine, m.

    Parameters
    ----------
    reading : (m,) array
        Readings, m.
    sd, certificate_sd : float
        Standard deviation of one reading, and certified standard uncertainty of the machine, which
        all readings share, m.
    """
    fit = linear_fit(np.ones((len(reading), 1)), reading, np.full(len(reading), sd))
    unseen = ("the growth of the radius while the arm turns",)
    return from_fit(fit, ("radius",), "m", fit.value, fit.covariance + certificate_sd**2, unseen)


@dataclass(frozen=True)
class RadiusSensor:
    """The accelerometer that measures the radius, and the uncertainty of the rate.

    Parameters
    ----------
    sd : float
        Standard deviation of one reading, m/s².
    scale_sd : float
        Relative standard uncertainty of its scale factor, without the part from gravity.
    k2 : Measured or None
        Quadratic term of the accelerometer, 1/(m/s²); None if it is unknown.
    rate_sd : float
        Relative standard uncertainty that all rates share.
    gravity : Measured or None
        Gravity with which its scale factor was determined, m/s², if the result should be correlated
        with gravity.
    """

    sd: float
    scale_sd: float
    k2: Measured | None
    rate_sd: float
    gravity: Measured | None = None


def radius_by_sensor(
    rate: Array,
    reading: Array,
    sensor: RadiusSensor,
    *,
    stretch: bool,
    rate_value: float = 0.0,
    keep_rate: bool = False,
) -> MeasuredParameters:
    """Estimate the radius of an arm and, if requested, its stretch with an accelerometer.

    The results are "radius", m, and "stretch", 1/(m/s²).

    Parameters
    ----------
    rate : (m,) array
        Rates of the arm, rad/s.
    reading : (m,) array
        Readings, positive toward the axis, m/s².
    sensor : RadiusSensor
    stretch : bool
        Whether to estimate the stretch; otherwise the arm is assumed to be rigid.
    rate_value : float
        Qualified relative error of the rate.
    keep_rate : bool
        Whether the result includes the error of the rate, with its correlations.

    Raises
    ------
    InputError
        There are fewer than three speeds for a stretch, or the quadratic term is not known.
    """
    speeds = len(np.unique(np.round(np.abs(rate), 6)))
    if stretch and speeds < _FEWEST:
        raise InputError(
            f"{format_count(speeds, 'speed')} cannot show the stretch of the arm; measure at "
            "three or more",
            key="[measurement] file",
        )
    if sensor.k2 is None:
        raise InputError(
            "the quadratic term of the sensor is not stated: at many g it acts like a change of "
            "radius and like a stretch; measure it at 1 g and state k2",
            key="[measurement] k2",
        )
    free = ("radius", "stretch") if stretch else ("radius",)
    priors = {
        "scale": Measured(0.0, sensor.scale_sd),
        "k2": sensor.k2,
        "rate": Measured(rate_value, sensor.rate_sd),
    }
    if sensor.gravity is not None:
        priors["g"] = sensor.gravity
    used = tuple(name for name, one in priors.items() if one.sd > 0)
    w2 = rate**2
    x = {"radius": float(np.mean(reading / w2)), "stretch": 0.0}
    x |= {name: one.value for name, one in priors.items()}
    fit = _step(w2, reading, x, sensor, free, {name: priors[name] for name in used})
    for _ in range(_STEPS):
        for name, step in zip((*free, *used), fit.value, strict=True):
            x[name] += float(step)
        fit = _step(w2, reading, x, sensor, free, {name: priors[name] for name in used})
    kept = [*free, *(n for n in used if n == "g" or (n == "rate" and keep_rate))]
    at = [(*free, *used).index(n) for n in kept]
    unit = {"radius": "m", "stretch": "(m/s²)⁻¹", "rate": "1", "g": "m/s²"}
    return from_fit(
        fit,
        tuple(kept),
        tuple(unit[n] for n in kept),
        np.array([x[n] for n in kept]),
        fit.covariance[np.ix_(at, at)],
        ("the attitude of the sensor, which is assumed to point to the axis",),
        (f"relative u of the radius: {1e6 * np.sqrt(fit.covariance[0, 0]) / x['radius']:.2g} ppm",),
    )


def _step(
    w2: Array,
    reading: Array,
    x: Mapping[str, float],
    sensor: RadiusSensor,
    free: tuple[str, ...],
    priors: Mapping[str, Measured],
) -> LinearFit:
    """Return one Gauss-Newton step from x, for the free parameters and those with priors."""
    predicted, slopes = _prediction(w2, x, sensor)
    columns = np.stack([slopes[name] for name in (*free, *priors)], axis=-1)
    rows = np.vstack([columns, np.eye(len(priors), columns.shape[1], len(free))])
    off = np.array([one.value - x[name] for name, one in priors.items()])
    deviations = np.array([one.sd for one in priors.values()])
    sd = np.concatenate([np.full(len(reading), sensor.sd), deviations])
    missing: dict[str, Array] = {}
    if "stretch" not in free:
        lack = np.concatenate([slopes["stretch"], np.zeros(len(priors))])[:, None]
        missing = {
            "the arm stretches by {size:.2g} ppm per m/s²: state the key `stretch`": 1e-6 * lack
        }
    return linear_fit(rows, np.concatenate([reading - predicted, off]), sd, missing)


def _prediction(
    w2: Array, x: Mapping[str, float], sensor: RadiusSensor
) -> tuple[Array, dict[str, Array]]:
    """Return the predicted readings at x, and their derivatives."""
    radius, grown = x["radius"], 1 + x["stretch"] * x["radius"] * w2
    turned = (1 + x["rate"]) ** 2 * w2
    a = radius * grown * turned
    gravity = sensor.gravity
    # If the scale factor was determined with a g that is too small, the readings are too small.
    by_g = 1.0 if gravity is None else gravity.value / x.get("g", gravity.value)
    slope = by_g * (1 + x["scale"] + 2 * x["k2"] * a)
    reading = by_g * ((1 + x["scale"]) * a + x["k2"] * a**2)
    return reading, {
        "radius": slope * (grown + radius * x["stretch"] * w2) * turned,
        "stretch": slope * radius**2 * w2 * turned,
        "scale": by_g * a,
        "k2": by_g * a**2,
        "rate": slope * 2 * a / (1 + x["rate"]),
        "g": -reading / x.get("g", 1.0),
    }
