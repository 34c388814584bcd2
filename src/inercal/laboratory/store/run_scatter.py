"""Estimate a sensor's scatter from run to run from its other calibrations in the register."""

from collections.abc import Collection

import numpy as np

from inercal.calibration.comparison import build_comparison
from inercal.calibration.comparison.courses import fit_course
from inercal.calibration.comparison.run_to_run import RunScatter, RunToRun, against_scatter
from inercal.laboratory.store.history import CoefficientTrend, SensorHistory

LEAST = 3
"""Least number of other calibrations that the scatter of a coefficient is estimated from."""


def run_scatter(history: SensorHistory, without: Collection[int]) -> RunScatter | None:
    """Return the scatter τ of each coefficient; None if there are too few calibrations.

    Parameters
    ----------
    history : SensorHistory
    without : collection of int
        Numbers of the calibrations that are being compared and are therefore excluded.
    """
    kept = {k for k, one in enumerate(history.entries) if one.id not in without}
    names: list[str] = []
    found: list[tuple[float, float]] = []
    for trend in history.trends:
        scatter = _scatter(trend, kept)
        if scatter is not None:
            names.append(trend.name)
            found.append(scatter)
    if not names:
        return None
    variance, dof = np.array(found).T
    source = f"{len(kept)} other calibrations in the register"
    return RunScatter(source, tuple(names), np.diag(variance), dof)


def newest_run_to_run(history: SensorHistory) -> RunToRun | None:
    """Compare the newest calibration with the previous one; earlier ones give the scatter."""
    if len(history.entries) < LEAST + 2:
        return None
    scatter = run_scatter(history, [one.id for one in history.entries[-2:]])
    if scatter is None:
        return None
    return against_scatter(build_comparison(*history.calibrations[-2:]), scatter)


def _scatter(trend: CoefficientTrend, kept: Collection[int]) -> tuple[float, float] | None:
    """Return τ² and its degrees of freedom; None if there are too few calibrations."""
    first = len(trend.points) - len(trend.shared)
    places = [k for k in range(first, len(trend.points)) if trend.points[k] in kept]
    if len(places) < LEAST:
        return None
    at = [k - first for k in places]
    time = trend.time[places]
    drifts = trend.courses is not None and trend.courses.drifts and np.ptp(time) > 0
    course = fit_course(
        time,
        trend.values[places],
        trend.independent_variance[at],
        trend.shared[np.ix_(at, at)],
        slope=bool(drifts),
    )
    return course.tau**2, float(course.dof)
