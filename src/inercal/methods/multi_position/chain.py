"""Whitening of the rows of rests and passages: a band of their covariance, in the order of time.

Rest i has eight rows that its readings' errors enter: the two of the rotation that reaches it, its
norm, its three rates, the two of the rotation that leaves it. Each such block is added onto a band
of eight diagonals, at 6 i; the rotations' own noise onto theirs. Rows that do not exist (a passage
across a gap) keep a variance of one and take no part. Work and memory grow with the number of
rests.
"""

# SciPy has no stubs.
# pyright: reportMissingTypeStubs=false, reportUnknownVariableType=false

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cholesky_banded, solve_banded

from inercal.arrays import Array
from inercal.methods.multi_position.rests import Rests, Rows, Scatter

Indices = NDArray[np.int64]
Whiten = Callable[[Array], Array]
_STEP = 6  # rows from rest to rest
_ROWS = 8  # that one rest enters
NORM, RATES = 2, slice(3, 6)


class Noise(NamedTuple):
    """The covariance of all rows, in parts that do not depend on one another."""

    rests: Array  # (r, 8, 8), by each rest's readings, of the rows that they enter
    turns: Array  # (k, 2, 2), of the rotations besides


def noise(rests: Rests, rows: Rows, scatter: Scatter) -> Noise:
    """Return how the rows scatter: the readings' noise propagated at `rows`."""
    readings = rests.readings(scatter)
    enter, own = entering(rests, rows), np.zeros((0, 2, 2))
    turns = rows.turns
    if turns is not None and rows.way is not None and rests.passages is not None:
        own = turns.ahead @ rows.way.noise @ np.swapaxes(turns.ahead, -1, -2)
        on_the_way = _on_the_way(rests, rows)
        wander = scatter.rate.excess**2 * 2 * on_the_way @ np.swapaxes(on_the_way, -1, -2)
        own = scatter.turn.of(own) + wander
    return Noise(enter @ readings @ np.swapaxes(enter, -1, -2), own)


def entering(rests: Rests, rows: Rows) -> Array:
    """Return how each rest's readings enter its rows, (r, 8, m + 12) or (r, 8, m).

    The readings are in the order of `Rests.readings`.
    """
    r, m, turns = len(rows.norm.residual), rests.m, rows.turns
    enter = np.zeros((r, _ROWS, m if rests.passages is None else m + 12))
    back = np.broadcast_to(rows.norm.by_reading, (r, 3, m))
    enter[:, NORM, :m] = -(rows.norm.up[:, None, :] @ back)[:, 0]
    if turns is not None and rows.way is not None and rests.passages is not None:
        before = rests.passages.rest
        after = before + 1
        arriving, leaving = _on_ramps(rests, rows)
        on_the_way = _on_the_way(rests, rows)
        enter[:, RATES, m : m + 3] = enter[:, RATES, m + 9 :] = np.eye(3)
        enter[after, :2, :m] = turns.to_after @ back[after]
        enter[after, :2, m + 3 : m + 6] = -turns.ahead
        enter[after, :2, m + 9 :] = arriving + on_the_way
        enter[before, 6:, :m] = turns.to_before @ back[before]
        enter[before, 6:, m + 6 : m + 9] = -turns.ahead @ rows.way.rotation
        enter[before, 6:, m + 9 :] = leaving + on_the_way
    return enter


def _on_ramps(rests: Rests, rows: Rows) -> tuple[Array, Array]:
    """Return what an offset of the gyros on the ramps does to the rotations, (k, 2, 3) each."""
    assert rows.turns is not None
    assert rows.way is not None
    assert rests.passages is not None
    before = rests.passages.rest
    arriving = -rows.turns.ahead * rests.ramps[before + 1, 0, None, None]
    leaving = -rows.turns.ahead @ rows.way.rotation * rests.ramps[before, 1, None, None]
    return arriving, leaving


def _on_the_way(rests: Rests, rows: Rows) -> Array:
    """Return what half an offset of the gyros between the ramps does, (k, 2, 3).

    An offset stays through a rest; on the way it is the mean of those at its ends, and as much
    again of its own.
    """
    assert rows.turns is not None
    assert rows.way is not None
    arriving, leaving = _on_ramps(rests, rows)
    return np.asarray(0.5 * (-rows.turns.ahead @ rows.way.to_bias - arriving - leaving))


def placed(rests: Rests, of_rests: Array) -> Array:
    """Return the sum over rests of what each puts into its eight rows, in the order of `Rows`.

    Parameters
    ----------
    rests : Rests
    of_rests : (r, 8, k) array
    """
    r, _, k = of_rests.shape
    line = np.zeros((_STEP * r + _ROWS - _STEP, k))
    for row in range(_ROWS):
        line[row : row + _STEP * r : _STEP] += of_rests[:, row]
    return line[places(rests)]


def places(rests: Rests, *, norms: bool = True) -> Indices:
    """Return where on the chain each row of `Rows` is."""
    r = len(rests.observations.labels)
    start = _STEP * np.arange(r)
    place = (start + NORM)[: r if norms else 0]
    if rests.passages is not None:
        at = _STEP * (rests.passages.rest + 1)
        of_rates = (start[:, None] + np.arange(_STEP)[RATES]).ravel()
        place = np.concatenate([place, np.stack([at, at + 1], axis=-1).ravel(), of_rates])
    return place


def whitener(rests: Rests, rows: Rows, scatter: Scatter, *, norms: bool = True) -> Whiten:
    """Return a function that whitens columns over all rows, by the noise at `rows`.

    Parameters
    ----------
    rests : Rests
    rows : Rows
        Where the noise is propagated.
    scatter : Scatter
    norms : bool
        Without, the rows of norms are taken out, and the others are whitened by themselves.
    """
    r = len(rows.norm.residual)
    # Two places before and after the chain, for the rotations that the ends do not have.
    band = np.zeros((_ROWS, _STEP * r + _ROWS - _STEP))
    of_rests, of_turns = noise(rests, rows, scatter)
    for column in range(_ROWS):
        for row in range(column, _ROWS):
            stop = column + _STEP * r
            band[row - column, column:stop:_STEP] += of_rests[:, row, column]
    place = places(rests, norms=norms)
    if rests.passages is not None:
        at = _STEP * (rests.passages.rest + 1)
        band[0, at] += of_turns[:, 0, 0]
        band[0, at + 1] += of_turns[:, 1, 1]
        band[1, at] += of_turns[:, 1, 0]
    absent = np.ones(band.shape[1], dtype=np.bool_)
    absent[place] = False
    band[0, absent] = 1.0
    for below in range(1, _ROWS):
        band[below, absent] = 0.0
        band[below, :-below][absent[below:]] = 0.0
    factor: Any = cholesky_banded(band, lower=True)

    def whiten(columns: Array) -> Array:
        flat = columns.reshape(len(columns), -1)
        line = np.zeros((band.shape[1], flat.shape[1]))
        line[place] = flat[0 if norms else r :]
        white: Array = np.asarray(solve_banded((_ROWS - 1, 0), factor, line), dtype=np.float64)
        return white[place].reshape(-1, *columns.shape[1:])

    return whiten
