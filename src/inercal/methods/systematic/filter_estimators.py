"""Systematic calibration by a Kalman filter, for a recording or during a live run.

Each pass starts with the coefficients from the pass before. The last estimate of a pass is also the
smoothed estimate, because the coefficients have no dynamics. The batch estimator uses more
information about a rest, namely its mean rate in all axes.

In a live run the samples of the first rests are stored until these rests determine the azimuth.
Then the filter processes them and everything that follows. There is only one pass, linearised about
the values from the first rests.
"""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from inercal.basics.arrays import Array
from inercal.basics.errors import InputError, NotObserved
from inercal.benches.turntable.bench import StillTable, Turntable
from inercal.benches.turntable.simulation import turntable_path_duration
from inercal.estimation import Estimate, ModelTest
from inercal.estimation.innovations import (
    StateEstimate,
    group_innovations,
    mean_and_whiteness_tests,
)
from inercal.methods import PartialEstimate, Priors
from inercal.methods.order_effects import with_tests_of_priors
from inercal.methods.systematic.alignment import attitudes_at, determines_azimuth
from inercal.methods.systematic.generalised_least_squares import LAG, require_turns
from inercal.methods.systematic.navigation import integrate_navigation
from inercal.methods.systematic.navigation_filter import (
    LIVE_CHUNK,
    FilterModel,
    FilterStart,
    NavigationFilter,
    filter_start,
)
from inercal.methods.systematic.segments import (
    FILTER_NOISE,
    MIN_RESTS,
    Indices,
    Segments,
    require_imu,
    segments_of_track,
)
from inercal.physics.plan import TableSteps
from inercal.physics.sensors import Sensor
from inercal.recordings import GAP_FACTOR, Track, join_tracks

_CHUNK = 100  # number of epochs that are processed together
_MOST_PASSES = 8
_SMALL_STEP = 0.05  # standard deviations
_LARGEST_SHARE = 0.25  # remaining share of the initial variance; a smaller one counts as determined
_NOTED_SHARE = 0.02
_NAMED_PART = 0.3  # smallest component of a direction for which a message names the coefficient


def solve_by_filter(
    track: Track, labels: tuple[str, ...], sensor: Sensor, known: StillTable, priors: Priors = ()
) -> Estimate:
    """Return the filter's estimate from one recording.

    Parameters
    ----------
    track : Track
        Track with numbered rests.
    labels : tuple of m str
        Labels of the rests.
    sensor : Sensor
        Three accelerometers, then three gyros, with noise and the selected coefficients.
    known : StillTable
    priors : sequence of Gaussian
        Priors on coefficients.

    Raises
    ------
    InputError
        The same as for `segments_of_track` and `attitudes_at`.
    NotObserved
        These rests and turns do not determine all coefficients.
    """
    segments = segments_of_track(track, labels, sensor, FILTER_NOISE)
    model = FilterModel(
        sensor, known, priors, segments.run[1] - segments.run[0], segments.dt, segments.means
    )
    start, p = filter_start(model, segments), len(sensor.coefficients)
    require_turns(_attitudes(model, segments, start.value), sensor, priors)
    made, converged, passes = _follow(model, start, segments, track), False, 1
    found = made.estimate()
    while not converged and passes < _MOST_PASSES:
        before, passes = found, passes + 1
        start = replace(start, value=before.value[:p], lag=float(before.value[p]))
        made = _follow(model, start, segments, track)
        found = made.estimate()
        step = (found.value - before.value)[: p + 1] / np.sqrt(
            np.diagonal(found.covariance)[: p + 1]
        )
        converged = bool(np.abs(step).max() < _SMALL_STEP)
    estimate = _estimate(made, model, start, converged, passes)
    return with_tests_of_priors(estimate, sensor, priors)


def _attitudes(model: FilterModel, segments: Segments, c: Array) -> Array:
    return attitudes_at(segments, model.imu, c, model.known.latitude.value)


def _follow(
    model: FilterModel, start: FilterStart, segments: Segments, track: Track
) -> NavigationFilter:
    """Return the filter after the recording, relative to the attitudes at all rests."""
    attitudes = _attitudes(model, segments, start.value)
    start = replace(start, attitude=attitudes[0], rest_attitudes=attitudes)
    made = NavigationFilter(model, start, _CHUNK, keeps_history=True)
    made.feed(track.reading, track.hold)
    made.finish()
    return made


def _estimate(
    made: NavigationFilter, model: FilterModel, start: FilterStart, converged: bool, passes: int
) -> Estimate:
    sensor, found = model.sensor, made.estimate()
    p = len(sensor.coefficients)
    exact = {"g": model.known.gravity.sd == 0, "latitude": model.known.latitude.sd == 0}
    names = (*sensor.coefficients, LAG, *(name for name, known in exact.items() if not known))
    every = (*sensor.coefficients, LAG, *exact)
    at = [every.index(name) for name in names]
    share = _require_determined(found, start, sensor)
    note = (
        f"Up to {100 * share:.2g} % of the information on a direction of the coefficients "
        "comes from the initial standard deviations of the filter, not from the data."
    )
    scaled = found.covariance[:p, :p] / np.outer(sensor.unit_scale, sensor.unit_scale)
    return Estimate(
        names=names,
        value=found.value[at],
        covariance=found.covariance[np.ix_(at, at)],
        chi2=np.asarray(made.nis),
        dof=made.components,
        wanted=sensor.coefficients,
        rank=p,
        singular_values=1 / np.sqrt(np.linalg.eigvalsh(scaled)),
        converged=np.asarray(converged),
        iterations=np.asarray(passes, dtype=np.intp),
        notes=(note,) if share > _NOTED_SHARE else (),
        courses=(made.history(),),
        tests=_innovation_tests(*made.standardised_innovations()),
    )


def _innovation_tests(standard: Array, rest: Indices) -> tuple[ModelTest, ...]:
    """Return the tests of innovations per rest, and of the first innovations, which judge turns.

    The first innovation of a rest contains the error of the turn before it. In the sum over all
    innovations that error would be too small to notice.
    """
    first = np.append(False, rest[1:] != rest[:-1])
    z = standard[first]
    turns = ModelTest("first innovations after each turn", float(np.sum(z**2)), z.size)
    return (
        turns,
        *mean_and_whiteness_tests(
            group_innovations(standard, rest),
            "mean innovations of each rest",
            "correlation of the innovations between rests",
        ),
    )


def _require_determined(found: StateEstimate, start: FilterStart, sensor: Sensor) -> float:
    """Raise NotObserved if directions are still as uncertain as before the data.

    Return the largest remaining share of the initial variance.
    """
    p = len(sensor.coefficients)
    share, directions = np.linalg.eigh(found.covariance[:p, :p] / np.outer(start.sd, start.sd))
    open_ = share > _LARGEST_SHARE
    if open_.any():
        part = np.abs(directions[:, open_]).max(axis=1) > _NAMED_PART
        names = tuple(n for n, named in zip(sensor.coefficients, part, strict=True) if named)
        raise NotObserved(
            f"the run determines only {p - int(open_.sum())} of {p} directions of the "
            f"coefficients; {', '.join(names)} remain undetermined. Add quarter turns about "
            "level axes and rests, leave coefficients out, or give priors",
            names,
            names=names,
        )
    return float(share.max())


class LiveNavigation:
    """The filter for a live run, which processes samples as they arrive.

    See `inercal.methods.Sequential`.

    Parameters
    ----------
    sensor : Sensor
    known : StillTable
    priors : sequence of Gaussian
    run_duration : float
        Planned duration of the run, s.
    rate_hz : float
        Samples per second.

    Raises
    ------
    InputError
        The sensor is not three accelerometers and three gyros.
    """

    def __init__(
        self, sensor: Sensor, known: StillTable, priors: Priors, run_duration: float, rate_hz: float
    ):
        require_imu(sensor)
        self._model = FilterModel(sensor, known, priors, run_duration, 1 / rate_hz, means=False)
        self._tracks: list[Track] = []
        self._filter: NavigationFilter | None = None
        self._last_time, self._last_hold = -np.inf, -1
        self._ended_rests = 0
        _compile(self._model)

    def feed(self, track: Track) -> None:
        """Process the next samples.

        Raises
        ------
        InputError
            Samples are missing in a turn, or the axes do not fit together.
        """
        self._require_whole_turns(track)
        if self._filter is not None:
            self._filter.feed(track.reading, track.hold)
            return
        at = 0
        for end in self._rest_ends(track):
            if end > at:
                self._tracks.append(track.slice(at, end))
            at, self._ended_rests = end, self._ended_rests + 1
            if self._ended_rests >= MIN_RESTS and (begun := self._begun()) is not None:
                self._filter, self._tracks = begun, []
                begun.feed(track.reading[end:], track.hold[end:])
                return
        if at < track.time.size:
            self._tracks.append(track.slice(at, track.time.size))

    def _require_whole_turns(self, track: Track) -> None:
        time = np.concatenate([[self._last_time], track.time])
        moving = np.concatenate([[self._last_hold], track.hold]) < 0
        gap = np.diff(time) > GAP_FACTOR * self._model.dt
        at = np.flatnonzero(gap & (moving[1:] | moving[:-1]) & np.isfinite(time[:-1]))
        if at.size:
            k = int(at[0])
            raise InputError(
                f"samples are missing in a turn, from {time[k]:.6g} s to {time[k + 1]:.6g} s, "
                "so part of its angle is lost",
                key="[data]",
            )
        self._last_time, self._last_hold = float(time[-1]), int(track.hold[-1])

    def _rest_ends(self, track: Track) -> list[int]:
        """Return the indices of the first samples after each rest."""
        before = self._tracks[-1].hold[-1] if self._tracks else -1
        hold = np.concatenate([[before], track.hold])
        ends: list[int] = np.flatnonzero((hold[:-1] >= 0) & (hold[1:] != hold[:-1])).tolist()
        return ends

    def _begun(self) -> NavigationFilter | None:
        """Return the filter after the samples so far, or None if the azimuth is not known yet."""
        track = join_tracks(self._tracks)
        labels = tuple(f"rest {k + 1}" for k in range(self._ended_rests))
        segments = segments_of_track(track, labels, self._model.sensor, FILTER_NOISE)
        model = replace(self._model, means=track.samples_are_means)
        start, known = filter_start(model, segments), model.known
        attitudes = attitudes_at(segments, model.imu, start.value, known.latitude.value)
        if not determines_azimuth(attitudes):
            return None
        self._model = model
        start = replace(start, attitude=attitudes[0], rest_attitudes=attitudes)
        result = NavigationFilter(model, start, LIVE_CHUNK)
        result.feed(track.reading, track.hold)
        return result

    def estimate(self) -> Mapping[str, PartialEstimate]:
        """Return the estimate of all coefficients; empty until rests determine the azimuth."""
        made = self._filter
        if made is None:
            return {}
        names, found = self._model.sensor.coefficients, made.estimate()
        p = len(names)
        value, covariance = found.value[:p], found.covariance[:p, :p]
        return {"all": PartialEstimate(names, value, covariance, made.nis, made.components)}


def sequential(
    estimator: str,
    sensor: Sensor,
    bench: Turntable,
    steps: TableSteps,
    priors: Priors,
    rate_hz: float,
) -> LiveNavigation:
    """Return the filter for a run before its first sample.

    Parameters
    ----------
    estimator : str
        Unused, because every estimator uses this filter for its live estimate.
    sensor : Sensor
    bench : Turntable
    steps : sequence of Position or Rotation
        The planned steps, which determine the duration of the run.
    priors : sequence of Gaussian
    rate_hz : float
        Samples per second.

    Raises
    ------
    InputError
        The table cannot carry out the steps.
    """
    duration = turntable_path_duration(bench, steps)
    return LiveNavigation(sensor, StillTable.from_turntable(bench), priors, duration, rate_hz)


def _compile(model: FilterModel) -> None:
    """Compile or load the kernels in advance, because a moving table must not wait for them."""
    p, reading = len(model.sensor.coefficients), np.zeros((1, 6))
    reading[0, :3] = [0.0, 0.0, model.known.gravity.value]
    start = FilterStart(np.eye(3), np.zeros(p), 0.0, np.ones(p), np.ones(3))
    one = NavigationFilter(model, start, chunk=1)
    n = model.count + 10
    one.feed(np.tile(reading, (n, 1)), np.zeros(n, dtype=np.int64))
    turn = np.array([0], dtype=np.int64)
    segments = Segments(
        ("a", "b"), np.tile(reading, (2, 1)), np.zeros((2, 2, 6)), np.tile(reading, (4, 1)), turn,
        turn + 4, model.dt, np.zeros(3), np.ones(3), (0.0, 1.0),
    )  # fmt: skip
    motion = model.imu.motion(segments, np.zeros(p), 0.0)
    integrate_navigation(segments, motion, np.eye(3)[None], np.zeros(3), 0.0)
