"""Both filters of the method over the samples as they come.

What is found is bit for bit what the run's recording gives afterwards, however the samples come in
pieces: the same filters take the same steps. There the innovations' excess may enlarge the
uncertainties, once all of them are known.
"""

from collections.abc import Callable
from dataclasses import dataclass
from math import nan

import numpy as np
from numpy.typing import NDArray

from inercal.benches.turntable.bench import Turntable
from inercal.benches.turntable.simulation import seconds_on_turntable
from inercal.errors import InputError
from inercal.host.assembly import Block
from inercal.methods.turntable.model import COARSE
from inercal.methods.turntable_kalman import METHOD, _accelerometers, _readback
from inercal.methods.turntable_kalman.accelerometers import Accelerometers
from inercal.methods.turntable_kalman.follow import apart
from inercal.methods.turntable_kalman.gyros import Gyros
from inercal.methods.turntable_kalman.ways import (
    WAYS,
    Found,
    accelerometers_filter,
    gyros_filter,
    observed,
    of_accelerometers,
    of_gyros,
)
from inercal.recording import Track
from inercal.runfile import Run

Array = NDArray[np.float64]


@dataclass
class _OfGyros:
    """The gyros' filter and how far it has come."""

    made: Gyros
    state: _readback.State

    def step(self, track: Track) -> None:
        self.state, _ = self.made.step(self.state, track)

    @property
    def found(self) -> Found:
        return of_gyros(self.made, self.state)


@dataclass
class _OfAccelerometers:
    """The same of the accelerometers'."""

    made: Accelerometers
    state: _accelerometers.State

    def step(self, track: Track) -> None:
        self.state, _ = self.made.step(self.state, track)

    @property
    def found(self) -> Found:
        return of_accelerometers(self.made, self.state)


class Live:
    """The filters of a run while it goes on.

    Parameters
    ----------
    run : Run
        On a turntable, by the method of the filters.

    Attributes
    ----------
    names : tuple of p str
        The coefficients, in the sensor's order.
    time : float
        s of the recording, of the last sample; NaN before the first.

    Raises
    ------
    InputError
        Another method, or a prior that joins gyros and accelerometers.
    """

    def __init__(self, run: Run):
        if run.method.name != METHOD.name or not isinstance(run.bench, Turntable):
            raise InputError(
                f"{run.path}: [method] name: {run.method.name} follows no run as it goes on; "
                f"possible: {METHOD.name}"
            )
        self.names = run.sensor.coefficients
        self.time = nan
        self._sensor, self._bench, self._way = run.sensor, run.bench, WAYS[run.estimator]
        self._priors = apart(run.sensor, run.priors)
        self._lasting = seconds_on_turntable(run.bench, run.table_steps)
        self._waiting: list[Track] = []
        self._filters: list[_OfGyros | _OfAccelerometers] = []

    @property
    def begun(self) -> bool:
        """Whether the first rest has lasted long enough."""
        return bool(self._filters)

    @property
    def found(self) -> dict[str, Found]:
        """What each filter has found, by "w" and "f"; empty before it begins."""
        return {"w" if isinstance(one, _OfGyros) else "f": one.found for one in self._filters}

    @property
    def values(self) -> Array:
        """The coefficients, (p,) SI; NaN before the filters begin."""
        return self._spread(lambda found, p: found.value[:p])

    @property
    def std(self) -> Array:
        """Their standard deviations, (p,) SI; NaN before the filters begin."""
        return self._spread(lambda found, p: np.sqrt(np.diagonal(found.covariance)[:p]))

    @property
    def innovations(self) -> dict[str, tuple[float, int]]:
        """Of each filter, "w" and "f", the sum of squares over what was stated, of how many."""
        return {
            "w" if isinstance(one, _OfGyros) else "f": (
                one.state.nis,
                observed(one.made) * one.state.epochs,
            )
            for one in self._filters
        }

    def feed(self, block: Block) -> None:
        """Take in the samples that follow.

        Raises
        ------
        InputError
            The first rest was too short, or a sensor or bench that the filters do not take.
        """
        if block.begins:
            self._waiting, self._filters = [], []
        self.time = float(block.time[-1])
        if self._filters:
            for one in self._filters:
                one.step(block.track)
            return
        self._waiting.append(block.track)
        rests = [float(t.time[t.hold >= 0][0]) for t in self._waiting if (t.hold >= 0).any()]
        if rests and self.time > rests[0] + COARSE:
            self._begin(_joined(self._waiting))
            self._waiting = []

    def _begin(self, track: Track) -> None:
        sensor, bench, way = self._sensor, self._bench, self._way
        kinds = {axis.measures for axis in sensor.axes}
        filters: list[_OfGyros | _OfAccelerometers] = []
        if "w" in kinds:
            made = gyros_filter(sensor, bench, track, way, self._priors, self._lasting)
            filters.append(_OfGyros(made, made.start(track)))
        if "f" in kinds:
            made = accelerometers_filter(sensor, bench, track, way, self._priors, self._lasting)
            filters.append(_OfAccelerometers(made, made.start(track)))
        for one in filters:
            one.step(track)
        self._filters = filters

    def _spread(self, of: Callable[[Found, int], Array]) -> Array:
        """Return what is asked of each filter's coefficients, in the sensor's order."""
        values = np.full(len(self.names), nan)
        for one in self._filters:
            own = one.made.part.sensor.coefficients
            values[[self.names.index(name) for name in own]] = of(one.found, len(own))
        return values


def _joined(tracks: list[Track]) -> Track:
    return Track(
        np.concatenate([one.time for one in tracks]),
        np.concatenate([one.reading for one in tracks]),
        np.concatenate([one.angles for one in tracks]),
        np.concatenate([one.hold for one in tracks]),
    )
