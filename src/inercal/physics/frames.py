"""Rotate between frames, and decompose a triad's matrix into shape and attitude in two ways.

vec_a contains a vector's components in frame a; mat_ab transforms them from b to a: vec_a = mat_ab
vec_b. Every function is batched over leading axes: it accepts `(..., 3)` or `(..., 3, 3)`.

A rotation vector ρ rotates by the angle θ = |ρ| about ρ/θ, right-handed (Rodrigues)::

    exp(ρ) = I + (sin θ/θ) [ρ×] + ((1 − cos θ)/θ²) [ρ×]²

A triad's matrix M (sensor axes as rows) is decomposed into shape and attitude as M = L Q with L
lower triangular, which ties the first sensor axis to the frame, or as M = S Q with S symmetric (the
polar decomposition), which favours no axis. Q is a rotation in both decompositions. Sources: Golub
and Van Loan, Matrix Computations, 4th edition, 5.2 (QR) and 9.4.3 (polar).
"""

import numpy as np
from numpy.typing import ArrayLike

from inercal.basics.arrays import Array
from inercal.basics.errors import InputError


def transform(mat: Array, vector: Array) -> Array:
    """Return mat v for matrices (..., m, n) and vectors (..., n), (..., m)."""
    return (mat @ vector[..., None])[..., 0]


def stack_components(*components: Array) -> Array:
    """Return vectors, (..., m), from m components, (...) each, which may be broadcast."""
    return np.stack(np.broadcast_arrays(*components), axis=-1)


def skew(v: ArrayLike) -> Array:
    """Return the cross-product matrix [v×], so that skew(v) @ u = v × u.

    Parameters
    ----------
    v : (..., 3) array

    Returns
    -------
    (..., 3, 3) array
    """
    v = np.asarray(v, dtype=float)
    mat = np.zeros((*v.shape, 3))
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        mat[..., j, k], mat[..., k, j] = -v[..., i], v[..., i]
    return mat


def exp_so3(rotvec: ArrayLike) -> Array:
    """Return the rotation matrix of a rotation vector, exact to rounding at any angle.

    Parameters
    ----------
    rotvec : (..., 3) array
        Rotation vector, rad.

    Returns
    -------
    (..., 3, 3) array

    Examples
    --------
    >>> exp_so3([0.0, 0.0, np.pi / 2]).round(12) + 0.0
    array([[ 0., -1.,  0.],
           [ 1.,  0.,  0.],
           [ 0.,  0.,  1.]])
    """
    cross = skew(rotvec)
    theta = np.linalg.norm(np.asarray(rotvec, dtype=float), axis=-1)[..., None, None]
    divisor = np.where(theta == 0, 1.0, theta)
    first = np.where(theta == 0, 1.0, np.sin(theta) / divisor)
    # Compute (1 − cos θ)/θ² from the half angle, which avoids cancellation near 0.
    half = np.where(theta == 0, 0.5, np.sin(theta / 2) / divisor)
    return np.eye(3) + first * cross + 2 * half**2 * (cross @ cross)


def left_jacobian(rotvec: ArrayLike) -> Array:
    """Return the left Jacobian J, so that exp(ρ + δ) = exp(J δ) exp(ρ) to first order in δ.

    J = I + ((1 − cos θ)/θ²) [ρ×] + ((θ − sin θ)/θ³) [ρ×]² (Solà, Deray and Atchuthan 2018, A micro
    Lie theory for state estimation in robotics, equation 145).

    Parameters
    ----------
    rotvec : (..., 3) array
        Rotation vector ρ, rad.

    Returns
    -------
    (..., 3, 3) array
    """
    rotvec = np.asarray(rotvec, dtype=float)
    angle = np.linalg.norm(rotvec, axis=-1)[..., None, None]
    small = angle < 1e-3
    safe = np.where(small, 1.0, angle)
    once = np.where(small, 0.5 - angle**2 / 24, (1 - np.cos(safe)) / safe**2)
    twice = np.where(small, 1 / 6 - angle**2 / 120, (safe - np.sin(safe)) / safe**3)
    cross = skew(rotvec)
    return np.eye(3) + once * cross + twice * cross @ cross


def log_so3(mat: ArrayLike) -> Array:
    """Return the rotation vector, of length 0 … π, of a rotation matrix; the inverse of `exp_so3`.

    The unit quaternion is computed from its largest component, with full precision near 0 and near
    π (Shepperd, J. Guidance and Control 1 (1978) 223). At π, where ρ and −ρ are the same rotation,
    either may be returned.

    Parameters
    ----------
    mat : (..., 3, 3) array
        Rotations.

    Returns
    -------
    (..., 3) array
        rad.
    """
    mat = np.asarray(mat, dtype=float)
    (xx, xy, xz), (yx, yy, yz), (zx, zy, zz) = np.moveaxis(mat, (-2, -1), (0, 1))
    products = np.stack(  # 4 q qᵀ of the quaternion q = (w, x, y, z), row by row
        [
            np.stack([1 + xx + yy + zz, zy - yz, xz - zx, yx - xy], axis=-1),
            np.stack([zy - yz, 1 + xx - yy - zz, xy + yx, xz + zx], axis=-1),
            np.stack([xz - zx, xy + yx, 1 - xx + yy - zz, yz + zy], axis=-1),
            np.stack([yx - xy, xz + zx, yz + zy, 1 - xx - yy + zz], axis=-1),
        ],
        axis=-2,
    )
    largest = np.diagonal(products, axis1=-2, axis2=-1).argmax(axis=-1)[..., None, None]
    q: Array = np.take_along_axis(products, largest, axis=-2)[..., 0, :]
    q = q / np.linalg.norm(q, axis=-1, keepdims=True)
    q = np.where(q[..., :1] < 0, -q, q)
    length = np.linalg.norm(q[..., 1:], axis=-1, keepdims=True)
    divisor = np.where(length == 0, 1.0, length)
    stretch = np.where(length == 0, 2.0, 2 * np.arctan2(length, q[..., :1]) / divisor)
    return stretch * q[..., 1:]


def attitude_from_vertical(up: ArrayLike, azimuth: ArrayLike = 0.0) -> Array:
    """Return the attitude of a body from its upward direction and its azimuth.

    The frame n is level: east, north, up. At `azimuth` 0 the body is the level frame n after a tilt
    (the shortest rotation, if up's z is not negative). `azimuth` then rotates the body about the
    vertical, clockwise seen from above, as a compass counts.

    Parameters
    ----------
    up : (..., 3) array
        The upward vertical in the body's frame b, with any nonzero length.
    azimuth : (...) array or float
        Azimuth, rad.

    Returns
    -------
    (..., 3, 3) array
        mat_bn: its last column is the unit vector along `up`.

    Raises
    ------
    InputError
        A direction has length 0 or is not finite.
    """
    up_b = np.asarray(up, dtype=float)
    length = np.linalg.norm(up_b, axis=-1, keepdims=True)
    if not np.all((length > 0) & np.isfinite(length)):
        raise InputError(
            "up has a direction whose length is 0 or not finite; give vectors (..., 3) with a "
            "finite length above 0",
            key="up",
        )
    x, y, z = np.moveaxis(up_b / length, -1, 0)
    # Duff et al., J. Computer Graphics Techniques 6 (2017) 1: orthonormal for every direction.
    sign = np.copysign(1.0, z)
    a = -1 / (sign + z)
    east = np.stack([1 + sign * x * x * a, sign * x * y * a, -sign * x], axis=-1)
    north = np.stack([x * y * a, sign + y * y * a, -y], axis=-1)
    tipped = np.stack([east, north, np.stack([x, y, z], axis=-1)], axis=-1)
    turn = np.asarray(azimuth, dtype=float)[..., None] * np.array([0.0, 0.0, 1.0])
    return tipped @ exp_so3(turn)


def decompose_triangular(mat: ArrayLike) -> tuple[Array, Array]:
    """Return L, lower triangular with a positive diagonal, and a rotation Q, so that mat = L Q.

    Parameters
    ----------
    mat : (..., 3, 3) array
        Any invertible matrix; its rows may have very different lengths.

    Returns
    -------
    L, Q : (..., 3, 3) arrays

    Raises
    ------
    InputError
        The matrix is singular, mirrored (determinant < 0) or not finite.
    """
    mat = _require_decomposable(mat)
    q, r = np.linalg.qr(np.swapaxes(mat, -1, -2))
    sign = np.copysign(1.0, np.diagonal(r, axis1=-2, axis2=-1))
    return np.swapaxes(r, -1, -2) * sign[..., None, :], np.swapaxes(q * sign[..., None, :], -1, -2)


def decompose_symmetric(mat: ArrayLike) -> tuple[Array, Array]:
    """Return S, symmetric and positive definite, and a rotation Q, so that mat = S Q.

    Q is the rotation nearest to `mat`.

    Parameters
    ----------
    mat : (..., 3, 3) array
        Any invertible matrix.

    Returns
    -------
    S, Q : (..., 3, 3) arrays

    Raises
    ------
    InputError
        The matrix is singular, mirrored (determinant < 0) or not finite.
    """
    u, s, vh = np.linalg.svd(_require_decomposable(mat))
    shape = (u * s[..., None, :]) @ np.swapaxes(u, -1, -2)
    return (shape + np.swapaxes(shape, -1, -2)) / 2, u @ vh


def _require_decomposable(mat: ArrayLike) -> Array:
    """Return `mat` as an array; reject it if its decomposition is not unique."""
    mat = np.asarray(mat, dtype=float)
    if not np.isfinite(mat).all():
        raise InputError("mat has values that are not finite; give a finite matrix", key="mat")
    # Scale rows to length 1, so that the test for dependence sees directions, not sensitivities.
    length = np.linalg.norm(mat, axis=-1, keepdims=True)
    rows = mat / np.where(length == 0, 1.0, length)
    values = np.linalg.svd(rows, compute_uv=False)
    wrong = {
        "is singular: its rows lie in one plane": values[..., -1] < 1e-14,
        "is mirrored: its rows are left-handed": np.linalg.det(rows) < 0,
    }
    for what, where in wrong.items():
        if where.any():
            index = ", ".join(map(str, np.argwhere(where)[0]))
            raise InputError(
                f"mat{f'[{index}]' if index else ''} {what}; give independent rows in "
                "right-handed order",
                key="mat",
            )
    return mat
