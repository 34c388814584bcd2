"""Whitening of the rows of rests and passages: a band of their covariance, in the order of time.

Rest i has five rows that its readings' errors enter: the two of the rotation that reaches it, its
norm, the two of the rotation that leaves it. Each such block J Σ_i Jᵀ is added onto a band of five
diagonals, at 3 i; the rotations' own noise onto theirs. Rows that do not exist (a passage across a
gap) keep a variance of one and take no part. Work and memory grow with the number of rests.
"""

# SciPy has no stubs.
# pyright: reportMissingTypeStubs=false, reportUnknownVariableType=false

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cholesky_banded, solve_banded

from inercal.methods.rests import Rests, Rows, Scatter

Array = NDArray[np.float64]
Whiten = Callable[[Array], Array]


def whitener(rests: Rests, rows: Rows, scatter: Scatter, *, norms: bool = True) -> Whiten:
    """Return a function that whitens columns over all rows, by the noise at `rows`.

    Parameters
    ----------
    rests : Rests
    rows : Rows
        Where the noise is propagated.
    scatter : Scatter
    norms : bool
        Without, the rows of norms are taken out, and the rotations are whitened by themselves.
    """
    r, turns = len(rows.norm.residual), rows.turns
    k = 0 if turns is None else len(turns.residual)
    # Two places before and after the chain, for the rotations that the ends do not have.
    band = np.zeros((5, 3 * r + 2))
    to_reading = np.zeros((r, 5, rests.m))
    back = np.broadcast_to(rows.norm.by_reading, (r, 3, rests.m))
    place = np.zeros(0, dtype=np.int64)
    if norms:
        to_reading[:, 2] = -(rows.norm.up[:, None, :] @ back)[:, 0]
        place = 3 * np.arange(r) + 2
    if turns is not None and rests.passages is not None:
        before = rests.passages.rest
        to_reading[before, 3:] = turns.to_before @ back[before]
        to_reading[before + 1, :2] = turns.to_after @ back[before + 1]
        own, at = rests.turn_noise(turns, scatter), 3 * before + 3
        band[0, at], band[0, at + 1], band[1, at] = own[:, 0, 0], own[:, 1, 1], own[:, 1, 0]
        place = np.concatenate([place, np.stack([at, at + 1], axis=-1).ravel()])
    noise = rests.noise[:, : rests.m, : rests.m] + scatter.force**2 * np.eye(rests.m)
    spread = to_reading @ noise @ np.swapaxes(to_reading, -1, -2)
    for column in range(5):
        for row in range(column, 5):
            band[row - column, column : column + 3 * r - 2 : 3] += spread[:, row, column]
    absent = np.ones(band.shape[1], dtype=np.bool_)
    absent[place] = False
    band[0, absent] = 1.0
    factor: Any = cholesky_banded(band, lower=True)
    of_rates = np.zeros((0, 0, 0))
    if turns is not None:
        of_rates = np.linalg.inv(np.linalg.cholesky(rests.rate_noise(scatter)))

    def whiten(columns: Array) -> Array:
        flat = columns.reshape(len(columns), -1)
        line = np.zeros((band.shape[1], flat.shape[1]))
        line[place] = flat[0 if norms else r : r + 2 * k]
        done: list[Array] = [solve_banded((4, 0), factor, line)[place]]
        if turns is not None:
            rates = flat[r + 2 * k :].reshape(r, -1, flat.shape[1])
            done.append((of_rates @ rates).reshape(-1, flat.shape[1]))
        return np.concatenate(done).reshape(-1, *columns.shape[1:])

    return whiten
