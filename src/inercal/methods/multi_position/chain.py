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

from inercal.methods.multi_position.rests import Rests, Rows, Scatter

Array = NDArray[np.float64]
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
    r, m, turns = len(rows.norm.residual), rests.m, rows.turns
    readings = rests.readings(scatter)
    enter = np.zeros((r, _ROWS, readings.shape[-1]))
    back = np.broadcast_to(rows.norm.by_reading, (r, 3, m))
    enter[:, NORM, :m] = -(rows.norm.up[:, None, :] @ back)[:, 0]
    own = np.zeros((0, 2, 2))
    if turns is not None and rows.way is not None and rests.passages is not None:
        before = rests.passages.rest
        after = before + 1
        arriving = -turns.ahead * rests.ramps[after, 0, None, None]
        leaving = -turns.ahead @ rows.way.rotation * rests.ramps[before, 1, None, None]
        # An offset stays through a rest; on the way it is the mean of those at its ends, and as
        # much again of its own.
        on_the_way = 0.5 * (-turns.ahead @ rows.way.to_bias - arriving - leaving)
        enter[:, RATES, m : m + 3] = enter[:, RATES, m + 9 :] = np.eye(3)
        enter[after, :2, :m] = turns.to_after @ back[after]
        enter[after, :2, m + 3 : m + 6] = -turns.ahead
        enter[after, :2, m + 9 :] = arriving + on_the_way
        enter[before, 6:, :m] = turns.to_before @ back[before]
        enter[before, 6:, m + 6 : m + 9] = -turns.ahead @ rows.way.rotation
        enter[before, 6:, m + 9 :] = leaving + on_the_way
        own = turns.ahead @ rows.way.noise @ np.swapaxes(turns.ahead, -1, -2)
        wander = scatter.rate.excess**2 * 2 * on_the_way @ np.swapaxes(on_the_way, -1, -2)
        own = scatter.turn.of(own) + wander
    return Noise(enter @ readings @ np.swapaxes(enter, -1, -2), own)


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
    start = _STEP * np.arange(r)
    place = (start + NORM)[: r if norms else 0]
    if rests.passages is not None:
        at = _STEP * (rests.passages.rest + 1)
        band[0, at] += of_turns[:, 0, 0]
        band[0, at + 1] += of_turns[:, 1, 1]
        band[1, at] += of_turns[:, 1, 0]
        of_rates = (start[:, None] + np.arange(_STEP)[RATES]).ravel()
        place = np.concatenate([place, np.stack([at, at + 1], axis=-1).ravel(), of_rates])
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
