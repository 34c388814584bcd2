"""Determine the static radius of an arm with its stretch, and the rate of a table or an arm.

Radius: with a coordinate measuring machine, the radius is the mean of the readings. An
accelerometer whose scale factor S is known, and whose input axis points to the axis of rotation,
gives at the rates ω::

    S reading = (1 + s) a + k₂ a² + e,   a = R (1 + κ R ω²) (ω (1 + ρ))²

s is the error of its scale factor, k₂ its quadratic term, and ρ the relative error of the rate, so
that

    u_R/R = √(u_s² + (u_g/g)² + 4 u_ρ² + …)

if the scale factor was determined with gravity g. Then s contains the error of g, and R is
correlated with it. The effects of the stretch κ and of k₂/R grow with the rate in the same way. κ
is therefore not known better than k₂, which must be known from a measurement at 1 g. R and κ are
correlated.

Source: IEEE Std 836-2009, 7 (radius by the sensor).

Rate: a counter determines the error of the rate and its stability. N whole turns in T seconds give
the mean rate 2πN/T, with the relative uncertainty u = √2 u_t/T from two time stamps. The comparison
with the rate Ω that the bench states is::

    2πN/(TΩ) − 1 = ρ + γ sgn Ω + e,   u(e) = √2 u_t/T

ρ is the relative error that all rates share, and γ its asymmetry. The error of the counter's
timebase is common to all counts and adds to ρ. In repeated counts at one set rate, the scatter that
exceeds √2 u_t/T is the instability of the rate.
"""

from collections.abc import Mapping
from dataclasses import dataclass

# pyright: reportMissingTypeStubs=false
from math import pi, sqrt

import numpy as np
from scipy import special

from inercal.basics.arrays import Array
from inercal.basics.errors import InputError
from inercal.basics.units import Measured, format_count
from inercal.benches.qualification.linear_fit import (
    LinearFit,
    MeasuredParameters,
    from_fit,
    linear_fit,
    readings_error,
)

_FEWEST_SPEEDS = 3  # speeds needed to estimate a stretch
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
    if stretch and speeds < _FEWEST_SPEEDS:
        raise readings_error(
            f"{format_count(speeds, 'speed')} cannot show the stretch of the arm; measure at "
            "three or more",
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


_FEWEST_COUNTS = 4  # counts needed to estimate a scatter
_LEVEL = 0.05


def counted_rates(
    rate: Array, turns: Array, seconds: Array, timer_sd: float
) -> tuple[Array, Array]:
    """Return the relative difference of each counted rate from the stated one, and its uncertainty.

    Parameters
    ----------
    rate : (m,) array
        Rates that the bench states, with sign, rad/s.
    turns, seconds : (m,) arrays
        Number of whole turns, and the time that they took, s.
    timer_sd : float
        Standard deviation of one time stamp, s.

    Raises
    ------
    InputError
        A count is not possible.
    """
    if (rate == 0).any() or (turns <= 0).any() or (seconds <= 0).any():
        raise InputError(
            "a rate is zero, or turns or seconds are not positive: give counts of a turning table",
            key="[measurement] file",
        )
    found = 2 * pi * turns / (seconds * np.abs(rate)) - 1
    off = np.abs(found)
    if off.max() > 0.01:
        k = int(off.argmax())
        raise readings_error(
            f"count {k + 1}: the counted rate differs from the stated rate by {100 * found[k]:.3g} "
            "%; check the number of turns and the unit of the rate",
        )
    return found, sqrt(2) * timer_sd / seconds


def rate_error(
    rate: Array,
    turns: Array,
    seconds: Array,
    timer_sd: float,
    timebase_sd: float,
    names: tuple[str, ...],
) -> MeasuredParameters:
    """Estimate the relative error of the rate.

    Parameters
    ----------
    rate, turns, seconds, timer_sd
        The same as for `counted_rates`.
    timebase_sd : float
        Relative standard uncertainty of the counter's timebase.
    names : tuple of one or two str
        Name of ρ and, if γ is to be estimated, name of γ.

    Raises
    ------
    InputError
        γ is requested, but all rates have the same sense.
    """
    found, u = counted_rates(rate, turns, seconds, timer_sd)
    sense, size = np.sign(rate), np.abs(rate)
    columns, unseen = np.ones((len(rate), 1)), ("changes during a count",)
    if len(names) > 1:
        if len(set(sense.tolist())) < 2:
            raise readings_error(
                "all rates are in the same sense, so their error cannot be distinguished from "
                "the asymmetry; count in both senses",
            )
        columns = np.stack([columns[:, 0], sense], axis=-1)
    missing: dict[str, Array] = {}
    if np.ptp(size) > 1e-3 * size.max():
        trend = (size - size.mean()) / np.ptp(size)
        missing["the error changes with the rate, by {size:.2g} ppm over the range"] = (
            1e-6 * trend[:, None]
        )
    if len(names) == 1 and len(set(sense.tolist())) > 1:
        missing["the error differs between the senses by 2 × {size:.2g} ppm"] = (
            1e-6 * sense[:, None]
        )
    fit = linear_fit(columns, found, u, missing)
    covariance = fit.covariance.copy()
    covariance[0, 0] += timebase_sd**2
    return from_fit(fit, names, "1", fit.value, covariance, unseen)


def rate_stability(
    rate: Array, turns: Array, seconds: Array, timer_sd: float, name: str
) -> MeasuredParameters:
    """Estimate how much the rate varies between counts, as a variance.

    The estimate is s² minus the variance due to the counter. With m counts at k set rates it has
    ν = m − k degrees of freedom. It is multiplied by ν/(ν − 2), so that a normal prior with this
    variance has the same coverage as the t distribution. If the counter's noise explains s², the
    95 % upper limit is used instead.

    Parameters
    ----------
    rate, turns, seconds, timer_sd
        The same as for `counted_rates`, in the order of time.
    name : str
        Name of the parameter.

    Raises
    ------
    InputError
        Too few counts are repeated at the same set rate.
    """
    found, u = counted_rates(rate, turns, seconds, timer_sd)
    fraction: Array = rate / np.abs(rate).max()
    of = np.unique(np.round(200 * fraction), return_inverse=True)[1]
    groups = int(of.max()) + 1
    dof = len(found) - groups
    if dof < _FEWEST_COUNTS - 1:
        raise readings_error(
            f"{len(found)} counts at {groups} set rates leave {dof} degrees of freedom: repeat "
            f"the count at one rate at least {_FEWEST_COUNTS} times",
        )
    mean = np.array([found[of == k].mean() for k in range(groups)])
    residual = found - mean[of]
    scatter, noise = float(residual @ residual) / dof, float(np.mean(u**2))
    chi2 = scatter * dof / noise if noise > 0 else 0.0
    seen = scatter > noise * special.chdtri(dof, _LEVEL) / dof
    upper = scatter * dof / special.chdtri(dof, 1 - _LEVEL)
    variance = (scatter - noise) * dof / max(dof - 2, 1) if seen else upper
    remarks = (
        f"scatter {1e6 * sqrt(scatter):.3g} ppm in {len(found)} counts, of which the counter "
        f"causes {1e6 * sqrt(noise):.3g} ppm"
        + ("" if seen else "; no instability was detected, so the 95 % limit is stated"),
    )
    suspects: tuple[str, ...] = ()
    step = np.diff(residual)[np.diff(of) == 0]
    if step.size >= 2 * _FEWEST_COUNTS:
        # von Neumann 1941: for independent values the mean square of differences is 2 s².
        ratio = float(step @ step) / step.size / scatter
        z = (ratio / 2 - 1) * sqrt(step.size)
        if z < -2.33:
            suspects = (
                "the rate drifts: successive counts differ less than independent ones "
                f"(ratio {ratio:.2f}, expected 2); state its drift, or let the drive warm up",
            )
    fit = LinearFit(np.zeros(1), np.array([[variance]]), chi2, 0, suspects)
    unseen = ("changes of the rate that are slower than the whole series of counts",)
    return from_fit(fit, (name,), "1", fit.value, fit.covariance, unseen, remarks)
