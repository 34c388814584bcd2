"""Find the date of the next calibration by the methods of ILAC-G24:2022 (OIML D 10).

A limit is either the tolerance of a coefficient ([specification.limits] of its newest calibration)
or the largest U that a user accepts. The newest calibration gave the value y with its own variance
s². At a time Δt after this calibration, the expanded uncertainty U and the expected value e of a
coefficient are::

    U²(Δt) = t_ν² (2τ² + s² + q Δt + u_b² Δt²) + 4 u_B²,   e(Δt) = y + b Δt

τ is the scatter of calibrations; it counts twice, because it affects both the calibration and the
later use. q is the variance per year of a random walk, and b ± u_b is the drift per year (0 ± u_b
if no drift is found). u_B is the uncertainty that calibrations share.

prediction
    The longest Δt for which U(Δt) + |b| Δt stays within the limit of U or, for a tolerance, for
    which the coefficient is within the tolerance with a probability of at least 95 %.
chart
    The time in which the newest value would reach the limit, at the largest yearly change observed
    between two calibrations.
staircase
    The last interval times 1.1 if the newest calibration found the coefficient within its limit,
    and otherwise times 0.45. In the long run, 89 % of the results are then within the limit.
time in use
    The prediction over operating hours instead of years, if three calibrations state them
    ([job] operating_hours).

The date follows from the prediction, but the house rule limits the interval to twice the longest
interval so far. If a sensor has fewer than five calibrations, U(Δt) and the largest yearly change
come from the sensors of its type (`type_pool`), unless its own calibrations scatter more.
"""

# scipy has no type stubs.
# pyright: reportMissingTypeStubs=false

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import floor, inf, isfinite
from typing import cast

import numpy as np
import scipy

from inercal.basics.errors import InputError
from inercal.basics.keys import CoefficientName
from inercal.basics.units import format_count, parse_quantity
from inercal.calibration.comparison.changes import YEAR
from inercal.calibration.comparison.courses import LEAST_FOR_DRIFT
from inercal.estimation.uncertainty import COVERAGE
from inercal.estimation.uncertainty.conformity import conformance_probability
from inercal.laboratory.store.history import CoefficientTrend, SensorHistory
from inercal.laboratory.store.type_pool import PooledChange, TypePool
from inercal.physics.sensors.coefficient_selection import select_coefficients

PROBABILITY = 0.95
"""Probability that a coefficient is within its tolerance at the end of an interval."""
LONGER, SHORTER = 1.1, 0.45
_LONGEST_RATIO = 2.0
_HORIZON = 100.0  # years
_LEAST = 3  # least number of calibrations for a prediction without others
_HOUR, _DAY = 3600.0, 86_400.0


@dataclass(frozen=True)
class CoefficientLimit:
    """A limit of a coefficient, in SI units.

    Parameters
    ----------
    lower, upper : float
        Ends of the tolerance; infinite if there is no tolerance.
    expanded : float
        Largest U; infinite if none is stated.
    """

    lower: float = -inf
    upper: float = inf
    expanded: float = inf


@dataclass(frozen=True)
class CoefficientInterval:
    """The intervals of one coefficient, in years; None if a method has too few data.

    Parameters
    ----------
    name : str
    limit : CoefficientLimit
    prediction, chart, staircase : float or None
    hours : float or None
        Interval by the method "time in use", in hours.
    sensors : int
        Number of sensors from which prediction and chart are pooled; 0 if they come from the
        sensor's own calibrations.
    is_apart : bool
        Whether the sensor's similar axes change more than those of the other sensors of its type.
        If so, no pool is used.
    expanded : float or None
        U predicted for a use just after the newest calibration, SI; None if there is no prediction.
    """

    name: str
    limit: CoefficientLimit
    prediction: float | None
    chart: float | None
    staircase: float | None
    hours: float | None = None
    sensors: int = 0
    is_apart: bool = False
    expanded: float | None = None


@dataclass(frozen=True, eq=False)
class Recalibration:
    """The date of the next calibration, and how it was found.

    Parameters
    ----------
    history : SensorHistory
    rows : tuple of CoefficientInterval
        The intervals of each coefficient that has a limit.
    longest : float
        Twice the longest interval so far, years.
    in_use : float or None
        Fraction of the time during which the sensor is in use.
    pool : TypePool or None
        The sensors of the same type from which rows are pooled, if any.
    """

    history: SensorHistory
    rows: tuple[CoefficientInterval, ...]
    longest: float
    in_use: float | None = None
    pool: TypePool | None = None

    @property
    def years(self) -> float | None:
        """The interval in years; None if no prediction can be made."""
        found = [one.prediction for one in self.rows if one.prediction is not None]
        return min(*found, self.longest, inf) if found else None

    @property
    def decided_by(self) -> str:
        """The coefficient with the shortest prediction, or "house rule"; empty without a date."""
        known = [one for one in self.rows if one.prediction is not None]
        if not known:
            return ""
        first = min(known, key=lambda one: one.prediction or 0.0)
        return first.name if (first.prediction or 0.0) <= self.longest else "house rule"

    @property
    def date(self) -> str | None:
        """The date of the next calibration, ISO 8601."""
        if self.years is None:
            return None
        whole = floor(self.years * YEAR / _DAY) * _DAY / YEAR
        return self.history.date(self._newest + whole).partition("T")[0]

    @property
    def hours_in_use(self) -> float | None:
        """The interval in hours of use; None if the fraction of the time in use is not stated."""
        if self.years is None or self.in_use is None:
            return None
        return self.years * YEAR / _HOUR * self.in_use

    @property
    def operating_hours(self) -> float | None:
        """Operating hours at which to calibrate the sensor; None if they are not known."""
        hours = self.history.operating_hours
        found = [one.hours for one in self.rows if one.hours is not None]
        known = [one for one in hours if one is not None]
        if not found or hours[-1] is None:
            return None
        return hours[-1] + min(*found, _LONGEST_RATIO * float(np.diff(known).max()))

    @property
    def _newest(self) -> float:
        return max(float(one.time[-1]) for one in self.history.trends)


def needs_pool(history: SensorHistory) -> bool:
    """Return whether a sensor has too few calibrations to determine an interval from them."""
    return len(history.entries) < LEAST_FOR_DRIFT


def recalibration(
    history: SensorHistory,
    stated: Mapping[str, str] | None = None,
    in_use: float | None = None,
    pool: TypePool | None = None,
) -> Recalibration:
    """Find the date of the next calibration.

    Parameters
    ----------
    history : SensorHistory
    stated : mapping of str to str, optional
        Largest U by coefficient, group or axis, such as {"bias": "1 mg"}.
    in_use : float, optional
        Fraction of the time during which the sensor is in use, 0 to 1.
    pool : TypePool, optional
        Sensors of the same type, for a sensor that `needs_pool`.

    Raises
    ------
    InputError
        If a word selects no coefficient, a quantity has the wrong unit, or a pool is given but not
        needed.
    """
    if in_use is not None and not 0 < in_use <= 1:
        raise InputError("--in-use must be more than 0 and at most 100 %", key="--in-use")
    limits = coefficient_limits(history, stated or {})
    if pool is not None and not needs_pool(history):
        raise InputError(
            f"--like is not needed, because {history.sensor.name} has "
            f"{format_count(len(history.entries), 'calibration')} of its own; remove it",
            key="--like",
        )
    if (
        pool is not None
        and len(history.entries) < _LEAST
        and pool.sensors == (history.sensor.name,)
    ):
        pool = None  # two calibrations cannot distinguish scatter from drift
    hours = history.operating_hours
    rows = tuple(
        _interval(
            trend,
            limits[trend.name],
            None if pool is None else pool.changes.get(trend.name),
            [hours[k] for k in trend.points],
            history.sensor.name,
        )
        for trend in history.trends
        if trend.name in limits
    )
    gaps = [float(np.diff(one.time).max()) for one in history.trends if one.time.size > 1]
    if pool is not None and any(one.sensors for one in rows):
        gaps.append(pool.longest)
        used = {name for one in rows if one.sensors for name in pool.changes[one.name].members}
        pool = replace(pool, sensors=tuple(one for one in pool.sensors if one in used))
    else:
        pool = None
    return Recalibration(history, rows, _LONGEST_RATIO * max(gaps, default=0.0), in_use, pool)


def coefficient_limits(
    history: SensorHistory, stated: Mapping[str, str]
) -> dict[str, CoefficientLimit]:
    """Return the stated limits, or the tolerances of the newest calibration, by full name."""
    newest = history.entries[-1].calibration
    is_turned = history.calibrations[-1].frame != newest.frame  # the limits apply to this frame
    found = {
        one.name: CoefficientLimit(one.lower, one.upper)
        for one in (() if newest.conformity is None else newest.conformity.limits)
        if not (is_turned and CoefficientName(one.name).parts[1] in ("delta_o", "delta_p"))
    }
    names = {one.name for one in history.trends}
    for word, text in stated.items():
        chosen = [one for one in select_coefficients(newest.sensor.axes, [word]) if one in names]
        errors: list[InputError] = []
        fitting = 0
        for name in chosen:
            try:
                size = parse_quantity(text, newest.sensor.coefficient(name).unit)
            except InputError as error:
                errors.append(error)  # in a group, only coefficients with this unit get the limit
                continue
            if size.sd or size.value <= 0:
                raise InputError(
                    f"--limit {word}: {text!r} is not possible; give one positive quantity",
                    key="--limit",
                )
            found[name] = CoefficientLimit(expanded=size.value)
            fitting += 1
        if not fitting:
            if errors:
                raise errors[0].located(f"--limit {word}", key="--limit")
            raise InputError(
                f"--limit: this history has no {word}; it has {', '.join(sorted(names))}",
                key="--limit",
                names=(word,),
            )
    return found


def expanded_after(trend: CoefficientTrend, years: float) -> float:
    """Return U, SI, some years after the newest calibration, without the drift."""
    courses = trend.courses
    assert courses is not None  # `_interval`
    line = courses.line
    by_scatter = (
        2 * max(line.tau, courses.wandering_line.tau) ** 2
        + float(trend.independent_variance[-1])
        + courses.walk.walk * years
        + line.slope.std**2 * years**2
    )
    shared = COVERAGE**2 * float(trend.shared[-1, -1])
    return float(np.sqrt(line.factor**2 * by_scatter + shared))


def _interval(
    trend: CoefficientTrend,
    limit: CoefficientLimit,
    pooled: PooledChange | None,
    hours: Sequence[float | None],
    sensor: str,
) -> CoefficientInterval:
    gaps = np.diff(trend.time)
    apart = gaps > 0
    steps = np.abs(np.diff(trend.values))
    prediction = chart = staircase = expanded = None
    newest = float(trend.values[-1])
    is_apart = pooled is not None and sensor in pooled.apart
    if is_apart:
        pooled = None
    if pooled is not None or trend.courses is not None:
        prediction = _longest(trend, limit, pooled)
        expanded = _expanded(trend, pooled, 0.0)
    room = min(limit.expanded, limit.upper - newest, newest - limit.lower)
    rates = list(steps[apart] / gaps[apart]) + ([] if pooled is None else [pooled.rate])
    if rates and isfinite(room):
        rate = float(max(rates))
        chart = max(room, 0.0) / rate if rate > 0 else _HORIZON
    if apart.any():
        within = (
            float(steps[-1]) <= limit.expanded
            if isfinite(limit.expanded)
            else limit.lower <= newest <= limit.upper
        )
        staircase = float(gaps[apart][-1]) * (LONGER if within else SHORTER)
    used = _over_hours(trend, hours)
    return CoefficientInterval(
        trend.name, limit, prediction, chart, staircase,
        None if used is None else _longest(used, limit) * YEAR / _HOUR,
        0 if pooled is None else pooled.sensors, is_apart, expanded,
    )  # fmt: skip


def _over_hours(trend: CoefficientTrend, hours: Sequence[float | None]) -> CoefficientTrend | None:
    """Return a trend over years of operation; None if fewer than three times are known.

    The trend uses the newest calibrations, as far back as all state operating hours that do not
    decrease.
    """
    count = next((k for k, one in enumerate(reversed(hours)) if one is None), len(hours))
    count = min(count, len(trend.shared))
    known = np.array([one for one in hours[len(hours) - count :] if one is not None])
    if count < 3 or np.any(np.diff(known) < 0) or np.ptp(known) == 0:
        return None
    return replace(
        trend,
        points=trend.points[-count:],
        time=known * _HOUR / YEAR,
        values=trend.values[-count:],
        std=trend.std[-count:],
        step_std=trend.step_std[-(count - 1) :],
        shared=trend.shared[-count:, -count:],
    )


def _expanded(trend: CoefficientTrend, pooled: PooledChange | None, years: float) -> float:
    """Return U, SI, some years after the newest calibration, for the sensor or for its type."""
    if pooled is None:
        return expanded_after(trend, years)
    own, shared = float(trend.independent_variance[-1]), float(trend.shared[-1, -1])
    return pooled.expanded_after(own, shared, years)


def _longest(
    trend: CoefficientTrend, limit: CoefficientLimit, pooled: PooledChange | None = None
) -> float:
    """Return the longest interval of the prediction in years; 0 if the limit is exceeded now."""
    courses = trend.courses if pooled is None else None
    slope = courses.line.slope.slope if courses is not None and courses.drifts else 0.0

    def room(years: float) -> float:
        expanded = _expanded(trend, pooled, years)
        if isfinite(limit.expanded):
            return limit.expanded - expanded - abs(slope) * years
        value = np.array([trend.values[-1] + slope * years])
        inside = conformance_probability(
            value, np.array([expanded / COVERAGE]), np.array([limit.lower]), np.array([limit.upper])
        )
        return float(inside[0]) - PROBABILITY

    if room(0.0) <= 0:
        return 0.0
    if room(_HORIZON) > 0:
        return _HORIZON
    return cast("float", scipy.optimize.brentq(room, 0.0, _HORIZON, xtol=1e-4))
