"""The frame that the user states, in the place of the rotation that norms leave free.

Norms are those of (R M, R p) for any rotation or reflection R. Of all these one has a symmetric,
positive definite H = M⁻¹, by the polar form::

    H = S Q,   (M, p) → (Q M, Q p),   H → S

That is the frame "symmetric": no axis of the sensor is favoured. Its three conditions H_ij = H_ji
are exact. What moves θ by Δ moves the result by P Δ, Δ and the rotation that restores them::

    P = I − R (C R)⁻¹ C

with the rotations as columns of R and the slopes of H_ij − H_ji as rows of C. P R = 0: what decided
the rotation, a start or chance, has no part in the result, nor in its uncertainty.
"""

import numpy as np

from inercal import frames
from inercal.arrays import Array
from inercal.methods.ship_multi_angle.norm_equations import rotation_directions
from inercal.sensors.affine import AffineModel

_PAIRS = ((1, 2), (2, 0), (0, 1))


def to_symmetric_frame(model: AffineModel) -> AffineModel:
    """Return the models (...) of the same norms in the symmetric frame.

    Raises
    ------
    InputError
        A matrix that is singular.
    """
    mirror = np.sign(np.linalg.det(model.matrix))
    plain = AffineModel(model.matrix * mirror[..., None, None], model.offset * mirror[..., None])
    _, turn = frames.decompose_symmetric(plain.inverse.matrix)
    return AffineModel(turn @ plain.matrix, (turn @ plain.offset[..., None])[..., 0])


def frame_projection(model: AffineModel) -> Array:
    """Return P at models (...) in the symmetric frame, (..., 12, 12)."""
    slope = model.slope
    c = np.stack([slope[..., 3 * i + j, :] - slope[..., 3 * j + i, :] for i, j in _PAIRS], axis=-2)
    r = np.swapaxes(rotation_directions(model), -1, -2)
    return np.eye(12) - r @ np.asarray(np.linalg.solve(c @ r, c), dtype=float)
