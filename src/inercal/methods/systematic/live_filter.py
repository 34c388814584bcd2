"""The live estimate of systematic calibration: the filter over a run as its samples come.

The first rests are kept until they show the azimuth; then the filter follows them and all that
comes. It is a single pass: what it is linearised about is found from those rests.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from inercal.basics.errors import InputError
from inercal.benches.turntable.bench import Turntable
from inercal.benches.turntable.simulation import turntable_path_duration
from inercal.benches.turntable.still_table import StillTable
from inercal.estimation import Gaussian
from inercal.methods._base import PartialEstimate
from inercal.methods.systematic.alignment import attitudes_at, determines_azimuth
from inercal.methods.systematic.filter_inputs import FilterModel, FilterStart, filter_start
from inercal.methods.systematic.navigation import integrate_navigation
from inercal.methods.systematic.navigation_filter import LIVE_CHUNK, NavigationFilter
from inercal.methods.systematic.segments import (
    FILTER_NOISE,
    MIN_RESTS,
    Segments,
    require_imu,
    segments_of_track,
)
from inercal.physics.plan import TableStep
from inercal.physics.sensors import Sensor
from inercal.recordings import GAP_FACTOR, Track, join_tracks


class LiveNavigation:
    """The filter of a run as its samples come; see `inercal.methods.Sequential`.

    Parameters
    ----------
    sensor : Sensor
    known : StillTable
    priors : sequence of Gaussian
    run_duration : float
        Of the run as planned, s.
    rate_hz : float
        Samples per second.

    Raises
    ------
    InputError
        Another sensor than three accelerometers and three gyros.
    """

    def __init__(
        self,
        sensor: Sensor,
        known: StillTable,
        priors: Sequence[Gaussian],
        run_duration: float,
        rate_hz: float,
    ):
        require_imu(sensor)
        self._model = FilterModel(sensor, known, priors, run_duration, 1 / rate_hz, means=False)
        self._tracks: list[Track] = []
        self._filter: NavigationFilter | None = None
        self._last_time, self._last_hold = -np.inf, -1
        self._ended_rests = 0
        _compile(self._model)

    def feed(self, track: Track) -> None:
        """Process the samples that follow.

        Raises
        ------
        InputError
            Samples are missing in a turn, or axes that do not fit together.
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
                f"samples are missing in a turn, from {time[k]:.6g} s to {time[k + 1]:.6g} s: part "
                "of its angle is lost",
                key="[data]",
            )
        self._last_time, self._last_hold = float(time[-1]), int(track.hold[-1])

    def _rest_ends(self, track: Track) -> list[int]:
        """Return the samples before which a rest has ended."""
        before = self._tracks[-1].hold[-1] if self._tracks else -1
        hold = np.concatenate([[before], track.hold])
        ends: list[int] = np.flatnonzero((hold[:-1] >= 0) & (hold[1:] != hold[:-1])).tolist()
        return ends

    def _begun(self) -> NavigationFilter | None:
        """Return the filter after the samples so far; None while they leave the azimuth open."""
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
        """Return the estimate of all coefficients; empty before rests show the azimuth."""
        if self._filter is None:
            return {}
        names, found = self._model.sensor.coefficients, self._filter.estimate()
        p = len(names)
        one = PartialEstimate(
            names,
            found.value[:p],
            found.covariance[:p, :p],
            self._filter.nis,
            self._filter.components,
        )
        return {"all": one}


def sequential(
    estimator: str,
    sensor: Sensor,
    bench: Turntable,
    steps: Sequence[TableStep],
    priors: Sequence[Gaussian],
    rate_hz: float,
) -> LiveNavigation:
    """Return the filter of a run before its first sample.

    Parameters
    ----------
    estimator : str
        Unused: by each estimator the live estimate is that of the filter.
    sensor : Sensor
    bench : Turntable
    steps : sequence of Position or Rotation
        They say how long the run will last.
    priors : sequence of Gaussian
    rate_hz : float
        Samples per second.

    Raises
    ------
    InputError
        Steps that the table cannot follow.
    """
    duration = turntable_path_duration(bench, steps)
    return LiveNavigation(sensor, StillTable.from_turntable(bench), priors, duration, rate_hz)


def _compile(model: FilterModel) -> None:
    """Have the kernels compiled or loaded: a table that moves must not wait for them."""
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
