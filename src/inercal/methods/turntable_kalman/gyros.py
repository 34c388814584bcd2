"""The gyros' filter: what they make of the attitude against what the table says of it.

States: φ (3), coefficients, drift of the biases (`turntable.drift`), and what the table's attitude
may be off by (latency, clock, right angles, harmonics of the readback). The attitude is integrated
from the rates as corrected so far and compared ten times a second; what is found is fed back.

A readback may be ahead of the IMU or behind it: the one that comes first waits for the other, so
that each is compared with an attitude between samples, at most 8 standard deviations of the latency
old.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import ceil
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from inercal.arrays import Array
from inercal.benches.turntable.attitude import misalignment, reference
from inercal.benches.turntable.bench import Turntable
from inercal.benches.turntable.epochs import GAP
from inercal.errors import InputError
from inercal.estimate import Course, Gaussian
from inercal.estimate.kalman import Steps
from inercal.methods.turntable import model, strapdown
from inercal.methods.turntable.model import ARCSEC, beside
from inercal.methods.turntable_kalman import _gyros
from inercal.methods.turntable_kalman._common import Samples
from inercal.methods.turntable_kalman._readback import Readback, Settings, State
from inercal.methods.turntable_kalman.filter import TILT, Filter, copied
from inercal.recording import Track
from inercal.sensors import Sensor

_SURELY = 4.0  # standard deviations
# s; where less is known of a delay it does not act in first order as the table speeds up.
_SPAN = 0.1
_SPARE = 8  # samples of the ring beyond those: two at either end for a cubic, and uneven steps
_TIMES, _PAUSES = 2.0, 600.0  # as long as planned, and s: what a run with pauses may take
_DRIVEN = ("latency", "clock", "azimuth")
_ALIGNED = 60 * ARCSEC  # sd of φ where the attitude is taken from the table


@dataclass(frozen=True, eq=False)
class Gyros(Filter[State]):
    """The filter of one sensor on one table.

    Parameters
    ----------
    part, bench, prior, first, table
        As of `Filter`.
    readback : float
        Standard deviation of the attitude by readback, rad.
    lag : int
        Samples by which readback waits for the IMU; negative, the IMU waits for it.
    kept : int
        Samples whose attitudes are kept.
    closed : bool
        Whether what is found is fed back to the integration.
    turning : bool
        Whether attitudes are compared while the table turns too.
    """

    readback: float
    lag: int = 0
    kept: int = 16
    closed: bool = True
    turning: bool = True

    name: ClassVar[str] = "gyros"
    unit: ClassVar[str] = "rad"
    before: ClassVar[tuple[str, ...]] = TILT
    rows: ClassVar[int] = 3

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
        readback: float = 4 * ARCSEC,
        lasting: float | None = None,
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
        lasting : float, optional
            s that the run takes as planned; pauses come on top. None is the track's.

        Raises
        ------
        InputError
            A sensor that a filter does not take, no rest to begin with, or a latency that is not
            known well enough.
        """
        part = model.triad(sensor, "w", model.lasting(track, lasting), drifting=drifting)
        first, prior = model.begin(part, priors, model.coarse(bench, track, part))
        loose = [q for q in bench.parameters if q.sd > 0]
        wanted = [q for q in loose if q.name in _DRIVEN and drifting]
        if table:
            seen = misalignment(bench, np.zeros((1, len(bench.axes)))).parameters
            # A lean turns all attitudes alike: φ at the start holds it.
            known = ("lean_x", "lean_y", *_DRIVEN)
            wanted += [q for q in seen if q.sd > 0 and q.name not in known]
        lag, kept = _waiting(bench, track, bench.latency.sd if drifting else 0.0, lasting)
        return cls(part, bench, prior, first, tuple(wanted), readback, lag, kept)

    @property
    def varying(self) -> tuple[str, ...]:
        """Names of the states that vary with time."""
        return (*TILT, *self.drifting)

    def start(self, track: Track) -> State:
        """Return the state before the first sample of a track."""
        covariance = self.covariance(_ALIGNED**2)
        x = np.zeros(len(covariance))
        x[len(x) - len(self.table) :] = [one.value for one in self.table]
        time, mat = float(track.time[0]), reference(self.bench, track.angles[:1])[0]
        reading = track.reading[0, self.part.channels]
        waits = np.zeros((0, 6 if self.part.terms.warm else 5))
        return State(
            c=mat,
            theta=self.first.copy(),
            x=x,
            p=covariance,
            made=np.zeros((self.part.terms.size, 3, 3)),
            time=np.array([time, time, time, 0.0, time]),
            rates=np.array([reading, reading, np.zeros(3)]),
            bent=np.zeros(1),
            lost=np.array([False]),
            times=np.full(self.kept, time),
            past=np.tile(mat, (self.kept, 1, 1)),
            sums=np.zeros((self.kept, self.part.terms.size, 3, 3)),
            newest=np.array([0]),
            tail=waits if self.lag < 0 else np.tile([time, *track.angles[0]], (self.lag, 1)),
        )

    def with_steps(
        self, state: State, track: Track, smooth: Sequence[str] = ()
    ) -> tuple[State, Course, Steps]:
        """Return as `Filter.with_steps`."""
        after = copied(state)
        samples, stamps, angles, tail = self._paired(state.tail, track)
        # In one order of memory, or the kernel would be compiled for each.
        after = after._replace(tail=np.ascontiguousarray(tail))
        epochs = strapdown.epoch_indices(samples.time, model.PERIOD * (1 - 1e-6), after.time[1])
        if not self.turning:
            epochs = epochs[samples.hold[epochs] >= 0]
        angles = np.ascontiguousarray(angles[epochs])
        late = self._late()
        steps, history = self.room(epochs.size, smooth)
        nis = _gyros.gyros(
            samples,
            Readback(
                epochs,
                samples.time[epochs] - stamps[epochs],
                reference(self.bench, angles),
                beside(misalignment(self.bench, angles), self.table, skipped=_DRIVEN),
            ),
            self.known(),
            Settings(
                self.readback**2,
                _ALIGNED**2,
                GAP,
                late,
                0.0 if late[0] >= 0 else float(self.bench.latency.value),
                self.closed,
                float(self.bench.azimuth.value),
            ),
            after,
            steps,
            history,
        )
        return self.after(after, nis, samples.time[epochs], steps, history, smooth)

    def _paired(self, tail: Array, track: Track) -> tuple[Samples, Array, Array, Array]:
        """Return samples, of each the readback's stamp and angles, and what waits for later ones.

        `tail` is what has waited.
        """
        samples, lag = self.samples(track), self.lag
        if lag < 0:
            hold = samples.hold.astype(np.float64)
            beside = [samples.warmth] if self.part.terms.warm else []
            comes = np.column_stack([samples.time, samples.reading, hold, *beside])
            held = np.concatenate([tail, comes])
            taken = max(len(held) + lag, 0)
            ready = held[:taken]
            samples = Samples(
                ready[:, 0].copy(), ready[:, 1:4].copy(), ready[:, 4].astype(np.int64),
                ready[:, 5:].reshape(-1).copy(),
            )  # fmt: skip
            first = track.time.size - taken
            return samples, track.time[first:], track.angles[first:], held[taken:]
        read = np.concatenate([tail, np.column_stack([track.time, track.angles])])
        ready = read[: track.time.size]
        return samples, ready[:, 0], ready[:, 1:], read[track.time.size :]

    def _late(self) -> NDArray[np.int64]:
        """Return where latency, clock and azimuth stand among the states."""
        names = self.states
        return np.array([names.index(n) if n in names else -1 for n in _DRIVEN])


def _waiting(bench: Turntable, track: Track, sd: float, lasting: float | None) -> tuple[int, int]:
    """Return by how many samples readback waits for the IMU, and how many attitudes are kept.

    Parameters
    ----------
    bench : Turntable
    track : Track
    sd : float
        Of the latency, s.
    lasting : float or None
        Of the run as planned, s; None is the track's own.
    """
    late, step = bench.latency.value, float(np.median(np.diff(track.time)))
    most = model.lasting(track, None) if lasting is None else _TIMES * lasting + _PAUSES
    ahead = _SURELY * sd - late
    # A sample beyond the delay's own time serves to tell how the way bends there.
    lag = ceil(ahead / step - 1e-9) + 1 if sd > 0 or late != 0 else 0
    span = 2 * _SURELY * sd
    if span > _SPAN:
        raise InputError(
            f"[bench] latency: known to ± {1e3 * sd:.3g} ms the readback may be of any time within "
            f"{1e3 * span:.3g} ms; the gyros' filter takes ± {1e3 * _SPAN / 2 / _SURELY:.3g} ms at "
            "most: find the latency first, by a turn back and forth, and state it"
        )
    return lag, ceil((span + _SURELY * bench.clock * most) / step) + _SPARE
