"""Both filters of a run over its samples as they come.

The estimate is bit for bit what the recording gives afterwards, whatever the pieces: the same
filters take the same steps. Afterwards the innovations' excess may enlarge the uncertainties, once
all innovations are known.
"""

from collections.abc import Mapping, Sequence
from math import inf

import numpy as np

from inercal.benches.turntable.bench import Turntable
from inercal.benches.turntable.epochs import COARSE
from inercal.benches.turntable.simulation import seconds_on_turntable
from inercal.estimate import Gaussian
from inercal.methods._base import PartialEstimate
from inercal.methods.turntable_kalman import _accelerometers, _readback
from inercal.methods.turntable_kalman.filter import Running
from inercal.methods.turntable_kalman.follow import split_priors
from inercal.methods.turntable_kalman.ways import KINDS, WAYS, FilterConfig
from inercal.plan import TableStep
from inercal.recording import Track
from inercal.sensors import Sensor

_Running = Running[_readback.State] | Running[_accelerometers.State]


def sequential(
    estimator: str,
    sensor: Sensor,
    bench: Turntable,
    steps: Sequence[TableStep],
    priors: Sequence[Gaussian],
    rate_hz: float,
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

    Raises
    ------
    InputError
        A prior that joins gyros and accelerometers, or steps that the table cannot follow.
    """
    lasting = seconds_on_turntable(bench, steps)
    return FilterPair(sensor, bench, WAYS[estimator], split_priors(sensor, priors), lasting)


class FilterPair:
    """The filters of the gyros and of the accelerometers, "w" and "f"; see `Sequential`.

    Parameters
    ----------
    sensor : Sensor
    bench : Turntable
    way : FilterConfig
    priors : sequence of Gaussian
        Each of gyros or of accelerometers.
    lasting : float
        Of the run as planned, s.
    """

    def __init__(
        self,
        sensor: Sensor,
        bench: Turntable,
        way: FilterConfig,
        priors: Sequence[Gaussian],
        lasting: float,
    ):
        self._sensor, self._bench, self._way = sensor, bench, way
        self._priors, self._lasting = priors, lasting
        self._waiting: list[Track] = []
        self._rests = inf  # when the first rest began
        self._filters: dict[str, _Running] = {}

    def feed(self, track: Track) -> None:
        """Take in the samples that follow.

        Raises
        ------
        InputError
            The first rest was too short, or a sensor or bench that the filters do not take.
        """
        if self._filters:
            for one in self._filters.values():
                one.step(track)
            return
        self._waiting.append(track)
        if self._rests == inf and (track.hold >= 0).any():
            self._rests = float(track.time[track.hold >= 0][0])
        if track.time[-1] > self._rests + COARSE:
            self._begin(_joined(self._waiting))
            self._waiting = []

    def estimate(self) -> Mapping[str, PartialEstimate]:
        """Return what each filter has found; empty before the first rest has lasted 20 s."""
        return {kind: _of_coefficients(one) for kind, one in self._filters.items()}

    def _begin(self, track: Track) -> None:
        given = self._sensor, self._bench, track, self._priors, self._lasting
        kinds = {axis.measures for axis in self._sensor.axes}
        filters = {
            kind: self._way.filter(kind, *given).begin(track) for kind in KINDS if kind in kinds
        }
        for one in filters.values():
            one.step(track)
        self._filters = filters


def _of_coefficients(one: _Running) -> PartialEstimate:
    """Return the coefficients, which are the first of what a filter has found."""
    names, found = one.made.part.sensor.coefficients, one.found
    p = len(names)
    return PartialEstimate(
        names,
        found.value[:p],
        found.covariance[:p, :p],
        float(one.state.nis),
        one.components,
    )


def _joined(tracks: Sequence[Track]) -> Track:
    return Track(
        np.concatenate([one.time for one in tracks]),
        np.concatenate([one.reading for one in tracks]),
        np.concatenate([one.angles for one in tracks]),
        np.concatenate([one.hold for one in tracks]),
    )
