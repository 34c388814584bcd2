"""The base class of both filters, which process tracks in pieces.

The states are the attitude error, the velocity for accelerometers, the coefficients, the drift of
the biases (`turntable.drift`), the table's parameters, and the states of each hold, in this order.
"""
# SciPy has no type stubs.
# pyright: reportMissingTypeStubs=false, reportUnknownVariableType=false

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import ClassVar, Generic

import numpy as np
from scipy.linalg import block_diag

from inercal.basics.arrays import Array, Indices
from inercal.basics.parameters import Parameter
from inercal.benches.turntable.bench import Turntable
from inercal.estimation import FilterHistory
from inercal.estimation.innovations import StateEstimate
from inercal.estimation.kalman import FilterSteps, allocate_steps
from inercal.estimation.lazy_value import LazyValue
from inercal.methods import temperature
from inercal.methods.turntable import BIAS, strapdown
from inercal.methods.turntable.model import EPOCH_PERIOD, TriadModel, earth_rate_level_frame
from inercal.methods.turntable_kalman._filter_steps import (
    INNOVATION_GATE,
    FilterSamples,
    KernelModel,
    KernelWorkspace,
    allocate_workspace,
)
from inercal.methods.turntable_kalman.filtered_track import (
    FilteredTrack,
    FilterPiece,
    S,
    filter_track,
)
from inercal.recordings import Track

_NONE = np.zeros(0)
TILT = ("phi_e", "phi_n", "phi_u")
"""φ: the error of the attitude that a filter uses, about east, north and up."""


@dataclass(frozen=True, eq=False)
class Filter(ABC, Generic[S]):
    """The filter for one triad on one table.

    Parameters
    ----------
    triad : TriadModel
    bench : Turntable
    prior : (p, p) array
        Covariance of the coefficients before the data.
    initial_values : (p,) array
        Values of the coefficients before the data.
    table : tuple of q Parameter
        Table parameters that are states after the drift.
    epoch : float
        Time between epochs, s. Once per epoch the covariance is propagated and observations are
        used.
    """

    triad: TriadModel
    bench: Turntable
    prior: Array
    initial_values: Array
    table: tuple[Parameter, ...]
    epoch: float = field(default=EPOCH_PERIOD, kw_only=True)

    name: ClassVar[str]
    unit: ClassVar[str]  # of the first three innovations
    leading_states: ClassVar[tuple[str, ...]]  # states before the coefficients
    rows: ClassVar[int]  # number of observations per epoch

    @property
    def hold_states(self) -> tuple[str, ...]:
        """Names of the states that belong to each hold."""
        return ()

    @cached_property
    def states(self) -> tuple[str, ...]:
        """Names of the states."""
        table = (q.name for q in self.table)
        coefficients = self.triad.sensor.coefficients
        return (*self.leading_states, *coefficients, *self._drift, *table, *self.hold_states)

    @property
    def _drift(self) -> tuple[str, ...]:
        """Names of the drift states of the biases."""
        return self.triad.drift.names([axis.name for axis in self.triad.sensor.axes])

    @property
    def bias_drift(self) -> tuple[str, ...]:
        """Names of the biases' drift in plots, one per axis; empty without drift."""
        axes = self.triad.sensor.axes if self.triad.drift.varies else ()
        return tuple(f"drift[{axis.name}]" for axis in axes)

    @property
    @abstractmethod
    def time_varying_states(self) -> tuple[str, ...]:
        """Names of the states that vary with time and that the data determine."""

    @property
    def tested_components(self) -> int:
        """Number of components that are tested per epoch."""
        return self.rows

    @cached_property
    def shared_covariance(self) -> Array:
        """Part of the coefficients' covariance that no innovation shows, (p, p)."""
        return np.zeros((len(self.initial_values), len(self.initial_values)))

    @abstractmethod
    def start(self, track: Track) -> S:
        """Return the state before the first sample of a track."""

    def begin(self, track: Track) -> "RunningFilter[S]":
        """Return the filter before the first sample of a track."""
        return RunningFilter(self, self.start(track))

    def step(self, state: S, track: Track, smooth: Sequence[str] = ()) -> tuple[S, FilterHistory]:
        """Return the state after the samples of a track, and its history over them.

        Parameters
        ----------
        state : State
        track : Track
            The next samples.
        smooth : sequence of str
            States that are smoothed over the whole track, from `time_varying_states`.
        """
        made = self.follow(state, track)
        course = made.history
        if smooth:
            course = replace(course, smoothing=LazyValue(lambda: made.smoothed(smooth)))
        return made.state, course

    def follow(self, state: S, track: Track) -> FilteredTrack[S]:
        """Process the samples of a track, and return the filter with a record of its steps."""
        return filter_track(self, state, track)

    @abstractmethod
    def advance(self, state: S, track: Track, wanted: Array | None = None) -> tuple[S, FilterPiece]:
        """Process a piece of a track, and return the state and a record of the steps.

        Parameters
        ----------
        state : State
            Its arrays are changed in place.
        track : Track
        wanted : (r, n) array, optional
            Weights of r sums of states. If given, the steps of each epoch are stored with these
            sums.
        """

    def estimate(self, state: S) -> StateEstimate:
        """Return the states from the coefficients on, with biases as means over the run so far."""
        at, p = len(self.leading_states), len(self.initial_values)
        value, covariance = state.x[at:].copy(), state.p[at:, at:].copy()
        value[:p] += state.theta
        if self.triad.drift.mean_over_run:
            sample, epoch, start = state.time[:3].tolist()
            self._refer_biases_to_mean(value, covariance, sample - start, sample - epoch)
        covariance[:p, :p] += self.shared_covariance
        return StateEstimate(value, covariance)

    def _refer_biases_to_mean(
        self, value: Array, covariance: Array, elapsed: float, since: float
    ) -> None:
        """Convert biases to means over the run, in place, in an estimate from the coefficients on.

        The conversion is that of `mean_bias_transform`; only the rows of biases change.
        """
        terms, biases = self.triad.terms, self._term_indices[2]
        first = len(self.initial_values)
        drift = slice(first, first + self.triad.drift.size)
        rows, beyond = self.triad.drift.mean(elapsed, since)
        weight, axis = terms.weights[biases, BIAS], terms.axis[biases]
        by = rows[axis] / weight[:, None]
        value[biases] += by @ value[drift]
        moved = by @ covariance[drift]
        covariance[biases] += moved
        covariance[:, biases] += moved.T
        covariance[np.ix_(biases, biases)] += moved[:, drift] @ by.T
        covariance[biases, biases] += beyond[axis] / weight**2

    def mean_bias_transform(self, elapsed: float, since: float = 0.0) -> Array:
        """Return the effect of each state on each mean bias, beyond the bias itself, (n, n).

        The times are those of `Drift.mean`.
        """
        part, at = self.triad, len(self.leading_states)
        by = np.zeros((len(self.states), len(self.states)))
        first = at + len(self.initial_values)
        rows, _ = part.drift.mean(elapsed, since)
        for m in np.flatnonzero(part.terms.bias):
            weight = part.terms.weights[m, BIAS]
            by[at + m, first : first + part.drift.size] = rows[part.terms.axis[m]] / weight
        return by

    def covariance(self, before: float) -> Array:
        """Return the prior covariance of the states, (n, n).

        `before` is the variance of the states before the coefficients. The variance of the states
        that belong to a hold is set at the start of the hold.
        """
        return np.asarray(
            block_diag(
                before * np.eye(len(self.leading_states)),
                self.prior,
                self.triad.drift.covariance(),
                self.bench.qualified.joint_covariance(self.table),
                np.zeros((len(self.hold_states), len(self.hold_states))),
            )
        )

    @staticmethod
    def innovation_gate(track: Track) -> float:
        """Return the largest accepted innovation, in standard deviations, or infinity for no gate.

        A gate protects against table readings that may contain a wrong digit. If a recording states
        an angle for every sample, no gate is needed, because such errors are found when the
        recording is read.
        """
        return np.inf if track.angle_quality is None else INNOVATION_GATE

    @cached_property
    def kernel_model(self) -> KernelModel:
        """The model of the triad at its location, in the form that a kernel needs."""
        part, bench = self.triad, self.bench
        earth, gravity = earth_rate_level_frame(bench), bench.gravity.value
        return KernelModel(part.terms, part.white, part.drift, part.drift.size, earth, gravity)

    def workspace(self) -> KernelWorkspace:
        """Return work arrays for a kernel."""
        n, k = len(self.states), len(self.leading_states)
        return allocate_workspace(self.kernel_model, self._term_indices, n, k, self.rows)

    @cached_property
    def _term_indices(self) -> tuple[Indices, Indices, Indices]:
        """The indices that are the first fields of a workspace."""
        terms = self.triad.terms
        used = strapdown.used_term_indices(terms.weights)
        return used, strapdown.added_term_indices(used, terms.first), np.flatnonzero(terms.bias)

    def samples(self, track: Track) -> FilterSamples:
        """Return the samples of a track in the form that a kernel needs."""
        reading = np.ascontiguousarray(track.reading[:, self.triad.channels])
        depends = self.triad.terms.has_temperature
        warmth = temperature.sample_offsets(track, self.triad.sensor) if depends else _NONE
        return FilterSamples(track.time, reading, track.hold, warmth)

    def allocate_steps(self, epochs: int, wanted: Array | None) -> tuple[FilterSteps, Array]:
        """Return arrays for a kernel's steps and history; `wanted` is as for `advance`."""
        n, kept = len(self.states), 1 if wanted is None else epochs
        sums = np.zeros((0, n)) if wanted is None else wanted
        steps = allocate_steps(kept, n, len(self.leading_states), self.rows, sums)
        return steps, np.empty((epochs, self.rows + 1 + 2 * n))

    def state_sums(self, names: Sequence[str]) -> Array:
        """Return the weights of the states in the quantities of `time_varying_states`, (r, n)."""
        states = self.states
        wanted = np.zeros((len(names), len(states)))
        for row, name in zip(wanted, names, strict=True):
            if name in states:
                row[states.index(name)] = 1.0
            else:
                self._write_bias_weights(name, row)
        return wanted

    def _write_bias_weights(self, name: str, row: Array) -> None:
        """Write the weights of the states in a bias: its constant and its drift components."""
        terms, at = self.triad.terms, len(self.leading_states)
        i = [axis.name for axis in self.triad.sensor.axes].index(name[len("drift[") : -1])
        row[at + len(self.initial_values) + i + 3 * np.arange(len(self.triad.drift.times))] = 1.0
        for m in np.flatnonzero(terms.bias & (terms.axis == i)):
            row[at + m] = terms.weights[m, BIAS]

    def count_dof(self, state: S, nis: float, made: FilterPiece, tested: Indices, free: int) -> S:
        """Return a state with the sum of NIS and its degrees of freedom, updated after a piece.

        Parameters
        ----------
        state : State
        nis : float
        made : FilterPiece
        tested : (e,) array of int
            Number of tested components in each epoch that has innovations.
        free : int
            Number of these components that only determine φ after it was taken from the readback.
            Such innovations are small compared with the initial variance of φ.
        """
        taken = made.history[:, self.rows] > 0
        return state._replace(nis=nis, dof=state.dof + int(tested[taken].sum()) - free)


@dataclass
class RunningFilter(Generic[S]):
    """A filter together with its current state."""

    filter: Filter[S]
    state: S

    def step(self, track: Track) -> None:
        """Process the next samples."""
        self.state = self.filter.advance(self.state, track)[0]

    def follow(self, track: Track) -> FilteredTrack[S]:
        """Process the next samples, and return a record of the filter's steps."""
        made = self.filter.follow(self.state, track)
        self.state = made.state
        return made

    @property
    def estimate(self) -> StateEstimate:
        """The current estimate."""
        return self.filter.estimate(self.state)

    @property
    def rejections(self) -> int:
        """Number of readbacks rejected so far because their innovations exceeded the gate."""
        return int(self.state.rejections[1])

    @property
    def dof(self) -> int:
        """Degrees of freedom of NIS so far: innovation components except those that determine φ.

        The coefficients are treated as known.
        """
        return max(self.state.dof, 0)
