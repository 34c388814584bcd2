"""Describe disagreements between sessions, and assumptions, in words."""
# SciPy has no stubs.
# pyright: reportMissingTypeStubs=false

from collections.abc import Mapping, Sequence

import numpy as np
import scipy

from inercal.basics.arrays import Array
from inercal.basics.units import format_quantity
from inercal.calibration.comparison import different_sensors
from inercal.laboratory.repeatability.session_fit import SessionFit, fit_sessions
from inercal.laboratory.repeatability.sessions import Owner, named_effects, scatter

_CHANCE = 0.01  # probability of a false finding over all axes of a group or all sessions
_LEAST_SESSIONS = 4  # least number of sessions for finding an outlier


def outlier_sessions(fit: SessionFit, mount_owner: Owner) -> dict[str, float]:
    """Return the outliers among the sessions, each with the probability of this by chance.

    Each session is compared with the mean and scatter of only the other sessions.
    """
    count, size = len(fit.values), len(fit.unit)
    found: dict[str, float] = {}
    if not fit.has_other_days or count < _LEAST_SESSIONS:
        return found
    dof = int(fit.similar.max()) * (count - 2)
    for k, one in enumerate(fit.matched.sessions):
        others = fit.matched.without(k)
        apart = fit_sessions(others, named_effects(others, mount_owner))
        rescaled = apart.unit / fit.unit
        effects, variance = apart.effects, apart.variances.variance
        spread = scatter(effects, variance, [True] * len(effects), size)
        square: Array = np.outer(rescaled, rescaled)
        covariance: Array = (
            fit.own[k] + spread / np.outer(fit.unit, fit.unit) + apart.inverse * square
        )
        off: Array = fit.values[k] - apart.mean * rescaled
        whitened = np.linalg.solve(np.linalg.cholesky(covariance), off)
        chi2 = float(np.sum(whitened**2))
        chance = float(scipy.special.fdtrc(size, dof, chi2 / size))
        if chance < _CHANCE / count:
            found[one.label] = chance
    return found


def single_scatter_lines(fit: SessionFit, pooled: Array, places: Sequence[int]) -> list[str]:
    """Return a line on the coefficients for which their own scatter is used, with both scatters.

    Parameters
    ----------
    pooled : (p,) array
        Variance that similar coefficients share, in units of the fit.
    places : sequence of int
        Indices of the coefficients for which their own scatter is used.
    """
    parts: list[str] = []
    for j in places:
        name = fit.matched.names[j]
        term = fit.matched.sensor.coefficient(name)
        own, like = (
            format_quantity(float(np.sqrt(one[j]) * fit.unit[j]), 0.0, term.unit, 3)
            for one in (fit.alone.variance, pooled)
        )
        if own != like:
            parts.append(f"{name} {own} instead of {like}")
    if not parts:
        return []
    return [
        "U of the next use includes the coefficient's own scatter, which is larger than that of "
        f"similar coefficients: {', '.join(parts)}"
    ]


def hidden_scatter_lines(fit: SessionFit) -> list[str]:
    """Return lines on scatter that the sessions cannot show."""
    return [
        f"{fit.effects[k].name}: one session is much better than the others, whose uncertainties "
        f"explain their scatter, so U of the next use includes no scatter; add a session as good "
        f"as the best one"
        for k in fit.unseen
    ]


def outlier_axes(
    values: Array, groups: Mapping[tuple[str, str, float], Sequence[int]]
) -> list[int]:
    """Return the indices of coefficients that scatter more than on other axes.

    Parameters
    ----------
    values : (k, p) array
        Deviations from the mean, in units in which all sessions scatter equally.
    groups : mapping
        Indices of similar coefficients.
    """
    found: list[int] = []
    k = len(values)
    variance = np.var(values, axis=0, ddof=1)
    for places in groups.values():
        for j in places if len(places) > 1 else ():
            others = [variance[i] for i in places if i != j]
            ratio = variance[j] / max(float(np.mean(others)), 1e-300)
            chance = scipy.special.fdtrc(k - 1, (k - 1) * len(others), ratio)
            if chance < _CHANCE / len(places):
                found.append(j)
    return found


def findings(fit: SessionFit, mount_owner: Owner) -> tuple[str, ...]:
    """Return the lines about the result that a reader must know; the most serious comes first."""
    matched = fit.matched
    lines: list[str] = []
    if not fit.variances.converged:
        lines.append("the estimate of the scatter did not converge; do not rely on it")
    if names := different_sensors(*(one.named for one in matched.sessions))[1]:
        lines.append(
            f"the sessions are of sensors with different names, {names}; the result is only valid "
            "if they are one sensor"
        )
    lines += [
        f"{label} is an outlier among the sessions (p = {p:.1g}); check whether the sensor or "
        "the bench changed"
        for label, p in outlier_sessions(fit, mount_owner).items()
    ]
    if fit.has_other_days:
        z = (fit.values - fit.mean) / np.sqrt(fit.variance)
        lines += [
            f"{matched.names[j]} scatters more than the same coefficient of the other axes. U "
            "of the next use includes its own scatter; with few sessions it covers less than 95 %"
            for j in outlier_axes(z, _without_rotated(fit))
            if fit.alone.counts[j]
        ]
    lines += hidden_scatter_lines(fit)
    if matched.unstated:
        lines.append(
            f"{', '.join(matched.unstated)} does not state which errors calibrations share. "
            "All of its uncertainty is treated as shared, so more sessions do not reduce it"
        )
    if common := [one.name for one in matched.shared if one.name and one.is_common]:
        lines.append(
            f"errors shared by all sessions, which averaging does not reduce: {', '.join(common)}"
        )
    if matched.left_out:
        lines.append(
            f"left out, because not all sessions estimated them: {', '.join(matched.left_out)}"
        )
    return tuple(lines)


def _without_rotated(fit: SessionFit) -> Mapping[tuple[str, str, float], Sequence[int]]:
    """Return the groups without coefficients that a mounting changes."""
    moved = {place for one in fit.effects if one.level == "mount" for place in one.places}
    return {key: places for key, places in fit.groups.items() if not moved & set(places)}
