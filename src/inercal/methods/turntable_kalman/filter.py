"""What both filters are: states of a triad and of its table, over the samples of a track in pieces.

The states are those of the attitude, and of the velocity of accelerometers, then the coefficients,
the drift of the biases (`turntable.drift`), the table's parameters, and those of each hold.
"""
# SciPy has no stubs.
# pyright: reportMissingTypeStubs=false, reportUnknownVariableType=false

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar, Generic, NamedTuple, TypeVar

import numpy as np
from scipy.linalg import block_diag

from inercal.arrays import Array
from inercal.benches.turntable.bench import Turntable
from inercal.estimate import Course, Smoothed
from inercal.estimate.kalman import Steps, smoothed, steps
from inercal.methods import temperature
from inercal.methods.turntable.model import Triad, earth
from inercal.methods.turntable.terms import BIAS
from inercal.methods.turntable_kalman import _accelerometers, _readback
from inercal.methods.turntable_kalman._common import Model, Samples
from inercal.parameters import Parameter
from inercal.recording import Track

_NUMBERS = ("nis", "epochs")  # of a state; all else is an array
S = TypeVar("S", _accelerometers.State, _readback.State)
TILT = ("phi_e", "phi_n", "phi_u")
"""φ: how far the attitude that a filter went by is off, about east, north and up."""


class Found(NamedTuple):
    """What a filter has found so far: its states' values from the coefficients on."""

    value: Array  # (s,)
    covariance: Array  # (s, s)
    shared: Array  # (p, p), part of the coefficients' that no innovation shows: gravity's


@dataclass(frozen=True, eq=False)
class Filter(ABC, Generic[S]):
    """The filter of one triad on one table.

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
    """

    part: Triad
    bench: Turntable
    prior: Array
    first: Array
    table: tuple[Parameter, ...]

    name: ClassVar[str]
    unit: ClassVar[str]  # of the first three innovations
    before: ClassVar[tuple[str, ...]]  # states before the coefficients
    rows: ClassVar[int]  # observations of an epoch

    @property
    def own(self) -> tuple[str, ...]:
        """Names of the states of each hold."""
        return ()

    @property
    def states(self) -> tuple[str, ...]:
        """Names of the states."""
        table = (q.name for q in self.table)
        coefficients = self.part.sensor.coefficients
        return (*self.before, *coefficients, *self._drift, *table, *self.own)

    @property
    def _drift(self) -> tuple[str, ...]:
        """Names of the states of the biases' drift."""
        return self.part.drift.names([axis.name for axis in self.part.sensor.axes])

    @property
    def drifting(self) -> tuple[str, ...]:
        """Names of the biases' drift as it is drawn, one an axis; none without drift."""
        axes = self.part.sensor.axes if self.part.drift.varies else ()
        return tuple(f"drift[{axis.name}]" for axis in axes)

    @property
    @abstractmethod
    def varying(self) -> tuple[str, ...]:
        """Names of the states that vary with time and that the data say something of."""

    @property
    def observed(self) -> int:
        """How many components of an epoch are tested."""
        return self.rows

    @property
    def shared(self) -> Array:
        """Part of the coefficients' covariance that no innovation shows, (p, p)."""
        return np.zeros((len(self.first), len(self.first)))

    @abstractmethod
    def start(self, track: Track) -> S:
        """Return the state before the first sample of a track."""

    def begin(self, track: Track) -> "Running[S]":
        """Return the filter before the first sample of a track."""
        return Running(self, self.start(track))

    def step(self, state: S, track: Track, smooth: Sequence[str] = ()) -> tuple[S, Course]:
        """Return the state after the samples of a track, and the course through them.

        Parameters
        ----------
        state : State
        track : Track
            The samples that follow.
        smooth : sequence of str
            States whose course is smoothed by all of the track, as `varying`.
        """
        return self.with_steps(state, track, smooth)[:2]

    @abstractmethod
    def with_steps(
        self, state: S, track: Track, smooth: Sequence[str] = ()
    ) -> tuple[S, Course, Steps]:
        """Return the same, and what the filter did at each epoch where a state is smoothed."""

    def found(self, state: S) -> Found:
        """Return what the filter has found, with biases as means over the run so far."""
        at, p = len(self.before), len(self.first)
        value, covariance = state.x[at:].copy(), state.p[at:, at:].copy()
        value[:p] += state.theta
        if self.part.drift.averaged:
            sample, epoch, start = state.time[:3].tolist()
            by, variance = self.averaging(sample - start, sample - epoch)
            by = by[at:, at:] + np.eye(len(value))
            value, covariance = by @ value, by @ covariance @ by.T + np.diag(variance[at:])
        covariance[:p, :p] += self.shared
        return Found(value, covariance, self.shared)

    def averaging(self, elapsed: float, since: float = 0.0) -> tuple[Array, Array]:
        """Return how biases as means over the run depend on the states, and what varies them more.

        Parameters
        ----------
        elapsed, since : float
            As of `Drift.mean`.

        Returns
        -------
        by : (n, n) array
            What each state adds to each coefficient beyond itself.
        variance : (n,) array
            Of what the drift did since the states were predicted.
        """
        part, n, at = self.part, len(self.states), len(self.before)
        by, variance = np.zeros((n, n)), np.zeros(n)
        first = at + len(self.first)
        rows, beyond = part.drift.mean(elapsed, since)
        for m in np.flatnonzero(part.terms.bias):
            i, weight = part.terms.axis[m], part.terms.weights[m, BIAS]
            by[at + m, first : first + part.drift.size] = rows[i] / weight
            variance[at + m] = beyond[i] / weight**2
        return by, variance

    def covariance(self, before: float) -> Array:
        """Return that of the states before the data, (n, n); of those before the coefficients so.

        What is of each hold is set where that begins.
        """
        return np.asarray(
            block_diag(
                before * np.eye(len(self.before)),
                self.prior,
                self.part.drift.covariance(),
                np.diag([one.sd**2 for one in self.table]),
                np.zeros((len(self.own), len(self.own))),
            )
        )

    def known(self) -> Model:
        """Return what a kernel knows of the triad, and of where it is."""
        part, bench = self.part, self.bench
        return Model(
            part.terms, part.white, part.drift, part.drift.size, earth(bench), bench.gravity.value
        )

    def samples(self, track: Track) -> Samples:
        """Return the samples of a track as a kernel takes them."""
        reading = np.ascontiguousarray(track.reading[:, self.part.channels])
        warmth = temperature.along(track, self.part.sensor)
        return Samples(track.time, reading, track.hold, warmth)

    def room(self, epochs: int, smooth: Sequence[str]) -> tuple[Steps, Array]:
        """Return room for what a kernel does at each epoch, with a way back, and its history."""
        states = self.states
        wanted = np.zeros((len(smooth), len(states)))
        for row, name in zip(wanted, smooth, strict=True):
            if name in states:
                row[states.index(name)] = 1.0
            else:
                self._bias_of(name, row)
        history = np.zeros((epochs, self.rows + 1 + 2 * len(states)))
        return steps(epochs, len(states), len(self.before), self.rows, wanted), history

    def _bias_of(self, name: str, row: Array) -> None:
        """Write how a bias, its constant and the components of its drift, depends on the states."""
        terms, at = self.part.terms, len(self.before)
        i = [axis.name for axis in self.part.sensor.axes].index(name[len("drift[") : -1])
        row[at + len(self.first) + i + 3 * np.arange(len(self.part.drift.times))] = 1.0
        for m in np.flatnonzero(terms.bias & (terms.axis == i)):
            row[at + m] = terms.weights[m, BIAS]

    def after(
        self, state: S, nis: float, time: Array, made: Steps, history: Array, smooth: Sequence[str]
    ) -> tuple[S, Course, Steps]:
        """Return the state after the epochs that a kernel has gone over, their course and steps.

        The states before the coefficients are in the way back alone. Of flicker a bias is the mean
        so far, as the result is; its drift in the way back is its departure from the mean of all
        epochs.

        Parameters
        ----------
        state : State
            As the kernel left it.
        nis : float
            Sum of all epochs so far.
        time : (e,) array
            s, of the epochs.
        made, history
            As of `room`, written.
        smooth : sequence of str
        """
        k, n, m = len(self.before), state.x.size, self.rows
        taken = int((history[:, m] > 0).sum())
        state = state._replace(nis=nis, epochs=state.epochs + taken)
        value, variance = history[:, m + 1 : m + 1 + n], history[:, m + 1 + n :]
        found = None
        if smooth:
            found = self._back(smooth, time - float(state.time[2]), value, made, state.p)
        course = Course(
            self.name, self.states[k:], time, value[:, k:], np.sqrt(variance[:, k:]),
            history[:, :m], history[:, m], found,
        )  # fmt: skip
        return state, course, made

    def _back(
        self, smooth: Sequence[str], elapsed: Array, value: Array, made: Steps, p: Array
    ) -> Smoothed:
        """Return the way back from a covariance p, some s after the filter's start."""
        part, at = self.part, len(self.before)
        value, against = value.copy(), np.zeros(made.wanted.shape)
        if part.drift.averaged and elapsed.size:
            first = at + len(self.first)
            mean = part.drift.so_far(value[:, first : first + part.drift.size], elapsed)
            for m in np.flatnonzero(part.terms.bias):
                weight = part.terms.weights[m, BIAS]
                value[:, at + m] -= mean[:, part.terms.axis[m]] / weight
            whole = np.eye(len(self.states)) + self.averaging(float(elapsed[-1]))[0]
            for row, weights, name in zip(against, made.wanted, smooth, strict=True):
                if name.startswith("drift["):
                    row[at:first] = weights[at:first]
                    row[:] = row @ whole
        added, spread = smoothed(made, against, p)
        # What is known exactly is the difference of equal variances: rounding may leave it below 0.
        std = np.sqrt(np.maximum(spread, 0.0))
        last = against @ value[-1] if elapsed.size else 0.0
        return Smoothed(tuple(smooth), value @ made.wanted.T + added - last, std)


@dataclass
class Running(Generic[S]):
    """A filter, and the state that it has come to."""

    made: Filter[S]
    state: S

    def step(self, track: Track, smooth: Sequence[str] = ()) -> tuple[Course, Steps]:
        """Take in the samples that follow; return as `Filter.with_steps`."""
        self.state, course, made = self.made.with_steps(self.state, track, smooth)
        return course, made

    @property
    def found(self) -> Found:
        """What the filter has found so far."""
        return self.made.found(self.state)

    @property
    def components(self) -> int:
        """How many components of innovations were tested so far."""
        return self.made.observed * self.state.epochs


def copied(state: S) -> S:
    """Return a state of its own, which a kernel may change in place."""
    arrays: dict[str, Array] = {k: v for k, v in state._asdict().items() if k not in _NUMBERS}
    return state._replace(**{name: array.copy() for name, array in arrays.items()})
