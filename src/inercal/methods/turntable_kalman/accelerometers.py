"""The accelerometers' filter: velocity at rest should stay zero, and the table says what is up.

States: δV (3), φ (3), coefficients, drift of the biases (`turntable.drift`), and what the table's
attitude may be off by: lean of the base, right angles and harmonics of the readback; or the lean
and, anew at each hold, an error of its angles (2) that stands for the others. At every hold
the attitude is taken from the table, which keeps it, and the velocity set to zero and integrated;
what is found is fed back ten times a second. The source integrates the attitude by the gyros: what
these are off by, their sensitivity to g above all, is then taken for tilt.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import ClassVar, Literal

import numpy as np
from numpy.typing import NDArray

from inercal.arrays import Array
from inercal.benches.turntable.attitude import Misalignment, misalignment, reference
from inercal.benches.turntable.bench import Turntable
from inercal.estimate import Course, Gaussian
from inercal.estimate.kalman import Steps
from inercal.methods.turntable import model, strapdown
from inercal.methods.turntable.model import beside
from inercal.methods.turntable_kalman import _accelerometers
from inercal.methods.turntable_kalman._accelerometers import Readback, Settings, State
from inercal.methods.turntable_kalman.filter import TILT, Filter, copied
from inercal.recording import Track
from inercal.sensors import Sensor

STILL = 1e-5  # m/s, how far velocity at rest is known to be zero: 1 µm in 0.1 s
_ALIGNED = 5e-4  # rad, sd of φ where a hold begins
_COMMON = ("lean_x", "lean_y")  # of the base; what else a hold is off by is its own


@dataclass(frozen=True, eq=False)
class Accelerometers(Filter[State]):
    """The filter of one sensor on one table.

    Parameters
    ----------
    part, bench, prior, first, table
        As of `Filter`.
    holds : bool
        Whether the error of each hold's angles is a state.
    readback : float or None
        Standard deviation of the attitude by readback within a hold, rad; None is the bench's noise
        about each axis of the table.
    still : float
        Standard deviation of the velocity at rest, m/s.
    """

    holds: bool
    readback: float | None
    still: float

    name: ClassVar[str] = "accelerometers"
    unit: ClassVar[str] = "m/s"
    before: ClassVar[tuple[str, ...]] = ("v_e", "v_n", "v_u", *TILT)
    rows: ClassVar[int] = 5

    @classmethod
    def of(
        cls,
        sensor: Sensor,
        bench: Turntable,
        track: Track,
        priors: Sequence[Gaussian] = (),
        *,
        drifting: bool = True,
        table: Literal["whole", "lean", "exact"] = "whole",
        readback: float | None = None,
        still: float = STILL,
        lasting: float | None = None,
    ) -> "Accelerometers":
        """Return the filter, with first values from the rest that a track begins with.

        Parameters
        ----------
        sensor, bench, track, priors
            As of `Gyros.of`.
        drifting : bool
            Whether biases drift.
        table : "whole", "lean" or "exact"
            Which of the table's errors are states: all; the base's lean and an error of each hold;
            none.
        readback, still : float
            rad, m/s; None is the bench's noise.
        lasting : float, optional
            As planned, s; None is the track's.

        Raises
        ------
        InputError
            A sensor that a filter does not take, or no rest to begin with.
        """
        part = model.triad(sensor, "f", model.lasting(track, lasting), drifting=drifting)
        first, prior = model.begin(part, priors, model.coarse(bench, track, part))
        seen = misalignment(bench, np.zeros((1, len(bench.axes)))).parameters
        kept = tuple(
            q
            for q in seen
            if q.sd > 0 and (q.name in _COMMON or (table == "whole" and q.name != "azimuth"))
        )
        kept = () if table == "exact" else kept
        return cls(part, bench, prior, first, kept, table == "lean", readback, still)

    @property
    def varying(self) -> tuple[str, ...]:
        """Names of the states that vary with time and that a hold says something of."""
        return (*TILT[:2], *self.drifting, *self.own)

    @property
    def own(self) -> tuple[str, ...]:
        """Names of the error of each hold's angles."""
        return ("hold_x", "hold_y") if self.holds else ()

    @property
    def observed(self) -> int:
        """How many components of an epoch are tested."""
        # At rest a readback that is stated as exact is: what it leaves of the floor tests nothing.
        return 3 if self.readback is None and self.bench.white == 0 else self.rows

    @property
    def shared(self) -> Array:
        """Part of the coefficients' covariance that no innovation shows, (p, p): gravity's."""
        g = self.bench.gravity
        along = model.of_gravity(self.part) * g.sd / g.value
        return np.outer(along, along)

    def start(self, track: Track) -> State:
        """Return the state before the first sample of a track."""
        covariance = self.covariance(0.0)
        return State(
            c=np.eye(3),
            theta=self.first.copy(),
            x=np.zeros(len(covariance)),
            p=covariance,
            made=np.zeros((self.part.terms.size, 3, 3)),
            time=np.full(3, track.time[0]),
            force=np.zeros(3),
            velocity=np.zeros(3),
            hold=np.array([-1]),
        )

    def with_steps(
        self, state: State, track: Track, smooth: Sequence[str] = ()
    ) -> tuple[State, Course, Steps]:
        """Return as `Filter.with_steps`."""
        after = copied(state)
        epochs = strapdown.due_in_holds(
            track.time, track.hold, model.PERIOD * (1 - 1e-6), after.time[1], after.hold[0]
        )
        steps, history = self.room(epochs.size, smooth)
        nis = _accelerometers.accelerometers(
            self.samples(track),
            self._readback(epochs, track.angles[epochs]),
            self.known(),
            Settings(self.still**2, _ALIGNED**2),
            after,
            steps,
            history,
        )
        return self.after(after, nis, track.time[epochs], steps, history, smooth)

    def _readback(self, epochs: NDArray[np.int64], angles: Array) -> Readback:
        """Return what the kernel is told of the readback (e, k) at epochs."""
        e, q = len(angles), len(self.table)
        if not e:  # as long as the table moves
            shapes = (e, 3, 3), (e, 2, q), (e, 2), (e, 2)
            return Readback(epochs, *(np.zeros(shape) for shape in shapes))
        seen = misalignment(self.bench, angles)
        return Readback(
            epochs,
            reference(self.bench, angles),
            # Of one layout whatever e is: a kernel is compiled for each.
            np.ascontiguousarray(beside(seen, self.table)[:, :2]),
            self._held(angles),
            self._noise(seen, angles),
        )

    def _held(self, angles: Array) -> Array:
        """Return the variance about east and north of what a hold's angles are off by, (e, 2)."""
        if not self.holds:
            return np.zeros((len(angles), 2))  # no state of its own
        seen = misalignment(self.bench, angles)
        variance = np.array(
            [0.0 if q.name in (*_COMMON, "azimuth") else q.sd**2 for q in seen.parameters]
        )
        return (seen.by[..., :2, :] ** 2) @ variance

    def _noise(self, seen: Misalignment, angles: Array) -> Array:
        """Return the variance about east and north of the readback's noise, (e, 2)."""
        if self.readback is not None:
            return np.full((len(angles), 2), self.readback**2)
        # Sine and cosine of a harmonic turn about an axis as noise does; their squares add up to 1.
        if not self.bench.harmonics:
            seen = misalignment(replace(self.bench, harmonics=(1.0,)), angles)
        waves = [k for k, q in enumerate(seen.parameters) if q.name.startswith(("sin1", "cos1"))]
        share = np.sum(seen.by[..., :2, waves] ** 2, axis=-1)
        return np.maximum(self.bench.white**2 * share, model.FLOOR**2)
