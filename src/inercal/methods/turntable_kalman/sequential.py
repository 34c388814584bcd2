"""Both filters of a run over its samples as they come.

The estimate is bit for bit what the recording gives afterwards, whatever the pieces: the same
filters take the same steps. Afterwards the innovations' excess may enlarge the uncertainties, once
all innovations are known.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import inf

import numpy as np

from inercal.benches.turntable.bench import Turntable
from inercal.benches.turntable.epochs import COARSE
from inercal.benches.turntable.simulation import seconds_on_turntable
from inercal.estimate import Gaussian
from inercal.methods._base import PartialEstimate
from inercal.methods.turntable_kalman import _accelerometers, _readback
from inercal.methods.turntable_kalman.accelerometers import Accelerometers
from inercal.methods.turntable_kalman.follow import apart
from inercal.methods.turntable_kalman.gyros import Gyros
from inercal.methods.turntable_kalman.ways import (
    WAYS,
    Found,
    Way,
    accelerometers_filter,
    gyros_filter,
    observed,
    of_accelerometers,
    of_gyros,
)
from inercal.plan import TableStep
from inercal.recording import Track
from inercal.sensors import Sensor


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
    return FilterPair(sensor, bench, WAYS[estimator], apart(sensor, priors), lasting)


class FilterPair:
    """The filters of the gyros and of the accelerometers, "w" and "f"; see `Sequential`.

    Parameters
    ----------
    sensor : Sensor
    bench : Turntable
    way : Way
    priors : sequence of Gaussian
        Each of gyros or of accelerometers.
    lasting : float
        Of the run as planned, s.
    """

    def __init__(
        self,
        sensor: Sensor,
        bench: Turntable,
        way: Way,
        priors: Sequence[Gaussian],
        lasting: float,
    ):
        self._sensor, self._bench, self._way = sensor, bench, way
        self._priors, self._lasting = priors, lasting
        self._waiting: list[Track] = []
        self._rests = inf  # when the first rest began
        self._filters: dict[str, _OfGyros | _OfAccelerometers] = {}

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
        return {kind: one.estimate() for kind, one in self._filters.items()}

    def _begin(self, track: Track) -> None:
        given = self._sensor, self._bench, track, self._way, self._priors, self._lasting
        kinds = {axis.measures for axis in self._sensor.axes}
        filters: dict[str, _OfGyros | _OfAccelerometers] = {}
        if "w" in kinds:
            gyros = gyros_filter(*given)
            filters["w"] = _OfGyros(gyros, gyros.start(track))
        if "f" in kinds:
            accelerometers = accelerometers_filter(*given)
            filters["f"] = _OfAccelerometers(accelerometers, accelerometers.start(track))
        for one in filters.values():
            one.step(track)
        self._filters = filters


@dataclass
class _OfGyros:
    """The gyros' filter and its state."""

    made: Gyros
    state: _readback.State

    def step(self, track: Track) -> None:
        self.state, _ = self.made.step(self.state, track)

    def estimate(self) -> PartialEstimate:
        return _of_coefficients(self.made, of_gyros(self.made, self.state), self.state)


@dataclass
class _OfAccelerometers:
    """The accelerometers' filter and its state."""

    made: Accelerometers
    state: _accelerometers.State

    def step(self, track: Track) -> None:
        self.state, _ = self.made.step(self.state, track)

    def estimate(self) -> PartialEstimate:
        return _of_coefficients(self.made, of_accelerometers(self.made, self.state), self.state)


def _of_coefficients(
    made: Gyros | Accelerometers, found: Found, state: _readback.State | _accelerometers.State
) -> PartialEstimate:
    """Return the coefficients, which are the first of what a filter has found."""
    names = made.part.sensor.coefficients
    p = len(names)
    return PartialEstimate(
        names,
        found.value[:p],
        found.covariance[:p, :p],
        float(state.nis),
        observed(made) * state.epochs,
    )


def _joined(tracks: Sequence[Track]) -> Track:
    return Track(
        np.concatenate([one.time for one in tracks]),
        np.concatenate([one.reading for one in tracks]),
        np.concatenate([one.angles for one in tracks]),
        np.concatenate([one.hold for one in tracks]),
    )
