"""Process a track piece by piece with limited memory, and smooth the result.

The state before each piece is stored. The record of a piece, 5 to 8 kB per epoch, is recomputed
from this state when it is needed: forward for the tests, backward for the smoother. A filter that
processes pieces takes exactly the same steps, to the last bit. Kernels change the state of a
filter in place.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Generic, NamedTuple, TypeVar

import numpy as np

from inercal.basics.arrays import Array
from inercal.estimation import FilterHistory, SmoothedStates
from inercal.estimation.kalman import FilterSteps, smooth_steps, start_smoother
from inercal.methods.turntable import BIAS
from inercal.methods.turntable_kalman import _accelerometers, _readback
from inercal.recordings import Track

_SCALAR_FIELDS = ("nis", "dof")  # of a state; all other fields are arrays
S = TypeVar("S", _accelerometers.VelocityState, _readback.AttitudeState)


def copy_state(state: S) -> S:
    """Return a copy of a state, which a kernel may change in place."""
    arrays: dict[str, Array] = {k: v for k, v in state._asdict().items() if k not in _SCALAR_FIELDS}
    return state._replace(**{name: array.copy() for name, array in arrays.items()})


if TYPE_CHECKING:
    from inercal.methods.turntable_kalman.filter import Filter

# Limits for a piece. Its epochs need most of the memory, or at a high rate its samples. The states
# before the pieces take 30 kB each.
PIECE_EPOCHS, PIECE_SAMPLES = 1024, 1 << 16
MAX_SHOWN_EPOCHS = 20_000  # number of estimates over time, far more than a figure can show


class FilterPiece(NamedTuple):
    """A filter's record for a piece of a track with e epochs."""

    time: Array  # (e,) s, times of the epochs
    steps: FilterSteps  # for each epoch, or only for the last one
    # (e, m + 1 + 2 n): innovations, NIS, estimates and variances
    history: Array


@dataclass(eq=False)
class FilteredTrack(Generic[S]):
    """A filter after a track, with a record of its steps.

    Parameters
    ----------
    filter : Filter
    track : Track
    starts : list of int
        Index of the first sample of each piece.
    before : list of S
        The state before each piece.
    state : S
        The state after the last piece.
    history : FilterHistory
    """

    filter: "Filter[S]"
    track: Track
    starts: list[int]
    before: list[S]
    state: S
    history: FilterHistory

    def pieces(self) -> Iterator[FilterPiece]:
        """Yield the record for each piece, with the steps of each epoch."""
        none = np.zeros((0, len(self.filter.states)))
        for k in range(len(self.starts)):
            yield self._repeat(k, none)

    def _repeat(self, k: int, wanted: Array) -> FilterPiece:
        stop = [*self.starts[1:], self.track.time.size][k]
        part = self.track.slice(self.starts[k], stop)
        return self.filter.advance(copy_state(self.before[k]), part, wanted)[1]

    def smoothed(self, names: Sequence[str]) -> SmoothedStates:
        """Return the time course of varying states, smoothed over the whole track.

        If there is flicker, a bias is the mean so far, as in the result. The smoothed drift is the
        departure from the mean over all epochs.

        Parameters
        ----------
        names : sequence of str
            Names from `Filter.time_varying_states`.
        """
        course, p = self.history, self.state.p
        wanted = self.filter.state_sums(names)
        elapsed = course.time - float(self.state.time[2])
        shown = np.arange(elapsed.size) if course.shown is None else course.shown
        against = self._weights_at_the_end(names, wanted, elapsed)
        last = np.einsum("rn,nm,rm->r", against, p, against)
        back = start_smoother(against)
        value, spread = (np.zeros((shown.size, len(names))) for _ in range(2))
        stop, end = elapsed.size, np.zeros(len(names))
        for k in range(len(self.starts) - 1, -1, -1):
            made = self._repeat(k, wanted)
            first = stop - made.time.size
            rows = slice(*np.searchsorted(shown, [first, stop]).tolist())
            at = shown[rows] - first
            smooth_steps(made.steps, back, last, at, value[rows], spread[rows])
            found = self._without_mean(made.history[at], elapsed[shown[rows]])
            if stop == elapsed.size and at.size:
                end = against @ found[-1]
            value[rows] += found @ wanted.T - end
            stop = first
        # The variance of a known state is a difference of equal numbers: rounding may make it < 0.
        return SmoothedStates(tuple(names), value, np.sqrt(np.maximum(spread, 0.0)))

    def _weights_at_the_end(self, names: Sequence[str], wanted: Array, elapsed: Array) -> Array:
        """Return the weights of the final states, which each sum is a difference from."""
        part, against = self.filter, np.zeros(wanted.shape)
        if part.triad.drift.mean_over_run and elapsed.size:
            at = len(part.leading_states)
            first = at + len(part.initial_values)
            whole = np.eye(wanted.shape[1]) + part.mean_bias_transform(float(elapsed[-1]))
            for row, weights, name in zip(against, wanted, names, strict=True):
                if name.startswith("drift["):
                    row[at:first] = weights[at:first]
                    row[:] = row @ whole
        return against

    def _without_mean(self, history: Array, elapsed: Array) -> Array:
        """Return the estimates in k rows of a history, with biases without their mean drift."""
        part, n, m = self.filter, len(self.filter.states), self.filter.rows
        value, drift = history[:, m + 1 : m + 1 + n].copy(), part.triad.drift
        if drift.mean_over_run and elapsed.size:
            at = len(part.leading_states)
            first = at + len(part.initial_values)
            mean = drift.running_mean(value[:, first : first + drift.size], elapsed)
            terms = part.triad.terms
            for i in np.flatnonzero(terms.bias):
                value[:, at + i] -= mean[:, terms.axis[i]] / terms.weights[i, BIAS]
        return value


def filter_track(
    filter_: "Filter[S]", state: S, track: Track, piece: int | None = None
) -> FilteredTrack[S]:
    """Process the samples of a track, and return the filter with a record of its steps.

    Parameters
    ----------
    filter_ : Filter
    state : S
        State before the samples, which is not changed.
    track : Track
    piece : int, optional
        Number of samples per piece.
    """
    n, epoch = track.time.size, filter_.epoch
    seconds = float(track.time[-1] - track.time[0]) if n else 0.0
    if piece is None:
        samples = max(round(epoch * n / seconds), 1) if seconds else 1  # per epoch
        piece = min(PIECE_EPOCHS * samples, PIECE_SAMPLES)
    starts = list(range(0, n, max(piece, 1))) or [0]
    stride = max(-int(-seconds // (epoch * MAX_SHOWN_EPOCHS)), 1)
    m, k, names = filter_.rows, len(filter_.leading_states), filter_.states
    before: list[S] = []
    times: list[Array] = []
    tested: list[Array] = []  # (e, m + 1), innovations and NIS
    kept: list[Array] = []  # estimates and variances
    shown: list[int] = []  # indices of regularly spaced epochs, and of the last
    last, count = np.zeros((0, 0)), 0
    for start, stop in zip(starts, [*starts[1:], n], strict=True):
        before.append(state)
        state, made = filter_.advance(copy_state(state), track.slice(start, stop))
        times.append(made.time)
        tested.append(made.history[:, : m + 1].copy())
        at = range(-count % stride, made.time.size, stride)
        kept.append(made.history[at, m + 1 :])
        shown += [count + epoch_of_piece for epoch_of_piece in at]
        count += made.time.size
        if made.time.size:
            last = made.history[-1:, m + 1 :].copy()
    if count and shown[-1] != count - 1:
        shown.append(count - 1)
        kept.append(last)
    found, seen = np.concatenate(kept), np.concatenate(tested)
    # Only the smoothed time course contains the states before the coefficients.
    history = FilterHistory(
        filter_.name, tuple(names[k:]), np.concatenate(times),
        found[:, k : len(names)].copy(), np.sqrt(found[:, len(names) + k :]),
        seen[:, :m], seen[:, m], shown=None if stride == 1 else np.array(shown, dtype=np.int64),
    )  # fmt: skip
    return FilteredTrack(filter_, track, starts, before, state, history)
