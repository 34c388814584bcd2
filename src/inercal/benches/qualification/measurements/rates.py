"""Determine the rate of a table or a centrifuge's arm with a counter, and its stability.

N whole turns in T seconds give the mean rate 2πN/T, with the relative uncertainty u = √2 u_t/T from
two time stamps. The comparison with the rate Ω that the bench states is::

    2πN/(TΩ) − 1 = ρ + γ sgn Ω + e,   u(e) = √2 u_t/T

ρ is the relative error that all rates share, and γ its asymmetry. The error of the counter's
timebase is common to all counts and adds to ρ. In repeated counts at one set rate, the scatter that
exceeds √2 u_t/T is the instability of the rate.
"""
# pyright: reportMissingTypeStubs=false

from math import pi, sqrt

import numpy as np
from scipy import special

from inercal.basics.arrays import Array
from inercal.basics.errors import InputError
from inercal.benches.qualification.linear_fit import MeasuredParameters, from_fit, linear_fit

_FEWEST = 4  # counts needed to estimate a scatter
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
        raise InputError(
            f"count {k + 1}: the counted rate differs from the stated rate by {100 * found[k]:.3g} "
            "%; check the number of turns and the unit of the rate",
            key="[measurement] file",
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
            raise InputError(
                "all rates are in the same sense, so their error cannot be distinguished from "
                "the asymmetry; count in both senses",
                key="[measurement] file",
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
    if dof < _FEWEST - 1:
        raise InputError(
            f"{len(found)} counts at {groups} set rates leave {dof} degrees of freedom: repeat "
            f"the count at one rate at least {_FEWEST} times",
            key="[measurement] file",
        )
    mean = np.array([found[of == k].mean() for k in range(groups)])
    residual = found - mean[of]
    scatter, noise = float(residual @ residual) / dof, float(np.mean(u**2))
    chi2 = scatter * dof / noise if noise > 0 else np.inf
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
    if step.size >= 2 * _FEWEST:
        # von Neumann 1941: for independent values the mean square of differences is 2 s².
        ratio = float(step @ step) / step.size / scatter
        z = (ratio / 2 - 1) * sqrt(step.size)
        if z < -2.33:
            suspects = (
                "the rate drifts: successive counts differ less than independent ones "
                f"(ratio {ratio:.2f}, expected 2); state its drift, or let the drive warm up",
            )
    return MeasuredParameters(
        (name,),
        ("1",),
        np.zeros(1),
        np.array([[variance]]),
        0.0 if not np.isfinite(chi2) else chi2,
        0,
        1.0,
        suspects,
        ("changes of the rate that are slower than the whole series of counts",),
        remarks,
    )
