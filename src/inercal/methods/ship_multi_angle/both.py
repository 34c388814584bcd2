"""Untilted states as vectors and tilted ones as norms, all rows alike.

    minimise Σ |M a + p − f|² over untilted states + Σ (|M a + p| − √(A² + 1))² over tilted ones

The vectors tell the rotations that norms leave free, so that nothing has to be damped. The weights
are those of equal errors in g, and no nuisance is estimated: `joint` does both better. Ours.
"""

import numpy as np
from numpy.typing import NDArray

from inercal.estimate import Problem, least_squares
from inercal.methods.affine import IDEAL, NAMES, Affine
from inercal.methods.ship_multi_angle.norms import rows

Array = NDArray[np.float64]


def linearised(
    model: Affine, level: Array, f: Array, groups: Array, square: Array
) -> tuple[Array, Array]:
    """Return what was felt minus what the model says, (..., 3 r + s) g, and its slopes by θ.

    Parameters
    ----------
    model : Affine
    level, f : (..., r, 3) and (r, 3) arrays
        Readings of untilted states, and what the bench says was felt, g.
    groups, square : (..., s, 3) and (s,) arrays
        Readings of tilted states, g, and A² + 1, g².
    """
    away = f - model.correct(level)
    length = np.linalg.norm(model.correct(groups), axis=-1)
    by_vector = np.zeros((*away.shape, 12))
    for axis in range(3):
        by_vector[..., axis, 3 * axis : 3 * axis + 3] = level
        by_vector[..., axis, 9 + axis] = 1.0
    by_norm = rows(model, groups) / (2 * length[..., None])
    lead = away.shape[:-2]
    return (
        np.concatenate([away.reshape(*lead, -1), np.sqrt(square) - length], axis=-1),
        np.concatenate([by_vector.reshape(*lead, -1, 12), by_norm], axis=-2),
    )


def solve(
    level: Array, f: Array, groups: Array, square: Array
) -> tuple[Affine, Array, NDArray[np.bool_]]:
    """Return the model, how θ moves with an error of each row, (..., 12, 3 r + s), and converged.

    Arguments as of `linearised`.
    """

    def at(x: Array) -> tuple[Array, Array]:
        lead = np.broadcast_shapes(x.shape[:-1], level.shape[:-2])
        model = Affine.of(np.broadcast_to(x, (*lead, 12)))
        return linearised(model, level, f, groups, square)

    m = f.size + len(square)
    found = least_squares(Problem(NAMES, IDEAL, at, np.ones(m), np.ones(12)))
    _, slope = at(found.value)
    return Affine.of(found.value), -np.asarray(np.linalg.pinv(slope), dtype=float), found.converged
