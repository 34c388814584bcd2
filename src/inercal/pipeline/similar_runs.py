"""Calibrate recordings of the same form, which are read one by one but solved together.

The trials of the problem are the recordings. Each trial has the search, the observability and the
score tests that it would have alone, so its calibration is the same. A recording is solved alone if
its form differs from that of the others, or if a violation makes further fits necessary.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from inercal.basics.arrays import Array
from inercal.estimation import Estimate
from inercal.methods.solving import solve_each
from inercal.physics.plan import Hold
from inercal.pipeline.outcome import Outcome
from inercal.pipeline.run_calibration import ObservedRun, calibrate_run, observed
from inercal.recordings import Observations
from inercal.runfile import Run

_METHODS = ("six_position", "ferraris", "rates_and_poses", "centrifuge_norm")


@dataclass(frozen=True, eq=False, kw_only=True)
class _SimilarObservations(Observations):
    """Observations from several recordings, with all covariances, (trials, r m, r m)."""

    whole: Array
    correlated: bool

    @property
    def between_rows(self) -> Array | None:
        """Tells only whether rows have a covariance; `whole` contains its values."""
        return np.zeros(0) if self.correlated else None

    @property
    def full_covariance(self) -> Array:
        """Covariance of all readings, (trials, r m, r m)."""
        return self.whole


def calibrate_similar(runs: Sequence[Callable[[], Run]]) -> Iterator[Outcome | Exception]:
    """Yield the outcome of each run, or the error that `inercal.calibrate` would raise.

    Parameters
    ----------
    runs : sequence of callable
        Functions that read and check a run. All recordings are in memory together.
    """
    seen = [_observed(run) for run in runs]
    solutions = _solutions([one for one in seen if isinstance(one, ObservedRun)])
    for one in seen:
        try:
            if isinstance(one, Exception):
                yield one
            else:
                yield calibrate_run(one.stated, seen=one, solution=solutions.get(id(one)))
        except Exception as error:
            yield error


def _observed(run: Callable[[], Run]) -> ObservedRun | Exception:
    try:
        return observed(run())
    except Exception as error:
        return error


def _solutions(seen: Sequence[ObservedRun]) -> dict[int, Estimate]:
    """Return the solutions that were found together, by the identity of the observed run."""
    groups: list[list[ObservedRun]] = []
    for one in seen:
        if not _can_be_stacked(one):
            continue
        group = next((some for some in groups if _is_similar(some[0], one)), None)
        if group is None:
            groups.append(group := [])
        group.append(one)
    return {
        id(one): estimate
        for group in groups
        if len(group) > 1
        for one, estimate in zip(group, _solve_together(group), strict=False)
        if estimate is not None
    }


def _solve_together(group: Sequence[ObservedRun]) -> list[Estimate | None]:
    run, inputs = group[0].run, group[0].inputs
    stacked = _stacked([one.inputs.observations.without_drift for one in group])
    sensor = inputs.sensor_of_samples(run.sensor)
    return solve_each(lambda: run.solver()(stacked, sensor, run.bench, inputs.plan, run.priors))


def _can_be_stacked(one: ObservedRun) -> bool:
    rows, run = one.inputs.observations, one.run
    special = (one.thermal, one.inputs.bench, run.search, rows.transitions, rows.halves,
               rows.track, rows.common, rows.magnetic)  # fmt: skip
    warming = rows.temperature is not None and (
        rows.temperature_varies or run.sensor.uses("dT", "dTdt")
    )
    return run.method.name in _METHODS and not warming and all(s is None for s in special)


def _is_similar(one: ObservedRun, other: ObservedRun) -> bool:
    """Return whether two runs differ only in their means, the covariance of these, and times."""
    (a, b), (x, y) = (one.run, other.run), (one.inputs, other.inputs)
    rows, others = x.observations, y.observations
    rests = all(isinstance(step, Hold) for step in x.steps)  # their times only matter to a drift
    return (
        a.method is b.method
        and a.estimator == b.estimator
        and a.bench is b.bench
        and a.priors is b.priors
        and (a.sensor.axes, a.sensor.coefficients) == (b.sensor.axes, b.sensor.coefficients)
        and (x.plan, rows.labels, rows.channels) == (y.plan, others.labels, others.channels)
        and (rests or np.array_equal(rows.duration, others.duration))
        and (rests or np.array_equal(rows.time, others.time))
    )


def _stacked(rows: Sequence[Observations]) -> Observations:
    first, times = rows[0], np.stack([one.time for one in rows])
    return _SimilarObservations(
        first.labels,
        np.stack([one.mean for one in rows]),
        np.stack([one.covariance for one in rows]),
        first.duration,
        first.samples,
        times if np.ptp(times, axis=0).any() else first.time,
        first.channels,
        whole=np.stack([one.full_covariance for one in rows]),
        correlated=any(one.between_rows is not None for one in rows),
    )
