"""Make the control charts of a check standard from its sessions.

The first m days are the reference. They give the mean, and the scatter as a sum of components
(`repeatability`). The limits use Student's t and F with the degrees of freedom of the reference,
and include the error of the mean. For one coefficient, this is the textbook limit t_{m−1} S √(1 +
1/m), pooled over similar axes.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from inercal.basics.arrays import Array
from inercal.basics.errors import InputError
from inercal.basics.units import format_count
from inercal.estimation.uncertainty.components import variance_components
from inercal.estimation.uncertainty.control_charts import (
    KINDS,
    ChartKind,
    ChartLimits,
    ChartValues,
    LastingKind,
    chart_limits,
    chart_values,
)
from inercal.estimation.uncertainty.mean_shift import largest_mean_shift
from inercal.laboratory.check_standard.day_points import DayPoints, day_points
from inercal.laboratory.repeatability.session_fit import SessionFit, fit_sessions
from inercal.laboratory.repeatability.sessions import (
    MatchedSessions,
    RepeatedSession,
    match_sessions,
    named_effects,
    scatter,
)

REFERENCE_DAYS = 20
LEAST_DAYS = 5
RUN_LENGTH = 370.0
_CHANCE = 0.01  # largest probability that a reference without a change is said to have one


@dataclass(frozen=True, eq=False)
class CheckedSession:
    """A session of the check standard, with the time of measurement in ISO 8601."""

    session: RepeatedSession
    measured: str


@dataclass(frozen=True)
class CheckPoint:
    """A day of the check standard after the reference.

    Parameters
    ----------
    first, last : str
        Times of the first and the last session, ISO 8601.
    labels : tuple of str
        Labels of the sessions.
    signals : mapping of ChartKind to tuple of str
        Charts that give a signal, with the coefficients. T² and MEWMA do not name coefficients.
    """

    first: str
    last: str
    labels: tuple[str, ...]
    signals: dict[ChartKind, tuple[str, ...]]

    @property
    def in_control(self) -> bool:
        """Whether no chart gives a signal."""
        return not self.signals


@dataclass(frozen=True)
class Episode:
    """A period in which the bench is doubtful.

    Parameters
    ----------
    since : str
        Time of the last session in control before the period, ISO 8601.
    until : str or None
        Time of the first session in control after the period; None if the period has not ended.
    """

    since: str
    until: str | None

    def holds(self, time: str) -> bool:
        """Return whether a time, ISO 8601, is within the period."""
        return self.since < time and (self.until is None or time < self.until)


@dataclass(frozen=True)
class ReferenceShift:
    """A change of a coefficient within the reference, which chance does not explain.

    Parameters
    ----------
    name : str
        Name of the coefficient.
    since, until : str
        Times of the last session before the change and of the first session after it, ISO 8601.
    shift : float
        Change of the mean, SI.
    ratio : float
        Change divided by the scatter from day to day apart from the change.
    probability : float
        Probability of such a change by chance.
    """

    name: str
    since: str
    until: str
    shift: float
    ratio: float
    probability: float


@dataclass(frozen=True, eq=False)
class ControlCharts:
    """The charts of a check standard.

    Parameters
    ----------
    matched : MatchedSessions
    fit : SessionFit
        Fit of the reference.
    sessions : tuple of CheckedSession
    days : DayPoints
        All days, including the days of the reference.
    reference_days : int
    limits : ChartLimits
    values : ChartValues
        Chart values of the days after the reference.
    points : tuple of CheckPoint
        Points of the days after the reference.
    dof : (p,) array
    joint_dof : float
    """

    matched: MatchedSessions
    fit: SessionFit
    sessions: tuple[CheckedSession, ...]
    days: DayPoints
    reference_days: int
    limits: ChartLimits
    values: ChartValues
    points: tuple[CheckPoint, ...]
    dof: Array
    joint_dof: float

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the charted coefficients."""
        return self.matched.names

    @property
    def reference_end(self) -> str:
        """Time of the last session in the reference, ISO 8601."""
        last = self.days.sessions[self.reference_days - 1]
        return max(self.sessions[k].measured for k in last)

    @property
    def in_control(self) -> bool | None:
        """Whether the last day is in control; None if there is no day after the reference."""
        return self.points[-1].in_control if self.points else None

    @property
    def reference_shift(self) -> ReferenceShift | None:
        """The largest change of a coefficient within the reference; None if chance explains it.

        Coefficients with an effect that several days share, such as a mounting, are not tested.
        """
        m = self.reference_days
        steps = {k for e in self.fit.effects if e.effect.levels < m for k in e.places}
        tested = [k for k in range(len(self.names)) if k not in steps]
        if not tested:
            return None
        variance = np.diagonal(self.days.point, axis1=1, axis2=2)[:m, tested]
        found = largest_mean_shift(self.days.difference[:m, tested], variance)
        if found.probability > _CHANCE:
            return None
        k, last = tested[found.column], self.days.sessions
        values = self.days.difference[:m, k]
        parts = values[: found.place], values[found.place :]
        within = np.sqrt(sum(float(np.sum((one - one.mean()) ** 2)) for one in parts) / (m - 2))
        return ReferenceShift(
            self.names[k],
            max(self.sessions[one].measured for one in last[found.place - 1]),
            min(self.sessions[one].measured for one in last[found.place]),
            found.shift * float(self.fit.unit[k]),
            abs(found.shift) / float(within),
            found.probability,
        )

    @property
    def episodes(self) -> tuple[Episode, ...]:
        """The periods in which the bench is doubtful, oldest first."""
        days = [(one.first, one.last, one.in_control) for one in self.points]
        return doubtful_episodes(self.reference_end, days)


def doubtful_episodes(
    reference_end: str, days: Iterable[tuple[str, str, bool]]
) -> tuple[Episode, ...]:
    """Return the periods between the last day in control and the next day in control.

    Parameters
    ----------
    reference_end : str
        End of the reference, ISO 8601.
    days : iterable of (str, str, bool)
        First and last session of each day after the reference, and whether this day is in control.
    """
    found: list[Episode] = []
    since, doubtful = reference_end, False
    for first, last, in_control in days:
        if in_control:
            if doubtful:
                found.append(Episode(since, first))
            since, doubtful = last, False
        else:
            doubtful = True
    return (*found, Episode(since, None)) if doubtful else tuple(found)


def control_charts(
    sessions: Sequence[CheckedSession],
    *,
    reference: int = REFERENCE_DAYS,
    run_length: float = RUN_LENGTH,
    restarts: Sequence[str] = (),
    lasting: LastingKind = "EWMA",
) -> ControlCharts:
    """Return the control charts of a check standard.

    Parameters
    ----------
    sessions : sequence of CheckedSession
        Sessions in any order; the charts follow their times.
    reference : int
        Number of days that form the reference.
    run_length : float
        In-control run length of all charts together, in days.
    restarts : sequence of str
        Times of corrective actions, ISO 8601. EWMA and MEWMA restart after each action.
    lasting : "EWMA" or "CUSUM"
        Chart for detecting small lasting changes of each coefficient.

    Raises
    ------
    InputError
        If the calibrations cannot be compared, if the reference is too short or has more days than
        the sessions, or if the run length is not possible.
    """
    require_settings(reference, run_length)
    sessions = sorted(sessions, key=lambda one: one.measured)
    matched = match_sessions([one.session for one in sessions])
    level = matched.level(0)
    days = int(level.max()) + 1
    if days < reference:
        raise InputError(
            f"the check standard has {format_count(days, 'day')}, but the reference needs "
            f"{reference}; measure it on more days, or give a shorter --reference",
            key="--reference",
        )
    if np.any(np.diff(level) < 0):
        raise InputError("the sessions of a day must be next to each other; sort them by time")
    chosen = np.flatnonzero(level < reference).tolist()
    first = matched.subset(chosen)
    fit = fit_sessions(first, named_effects(first, "bench"))
    points = day_points(matched, fit, chosen, _widening(fit))
    dof = _degrees_of_freedom(fit, reference)
    joint = float(sum(one.similar * (one.effect.levels - 1) for one in fit.effects))
    limits = chart_limits(run_length, dof, joint, lasting)
    later = slice(reference, None)
    begins = [max(sessions[k].measured for k in of_day) for of_day in points.sessions[later]]
    values = chart_values(
        points.difference[later],
        points.point[later],
        points.reference[later],
        [first_after(begins, time) for time in restarts],
        lasting,
    )
    return ControlCharts(
        matched, fit, tuple(sessions), points, reference, limits, values,
        _check_points(sessions, matched.names, points.sessions[later], values, limits),
        dof, joint,
    )  # fmt: skip


def require_settings(reference: int, run_length: float) -> None:
    """Raise an error if the reference is too short or the run length is not possible.

    Raises
    ------
    InputError
    """
    if reference < LEAST_DAYS:
        raise InputError(
            f"--reference {reference} is too short; the scatter can be estimated from "
            f"{LEAST_DAYS} days or more",
            key="--reference",
        )
    if not 10 <= run_length <= 1e6:
        raise InputError(
            f"--run-length {run_length:g} is not possible; give 10 to 1000000 days",
            key="--run-length",
        )


def first_after(times: Sequence[str], time: str) -> int:
    """Return the index of the first of some sorted times that is not before `time`."""
    return next((k for k, one in enumerate(times) if one >= time), len(times))


def _check_points(
    sessions: Sequence[CheckedSession],
    names: Sequence[str],
    days: Sequence[tuple[int, ...]],
    values: ChartValues,
    limits: ChartLimits,
) -> tuple[CheckPoint, ...]:
    signals = values.signals(limits)
    found: list[CheckPoint] = []
    for t, members in enumerate(days):
        beyond: dict[ChartKind, tuple[str, ...]] = {}
        for kind in KINDS:
            at = np.atleast_1d(signals[kind][t]) if kind in signals else np.zeros(1)
            if at.any():
                single = kind in ("Shewhart", limits.lasting_kind)
                beyond[kind] = (
                    tuple(names[k] for k in np.flatnonzero(at).tolist()) if single else ()
                )
        times = [sessions[k].measured for k in members]
        labels = tuple(sessions[k].session.label for k in members)
        found.append(CheckPoint(min(times), max(times), labels, beyond))
    return tuple(found)


def _degrees_of_freedom(fit: SessionFit, days: int) -> Array:
    """Return the degrees of freedom of each variance; a mounting has three random rotations."""
    dof = fit.similar * (days - 1)
    for one in fit.effects:
        if one.level == "mount":
            places = list(one.places)
            dof[places] = np.minimum(dof[places], one.similar * (one.effect.levels - 1))
    return dof


def _widening(fit: SessionFit) -> Array:
    """Return the factors by which coefficients scatter more than similar coefficients, (p,).

    The factor is 1 if several sessions are from the same day, because it is then unknown. It is
    also 1 for coefficients that a new mounting changes, because their scatter differs from axis to
    axis.
    """
    p = len(fit.unit)
    if not fit.has_other_days:
        return np.ones(p)
    effects = fit.effects
    pooled = scatter(effects, fit.variances.variance, [True] * len(effects), p)
    pooled = np.diag(pooled) / fit.unit**2
    moved = {k for one in effects if one.level == "mount" for k in one.places}
    std = np.sqrt(np.diagonal(fit.own, axis1=1, axis2=2))
    alone = np.array([
        0.0 if k in moved
        else variance_components(fit.values[:, k], std[:, k]).within.sd ** 2
        for k in range(p)
    ])  # fmt: skip
    ratio = np.divide(np.maximum(pooled, alone), pooled, out=np.ones(p), where=pooled > 0)
    return np.sqrt(ratio)
