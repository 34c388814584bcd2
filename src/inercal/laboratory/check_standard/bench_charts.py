"""Chart a bench that has no check standard, from the bench errors that its runs determine.

Each bench parameter that runs determine (`inercal.calibration.shared_errors`) has a separate
Shewhart chart and EWMA or CUSUM chart, because runs with different methods determine different
parameters. The weighted mean q' of the runs on a day is one point. Its variance is its own variance
s² plus the day-to-day scatter τ². The reference consists of the first m days on which the parameter
was determined::

    z = (q' − μ)/√(τ² + s² + u²(μ)),   μ = Σ w q'/Σ w,   w = 1/(τ² + s²),   u²(μ) = 1/Σ w

τ² is estimated from the reference by restricted likelihood, and the limits use Student's t with m −
1 degrees of freedom. Runs also share errors of other bench parameters. These errors are the same on
all days and cancel in q' − μ, as long as the other parameters are not determined again.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from inercal.basics.arrays import Array
from inercal.basics.errors import InputError
from inercal.basics.units import format_count
from inercal.calibration.shared_errors import BenchEstimate
from inercal.estimation.uncertainty.control_charts import (
    ChartKind,
    ChartValues,
    LastingKind,
    chart_limit,
    chart_values,
    lasting_limit,
    wider_limit,
)
from inercal.estimation.uncertainty.repeated_measurements import restricted_variances
from inercal.laboratory.check_standard.charts import (
    LEAST_DAYS,
    REFERENCE_DAYS,
    RUN_LENGTH,
    Episode,
    doubtful_episodes,
    first_after,
    require_settings,
)

_KINDS = 2  # Shewhart, and EWMA or CUSUM


@dataclass(frozen=True)
class ChartedRun:
    """The bench estimates from a run, with the run's label and time of measurement (ISO 8601)."""

    label: str
    measured: str
    bench_estimates: tuple[BenchEstimate, ...]

    @property
    def day(self) -> str:
        """Day of the measurement, ISO 8601."""
        return self.measured.partition("T")[0]


@dataclass(frozen=True, eq=False)
class ParameterChart:
    """The charts of one bench parameter, in SI units.

    Parameters
    ----------
    name, unit, meaning : str
    days : tuple of str
        Time of the last run on each day, ISO 8601.
    values, std : (n,) arrays
        Bench estimate for each day, and its standard uncertainty without the day-to-day scatter.
    reference_days : int
        Number m of days in the reference.
    mean, mean_std, scatter : float
        Mean μ, its standard uncertainty u(μ), and the day-to-day scatter τ.
    shewhart, lasting : (n,) arrays
        z of all days, and the EWMA or CUSUM of all days, which is 0 within the reference.
    shewhart_limit, lasting_limit : float
    lasting_kind : "EWMA" or "CUSUM"
    """

    name: str
    unit: str
    meaning: str
    days: tuple[str, ...]
    values: Array
    std: Array
    reference_days: int
    mean: float
    mean_std: float
    scatter: float
    shewhart: Array
    lasting: Array
    shewhart_limit: float
    lasting_limit: float
    lasting_kind: LastingKind

    def signals(self, k: int) -> tuple[ChartKind, ...]:
        """Return the charts that give a signal on day k; none within the reference."""
        if k < self.reference_days:
            return ()
        found: list[ChartKind] = []
        if abs(self.shewhart[k]) > self.shewhart_limit:
            found.append("Shewhart")
        if abs(self.lasting[k]) > self.lasting_limit:
            found.append(self.lasting_kind)
        return tuple(found)


@dataclass(frozen=True)
class BenchDay:
    """A day after the reference of a parameter, with its last run and its signals by chart."""

    measured: str
    signals: dict[ChartKind, tuple[str, ...]]

    @property
    def in_control(self) -> bool:
        """Whether no chart gives a signal."""
        return not self.signals


@dataclass(frozen=True, eq=False)
class BenchCharts:
    """The charts of a bench.

    Parameters
    ----------
    bench : str
    runs : tuple of ChartedRun
    charts : tuple of ParameterChart
    too_few : mapping of str to int
        Parameters that have fewer days than the reference needs, and their number of days.
    run_length : float
        In-control run length of all charts together, in days.
    """

    bench: str
    runs: tuple[ChartedRun, ...]
    charts: tuple[ParameterChart, ...]
    too_few: dict[str, int]
    run_length: float

    @property
    def lasting_kind(self) -> LastingKind:
        """Kind of the chart for lasting changes: EWMA or CUSUM."""
        return self.charts[0].lasting_kind

    @property
    def single_run_length(self) -> float:
        """In-control run length (ARL₀) of each chart."""
        return self.run_length * _KINDS * len(self.charts)

    @property
    def points(self) -> tuple[BenchDay, ...]:
        """The days after a reference, in chronological order."""
        found: dict[str, dict[ChartKind, tuple[str, ...]]] = {}
        last: dict[str, str] = {}
        for chart in self.charts:
            for k in range(chart.reference_days, len(chart.days)):
                day = chart.days[k].partition("T")[0]
                last[day] = max(chart.days[k], last.get(day, ""))
                of_day = found.setdefault(day, {})
                for kind in chart.signals(k):
                    of_day[kind] = (*of_day.get(kind, ()), chart.name)
        return tuple(BenchDay(last[day], found[day]) for day in sorted(found))

    @property
    def in_control(self) -> bool | None:
        """Whether the last day is in control; None if no day follows the reference."""
        points = self.points
        return points[-1].in_control if points else None

    @property
    def episodes(self) -> tuple[Episode, ...]:
        """The periods in which the bench is doubtful; the oldest comes first."""
        first = min(one.days[one.reference_days - 1] for one in self.charts)
        days = [(one.measured, one.measured, one.in_control) for one in self.points]
        return doubtful_episodes(first, days)


def bench_charts(
    bench: str,
    runs: Sequence[ChartedRun],
    *,
    reference: int = REFERENCE_DAYS,
    run_length: float = RUN_LENGTH,
    restarts: Sequence[str] = (),
    lasting: LastingKind = "EWMA",
) -> BenchCharts:
    """Return the control charts of a bench.

    Parameters
    ----------
    bench : str
        Name of the bench, as printed.
    runs : sequence of ChartedRun
        Runs in chronological order.
    reference : int
        Number of days that form the reference of each parameter.
    run_length : float
        In-control run length of all charts together, in days.
    restarts : sequence of str
        Times of corrective actions, ISO 8601. The EWMA or CUSUM restarts after each action.
    lasting : "EWMA" or "CUSUM"
        Chart for detecting small lasting changes.

    Raises
    ------
    InputError
        If no parameter has enough days for the reference, or a setting is not possible.
    """
    require_settings(reference, run_length)
    names = list(dict.fromkeys(one.name for run in runs for one in run.bench_estimates))
    if not names:
        raise InputError(
            f"bench {bench}: none of {len(runs)} calibrations states bench estimates, because "
            "their data do not determine any parameter of the bench or the files are older "
            "than this feature; calibrate again",
            names=(bench,),
        )
    days = {name: _days_of(name, runs) for name in names}
    enough = [name for name in names if len(days[name]) >= reference]
    too_few = {name: len(days[name]) for name in names if name not in enough}
    if not enough:
        most = max(too_few.values())
        raise InputError(
            f"bench {bench}: {format_count(most, 'day')} with bench estimates, but the reference "
            f"needs {reference}; give a shorter --reference ({LEAST_DAYS} at least)",
            key="--reference",
        )
    single = run_length * _KINDS * len(enough)
    charts = tuple(
        _chart(name, days[name], reference, single, restarts, lasting) for name in enough
    )
    return BenchCharts(bench, tuple(runs), charts, too_few, run_length)


_Day = list[tuple[str, BenchEstimate]]


def _days_of(name: str, runs: Sequence[ChartedRun]) -> list[_Day]:
    found: dict[str, _Day] = {}
    for run in runs:
        for one in run.bench_estimates:
            if one.name == name:
                found.setdefault(run.day, []).append((run.measured, one))
    return [found[day] for day in sorted(found)]


def _chart(
    name: str,
    days: Sequence[_Day],
    m: int,
    run_length: float,
    restarts: Sequence[str],
    lasting: LastingKind,
) -> ParameterChart:
    times = tuple(max(time for time, _ in of_day) for of_day in days)
    values, std = (np.array(one) for one in zip(*map(_day_mean, days), strict=True))
    tau2, mean, mean_variance = _reference(values[:m], std[:m])
    variance = tau2 + std**2
    later = slice(m, None)
    shown: ChartValues = chart_values(
        (values[later] - mean)[:, None],
        variance[later][:, None, None],
        np.full((len(days) - m, 1, 1), mean_variance),
        [first_after(times[m:], time) for time in restarts],
        lasting,
    )
    # A point within the reference contributes to the mean.
    of_reference = np.sqrt(np.maximum(variance[:m] - mean_variance, 1e-9 * variance[:m]))
    shewhart = wider_limit(chart_limit(run_length, 1.0, 1), 1, m - 1.0)
    newest = days[-1][-1][1]
    return ParameterChart(
        name, newest.unit, newest.meaning, times, values, std, m, mean,
        float(np.sqrt(mean_variance)), float(np.sqrt(tau2)),
        np.concatenate([(values[:m] - mean) / of_reference, shown.shewhart[:, 0]]),
        np.concatenate([np.zeros(m), shown.lasting[:, 0]]),
        float(np.sqrt(shewhart)), float(np.sqrt(lasting_limit(run_length, m - 1.0, lasting))),
        lasting,
    )  # fmt: skip


def _day_mean(of_day: _Day) -> tuple[float, float]:
    """Return the weighted mean of the runs on a day, and its standard uncertainty."""
    weight = np.array([one.own_std**-2 for _, one in of_day])
    value = np.array([one.value for _, one in of_day])
    return float(weight @ value / weight.sum()), float(weight.sum() ** -0.5)


def _reference(values: Array, std: Array) -> tuple[float, float, float]:
    """Estimate τ², μ and u²(μ) of the reference."""
    unit = float(np.sqrt(np.var(values, ddof=1) + np.mean(std**2)))
    y, own = (values - values.mean()) / unit, np.diag((std / unit) ** 2)
    found = restricted_variances(
        y, np.ones((y.size, 1)), own, (np.eye(y.size),), np.array([0.5 * float(np.var(y, ddof=1))])
    )
    tau2 = float(found.variance[0]) * unit**2
    weight = 1 / (tau2 + std**2)
    return tau2, float(weight @ values / weight.sum()), float(1 / weight.sum())
