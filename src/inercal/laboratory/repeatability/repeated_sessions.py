"""Combine the sessions of a sensor into statements, with U, on its mean and its next use.

The scatter of the sessions is estimated first (`effects`). V is the covariance of all sessions,
which contains their own covariances and the scatter, and W = V⁻¹. The mean is θ̂ = A⁻¹ XᵀWy with A
= XᵀWX. Each of the two statements has its own u_A::

    mean       u_A² = max(1, q) [A⁻¹]
    next use   u_A² = σ² + max(1, q) [A⁻¹],  σ² is the scatter of the sensor itself
    both       U² = t_ν² u_A² + 4 u_B²

u_B is the uncertainty due to errors that sessions share, L = A⁻¹ XᵀW P / u_q for each
determination. More sessions do not reduce u_B. q is the weighted scatter about the mean divided by
its expectation (Hartung and Knapp 2001). Similar axes have a common variance. If an axis scatters
more than the others and the uncertainties of its sessions do not explain this, its own variance is
used (`single_scatter`). t_ν gives the same coverage as 2u, with ν = m (n − 1) for m similar axes
and n levels.

Sources: JCGM 100:2008, G.4; Hartung and Knapp, Statistics in Medicine 20 (2001), 3875–3889;
Higgins, Thompson and Spiegelhalter, J. R. Statist. Soc. A 172 (2009), 137–159 (prediction).

The number of sessions that a statement needs follows from the relative standard deviation of σ,
which is (1 + λ)/√(2ν). Here λ = s²/σ² is the variance of a session's own error divided by the
variance of the scatter.
"""

# SciPy has no stubs.
# pyright: reportMissingTypeStubs=false

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from math import ceil

import numpy as np

from inercal.basics.arrays import Array
from inercal.basics.errors import InputError
from inercal.estimation.uncertainty import COVERAGE
from inercal.estimation.uncertainty.components import scatter_limits
from inercal.estimation.uncertainty.conformity import expanded_uncertainty
from inercal.laboratory.repeatability.session_findings import findings, single_scatter_lines
from inercal.laboratory.repeatability.session_fit import SessionFit, fit_sessions
from inercal.laboratory.repeatability.sessions import (
    MatchedSessions,
    NamedEffect,
    Owner,
    RepeatedSession,
    Scope,
    match_sessions,
    named_effects,
    scatter,
)


@dataclass(frozen=True, eq=False)
class ScatterComponent:
    """A component of the scatter between sessions, in SI units.

    Parameters
    ----------
    effect : NamedEffect
    sd, low, high : float
        Standard deviation and its limits with 95.45 % coverage.
    dof : int
    """

    effect: NamedEffect
    sd: float
    low: float
    high: float
    dof: int


@dataclass(frozen=True, eq=False)
class StatedUncertainty:
    """The stated uncertainty of p values, in SI units.

    Parameters
    ----------
    scatter_std : (p,) array
        Standard uncertainty u_A due to scatter.
    shared_std : (p,) array
        Standard uncertainty u_B due to errors that sessions share.
    dof : (p,) array
        Degrees of freedom of u_A.
    expanded : (p,) array
        Expanded uncertainty U with 95.45 % coverage.
    covariance : (p, p) array
        Covariance with U/2 as standard uncertainties, for readers that only use a covariance.
    """

    scatter_std: Array
    shared_std: Array
    dof: Array
    expanded: Array
    covariance: Array


@dataclass(frozen=True, eq=False)
class Repeatability:
    """The results of repeated sessions of a sensor.

    Parameters
    ----------
    fit : SessionFit
        The sessions, converted to the same frame and form, with their scatter.
    values : (p,) array
        Means of the coefficients `matched.names`, SI.
    scope : "day" or "turn-on"
        What changes before the next use: the day, or only the turn-on.
    mount_owner : "sensor" or "bench"
        Whether the next use includes a new mounting.
    mean, next_use : StatedUncertainty
    scatter : (p, p) array
        Covariance that the next use adds to the covariance of the mean, SI.
    components : tuple of ScatterComponent
    """

    fit: SessionFit
    values: Array
    scope: Scope
    mount_owner: Owner
    mean: StatedUncertainty
    next_use: StatedUncertainty
    scatter: Array
    components: tuple[ScatterComponent, ...]

    @property
    def matched(self) -> MatchedSessions:
        """The sessions, converted to the same frame and form."""
        return self.fit.matched

    @cached_property
    def findings(self) -> tuple[str, ...]:
        """Text lines on disagreements between the sessions, and on assumptions."""
        pooled = np.diag(_pooled_scatter(self.fit, self.scope))
        own = np.flatnonzero(_scatter_alone(self.fit) > pooled).tolist()
        return (*findings(self.fit, self.mount_owner), *single_scatter_lines(self.fit, pooled, own))

    @property
    def run_to_run(self) -> Array:
        """Covariance of a session about the mean, (p, p), SI, without the session's own u.

        This covariance includes the scatter of the next use, and effects of the bench such as a new
        mounting.
        """
        effects = self.fit.effects
        others = [not one.is_in_next_use(self.scope) for one in effects]
        return self.scatter + scatter(effects, self.fit.variances.variance, others, len(self.names))

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the coefficients."""
        return self.matched.names


def repeat(
    sessions: Sequence[RepeatedSession], *, scope: Scope = "day", mount_owner: Owner = "bench"
) -> Repeatability:
    """Return the mean of a sensor over its sessions and the uncertainty of its next use.

    Parameters
    ----------
    sessions : sequence of RepeatedSession
        Two or more sessions; all are converted to the frame and form of the last session.
    scope : "day" or "turn-on"
        Whether the next use is on another day, or after another turn-on on the same day.
    mount_owner : "sensor" or "bench"
        Whether the rotation of a new mounting is part of the next use, or belongs to the bench.

    Raises
    ------
    InputError
        If the calibrations cannot be compared, or the sessions do not show how the sensor scatters
        from one use of this scope to the next.
    """
    matched = match_sessions(sessions)
    days, turn_ons = int(matched.level(0).max()) + 1, int(matched.level(2).max()) + 1
    if scope == "day" and days < 2:
        raise InputError(
            "all sessions are from one day, so they cannot show how the sensor scatters from "
            "day to day; add sessions from other days, or ask for the next turn-on on the same "
            "day (--next turn-on)",
            key="--next",
        )
    if scope == "turn-on" and turn_ons < 2:
        raise InputError(
            "all sessions are from one turn-on, so they cannot show how the sensor scatters; "
            "add sessions after other turn-ons",
            key="--next",
        )
    effects = named_effects(matched, mount_owner)
    return _state(fit_sessions(matched, effects), scope, mount_owner)


def _state(fit: SessionFit, scope: Scope, mount_owner: Owner) -> Repeatability:
    """Return the statements on the mean and on the next use from the fitted sessions."""
    dof = fit.similar * (_count_of_scope(fit.matched, scope) - 1)
    next_use = _next_use_scatter(fit, scope)
    spread = _spread_ratio(fit)
    mean = fit.inverse * np.outer(spread, spread)
    components = tuple(_component(fit, k) for k in range(len(fit.effects)))
    return Repeatability(
        fit=fit,
        values=fit.mean * fit.unit,
        scope=scope,
        mount_owner=mount_owner,
        mean=_statement(fit, mean, dof),
        next_use=_statement(fit, next_use + mean, dof),
        scatter=next_use * np.outer(fit.unit, fit.unit),
        components=components,
    )


def _count_of_scope(matched: MatchedSessions, scope: Scope) -> int:
    days, turn_ons = (int(matched.level(which).max()) + 1 for which in (0, 2))
    return days if scope == "day" or days == turn_ons else turn_ons - days + 1


def _next_use_scatter(fit: SessionFit, scope: Scope) -> Array:
    """Return the covariance of the next use, (p, p), in the units of the fit.

    For a coefficient that scatters more than similar coefficients, its own variance is used.
    """
    size = len(fit.unit)
    pooled = _pooled_scatter(fit, scope)
    alone = _scatter_alone(fit)
    diagonal = np.diag(pooled)
    ratio = np.divide(np.maximum(diagonal, alone), diagonal, out=np.ones(size), where=diagonal > 0)
    found: Array = pooled * np.sqrt(np.outer(ratio, ratio))
    found[np.diag_indices(size)] = np.maximum(diagonal, alone)
    return found


def _pooled_scatter(fit: SessionFit, scope: Scope) -> Array:
    """Return the covariance of the next use from common variances of similar axes, (p, p)."""
    chosen = [one.is_in_next_use(scope) for one in fit.effects]
    pooled = scatter(fit.effects, fit.variances.variance, chosen, len(fit.unit))
    return pooled / np.outer(fit.unit, fit.unit)


def _scatter_alone(fit: SessionFit) -> Array:
    """Return each coefficient's variance from its own values, (p,), in units of the fit.

    The variance is zero in four cases: if several sessions are from the same day; for misalignments
    that a mounting changes, if the mounting belongs to the bench; if the sessions' own
    uncertainties explain the scatter; or if one session has much more weight than the others.
    """
    if not fit.has_other_days:
        return np.zeros(len(fit.unit))
    counts = fit.alone.counts_in_next_use.copy()
    for number, one in enumerate(fit.effects):
        if one.owner == "bench" or number in fit.unseen:
            counts[list(one.places)] = False
    return np.where(counts, fit.alone.variance, 0.0)


def _spread_ratio(fit: SessionFit) -> Array:
    """Return √max(1, q) of each coefficient, from similar axes or from its own values.

    The coefficient's own values are used if the uncertainties of the sessions do not explain the
    scatter of these values.
    """
    ratio = np.ones(len(fit.unit))
    if not fit.has_other_days:
        return ratio
    q = ((fit.values - fit.mean) ** 2 / fit.variance).sum(axis=0) / (len(fit.values) - 1)
    for places in fit.groups.values():
        picks = list(places)
        own = np.where(fit.alone.counts[picks], q[picks], 1.0)
        ratio[picks] = np.sqrt(np.maximum(1.0, np.maximum(q[picks].mean(), own)))
    return ratio


def _statement(fit: SessionFit, scattered: Array, dof: Array) -> StatedUncertainty:
    u_a, u_b = np.sqrt(np.diag(scattered)), np.sqrt(np.diag(fit.shared))
    enlarged = expanded_uncertainty(u_a, dof)
    expanded = np.hypot(enlarged, COVERAGE * u_b)
    by = expanded_uncertainty(np.ones(len(dof)), dof) / COVERAGE
    covariance = scattered * np.outer(by, by) + fit.shared
    unit = fit.unit
    return StatedUncertainty(
        u_a * unit, u_b * unit, dof, expanded * unit, covariance * np.outer(unit, unit)
    )


def _component(fit: SessionFit, k: int) -> ScatterComponent:
    effect, variances = fit.effects[k], fit.variances
    dof = effect.similar * (effect.effect.levels - 1)
    limits = scatter_limits(float(variances.variance[k]), float(variances.covariance[k, k]), dof)
    return ScatterComponent(effect, limits.sd, limits.low, limits.high, dof)


RELATIVE = 0.3  # desired relative standard deviation of σ
_PLURAL = {"session": "sessions", "day": "days", "turn-on": "turn-ons", "mount": "mountings"}
_LONGEST = 4.0  # λ above which longer sessions help more than more sessions


def required_sessions(noise_ratio: float, similar: int, relative: float = RELATIVE) -> int:
    """Return the number of sessions needed for a relative standard deviation of σ.

    Parameters
    ----------
    noise_ratio : float
        Ratio λ.
    similar : int
        Number m of similar axes.

    Examples
    --------
    >>> [required_sessions(x, similar=1) for x in (0.0, 0.25, 1.0)]
    [7, 10, 24]
    >>> [required_sessions(x, similar=3) for x in (0.0, 0.25, 1.0)]
    [3, 4, 9]
    """
    return 1 + ceil((1 + noise_ratio) ** 2 / (2 * relative**2 * similar) - 1e-9)


def noise_ratio(found: Repeatability, one: ScatterComponent) -> float:
    """Return the ratio λ of a component; infinite if no scatter was found."""
    places = list(one.effect.places)
    own = np.diagonal(found.matched.own, axis1=1, axis2=2)[:, places].mean()
    shape = one.effect.effect.shape[places]
    scatter = one.sd**2 * float(np.sum(shape**2)) / len(places)
    return float(own / scatter) if scatter > 0 else float("inf")


def advice_lines(found: Repeatability) -> list[str]:
    """Return text lines on how to determine the scatter better."""
    lines: list[str] = []
    for number, one in enumerate(found.components):
        if number in found.fit.unseen:
            continue  # a finding already names this component
        ratio, what = noise_ratio(found, one), f"{one.effect.name} ({one.effect.level})"
        if one.sd == 0:
            lines.append(f"{what}: the sessions scatter no more than their uncertainties explain")
        elif ratio > _LONGEST:
            lines.append(
                f"{what}: longer sessions would determine this scatter better than more sessions"
            )
        elif (needed := required_sessions(ratio, one.effect.similar)) > one.effect.effect.levels:
            lines.append(
                f"{what}: {needed} {_PLURAL[one.effect.level]} are needed to know the standard "
                f"deviation within {100 * RELATIVE:.0f} %; there are "
                f"{one.effect.effect.levels}"
            )
    return lines
