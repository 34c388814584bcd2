"""The gyros' filter: what they make of the attitude against what the table says of it.

States: φ (3), coefficients, drift of the biases (3), and what the table's attitude may be off by
(latency, clock, right angles, harmonics of the readback). The attitude is integrated from the rates
as corrected so far and compared ten times a second; what is found is fed back.
"""

from collections.abc import Sequence
from copy import deepcopy
from dataclasses import dataclass
from math import ceil, radians

import numpy as np
from numpy.typing import NDArray

from inercal.benches.turntable import Turntable
from inercal.benches.turntable_attitude import misalignment, reference
from inercal.estimate import Course, Gaussian
from inercal.methods.turntable import model, strapdown
from inercal.methods.turntable.model import Triad, beside
from inercal.methods.turntable.terms import BASIS
from inercal.methods.turntable_kalman import _gyros
from inercal.methods.turntable_kalman._gyros import Readback, Samples, Settings, State
from inercal.methods.turntable_kalman.common import TILT, course, drift_of, drifting_of, known, room
from inercal.parameters import Parameter
from inercal.recording import Track
from inercal.sensors import Sensor

Array = NDArray[np.float64]
_ARCSEC = radians(1 / 3600)
_SURELY = 4.0  # standard deviations
_KEPT = 64  # samples; a readback may be that late
_DRIVEN = ("latency", "clock", "azimuth")
_ALIGNED = 60 * _ARCSEC  # sd of φ where the attitude is taken from the table


@dataclass(frozen=True, eq=False)
class Gyros:
    """The filter of one sensor on one table.

    Parameters
    ----------
    part : Triad
    bench : Turntable
    prior : (p, p) array
        Covariance of the coefficients before the data.
    first : (p,) array
        Coefficients before the data.
    table : tuple of q Parameter
        Of the states after the drift.
    readback : float
        Standard deviation of the attitude by readback, rad.
    lag : int
        Samples by which readback waits for the IMU: it may be ahead of it.
    closed : bool
        Whether what is found is fed back to the integration.
    turning : bool
        Whether attitudes are compared while the table turns too.
    """

    part: Triad
    bench: Turntable
    prior: Array
    first: Array
    table: tuple[Parameter, ...]
    readback: float
    lag: int = 0
    closed: bool = True
    turning: bool = True

    @classmethod
    def of(
        cls,
        sensor: Sensor,
        bench: Turntable,
        track: Track,
        priors: Sequence[Gaussian] = (),
        *,
        drifting: bool = True,
        table: bool = True,
        readback: float = 4 * _ARCSEC,
    ) -> "Gyros":
        """Return the filter, with the biases' first values from the rest that a track begins with.

        Parameters
        ----------
        sensor : Sensor
        bench : Turntable
        track : Track
            Of one trial; its first 20 s do.
        priors : sequence of Gaussian
        drifting, table : bool
            Whether biases drift and readback may be late; whether the table's other errors are
            states.
        readback : float
            rad. 4″ hold what the readback's noise, and rates taken as linear between samples at
            100 Hz, are off by.

        Raises
        ------
        InputError
            A sensor that a filter does not take, or no rest to begin with.
        """
        part = model.triad(sensor, "w", drifting=drifting)
        first, prior = model.begin(part, priors, model.coarse(bench, track, part))
        loose = [q for q in bench.parameters if q.sd > 0]
        wanted = [q for q in loose if q.name in _DRIVEN and drifting]
        if table:
            seen = misalignment(bench, np.zeros((1, len(bench.axes)))).parameters
            # A lean turns all attitudes alike: φ at the start holds it.
            known = ("lean_x", "lean_y", *_DRIVEN)
            wanted += [q for q in seen if q.sd > 0 and q.name not in known]
        ahead = _SURELY * bench.latency.sd - bench.latency.value if drifting else 0.0
        lag = min(max(ceil(ahead / np.median(np.diff(track.time))), 0), _KEPT // 2)
        return cls(part, bench, prior, first, tuple(wanted), readback, lag)

    @property
    def states(self) -> tuple[str, ...]:
        """Names of the states."""
        table = (q.name for q in self.table)
        return (*TILT, *self.part.sensor.coefficients, *drift_of(self.part), *table)

    @property
    def varying(self) -> tuple[str, ...]:
        """Names of the states that vary with time."""
        return (*TILT, *drifting_of(self.part))

    def start(self, track: Track) -> State:
        """Return the state before the first sample of a track."""
        p, q = len(self.first), len(self.table)
        n = 6 + p + q
        covariance = np.zeros((n, n))
        covariance[:3, :3] = _ALIGNED**2 * np.eye(3)
        covariance[3 : 3 + p, 3 : 3 + p] = self.prior
        known = np.concatenate([self.part.drift[:, 0], [one.sd**2 for one in self.table]])
        at = np.arange(3 + p, n)
        covariance[at, at] = known
        x = np.zeros(n)
        x[6 + p :] = [one.value for one in self.table]
        time, mat = float(track.time[0]), reference(self.bench, track.angles[:1])[0]
        return State(
            c=mat,
            theta=self.first.copy(),
            x=x,
            p=covariance,
            made=np.zeros((BASIS, 3, 3)),
            time=np.full(3, time),
            rates=np.tile(track.reading[0, self.part.channels], (2, 1)),
            bent=np.zeros(1),
            lost=np.array([False]),
            times=np.full(_KEPT, time),
            past=np.tile(mat, (_KEPT, 1, 1)),
            newest=np.array([0]),
            tail=np.tile([time, *track.angles[0]], (self.lag, 1)),
        )

    def step(self, state: State, track: Track, smooth: Sequence[str] = ()) -> tuple[State, Course]:
        """Return the state after the samples of a track, and the course through them.

        Parameters
        ----------
        state : State
        track : Track
            The samples that follow.
        smooth : sequence of str
            States whose course is smoothed by all of the track, as `varying`.
        """
        after = deepcopy(state)
        epochs = strapdown.due(track.time, model.PERIOD * (1 - 1e-6), after.time[1])
        if not self.turning:
            epochs = epochs[track.hold[epochs] >= 0]
        stamps, angles = track.time, track.angles
        if self.lag:
            stamps = np.concatenate([after.tail[:, 0], stamps])
            angles = np.concatenate([after.tail[:, 1:], angles])
        angles = angles[epochs]
        history = np.zeros((epochs.size, 4 + 2 * state.x.size))
        steps = room(self.states, smooth, epochs.size, 3, 3)
        nis = _gyros.gyros(
            Samples(
                track.time, np.ascontiguousarray(track.reading[:, self.part.channels]), track.hold
            ),
            Readback(
                epochs,
                track.time[epochs] - stamps[epochs],
                reference(self.bench, angles),
                beside(self.bench, self.table, angles, skipped=_DRIVEN),
            ),
            known(self.part, self.bench),
            Settings(self.readback**2, _ALIGNED**2, model.GAP, self._late(), self.closed),
            after,
            steps,
            history,
        )
        if self.lag:
            kept = np.column_stack([track.time, track.angles])[-self.lag :]
            after = after._replace(tail=np.concatenate([after.tail, kept])[-self.lag :])
        taken = int((history[:, 3] > 0).sum())
        after = after._replace(nis=state.nis + nis, epochs=state.epochs + taken)
        return after, course("gyros", self.states, smooth, track.time[epochs], history, steps)

    def _late(self) -> NDArray[np.int64]:
        """Return where latency, clock and azimuth stand among the states."""
        names, first = [q.name for q in self.table], 6 + len(self.first)
        return np.array([first + names.index(n) if n in names else -1 for n in _DRIVEN])
