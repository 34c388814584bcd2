"""Both filters of a run over its samples as they come.

The estimate equals that of the recording bit for bit, whatever the pieces: the same filters take
the same steps. The final estimate may have larger uncertainties, by the excess of all innovations.
"""

from collections.abc import Mapping, Sequence
from math import inf

from inercal.benches.turntable.bench import Turntable
from inercal.benches.turntable.rest_timing import COARSE_REST_SECONDS
from inercal.benches.turntable.simulation import turntable_path_duration
from inercal.estimation import Gaussian
from inercal.methods._base import PartialEstimate
from inercal.methods.turntable_kalman import _accelerometers, _readback
from inercal.methods.turntable_kalman.combined_estimate import split_priors
from inercal.methods.turntable_kalman.filter import RunningFilter
from inercal.methods.turntable_kalman.filter_config import (
    FILTER_CONFIGS,
    FILTER_KINDS,
    FilterConfig,
)
from inercal.physics.plan import TableStep
from inercal.physics.sensors import Sensor
from inercal.recordings import Track, join_tracks

_AnyRunningFilter = (
    RunningFilter[_readback.AttitudeState] | RunningFilter[_accelerometers.VelocityState]
)


def sequential(
    estimator: str,
    sensor: Sensor,
    bench: Turntable,
    steps: Sequence[TableStep],
    priors: Sequence[Gaussian],
    rate_hz: float,
    *,
    config: FilterConfig | None = None,
) -> "FilterPair":
    """Return both filters of an estimator before the first sample.

    Parameters
    ----------
    estimator : str
        "full", "drift" or "paper".
    sensor : Sensor
    bench : Turntable
    steps : sequence of Position or Rotation
        They say how long the run will last, without pauses.
    priors : sequence of Gaussian
    rate_hz : float
        Unused: samples have their times.
    config : FilterConfig, optional
        In place of the estimator's own.

    Raises
    ------
    InputError
        A prior that joins gyros and accelerometers, or steps that the table cannot follow.
    """
    run_duration = turntable_path_duration(bench, steps)
    return FilterPair(
        sensor,
        bench,
        config or FILTER_CONFIGS[estimator],
        split_priors(sensor, priors),
        run_duration,
    )


class FilterPair:
    """The filters of the gyros and of the accelerometers, "w" and "f"; see `Sequential`.

    Parameters
    ----------
    sensor : Sensor
    bench : Turntable
    config : FilterConfig
    priors : sequence of Gaussian
        Each of gyros or of accelerometers.
    run_duration : float
        Of the run as planned, s.
    """

    def __init__(
        self,
        sensor: Sensor,
        bench: Turntable,
        config: FilterConfig,
        priors: Sequence[Gaussian],
        run_duration: float,
    ):
        self._sensor, self._bench, self._config = sensor, bench, config
        self._priors, self._run_duration = priors, run_duration
        self._pending_tracks: list[Track] = []
        self._rest_start = inf  # when the first rest began
        self._filters: dict[str, _AnyRunningFilter] = {}

    def feed(self, track: Track) -> None:
        """Process the samples that follow.

        Raises
        ------
        InputError
            The first rest was too short, or the filters do not support the sensor or the bench.
        """
        if self._filters:
            for one in self._filters.values():
                one.step(track)
            return
        self._pending_tracks.append(track)
        if self._rest_start == inf and (track.hold >= 0).any():
            self._rest_start = float(track.time[track.hold >= 0][0])
        if track.time[-1] > self._rest_start + COARSE_REST_SECONDS:
            self._begin(join_tracks(self._pending_tracks))
            self._pending_tracks = []

    def estimate(self) -> Mapping[str, PartialEstimate]:
        """Return the estimate of each filter; empty before the first rest has lasted 20 s."""
        return {kind: _partial_estimate(one) for kind, one in self._filters.items()}

    def _begin(self, track: Track) -> None:
        given = self._sensor, self._bench, track, self._priors, self._run_duration
        kinds = {axis.measures for axis in self._sensor.axes}
        filters = {
            kind: self._config.filter(kind, *given).begin(track)
            for kind in FILTER_KINDS
            if kind in kinds
        }
        for one in filters.values():
            one.step(track)
        self._filters = filters


def _partial_estimate(one: _AnyRunningFilter) -> PartialEstimate:
    """Return the coefficients, which come first in the estimate of a filter."""
    names, found = one.filter.triad.sensor.coefficients, one.estimate
    p = len(names)
    return PartialEstimate(
        names,
        found.value[:p],
        found.covariance[:p, :p],
        float(one.state.nis),
        one.dof,
    )
