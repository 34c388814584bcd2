"""Split the matrix D of three magnetometers, reading = D h + o, into shape and attitude.

D = P Q has a symmetric positive P, which is scale factors and soft iron, and an orthogonal Q, which
is the attitude of the triad in the sensor's frame. Q = Π R, where Π is the nearest permutation of
the axes with signs, and R is a rotation by less than 90°: the sensor's frame is first turned by R,
then the axes are exchanged. Q is a reflection if the axes are left-handed, and so is Π.
"""

from itertools import permutations, product
from typing import NamedTuple

import numpy as np

from inercal.basics.arrays import Array
from inercal.physics.frames import log_so3
from inercal.physics.motion import Motion
from inercal.physics.sensors import Sensor

TURNS_OF_CUBE = np.array(
    [
        mat
        for order in permutations(range(3))
        for signs in product((1.0, -1.0), repeat=3)
        if np.linalg.det(mat := np.eye(3)[list(order)] * np.array(signs)[:, None]) > 0
    ]
)
"""The 24 rotations that exchange and reverse axes, (24, 3, 3)."""


class SoftIron(NamedTuple):
    """D and its parts.

    Parameters
    ----------
    matrix, shape : (3, 3) arrays
        D and P; the rows are the axes in the order of the channels.
    axes : (3, 3) array
        Π, with elements 0 and ±1.
    rotation : (3,) array
        Rotation vector of R, rad.
    """

    matrix: Array
    shape: Array
    axes: Array
    rotation: Array


def field_matrix(sensor: Sensor, c: Array) -> Array:
    """Return D at the reference temperature, (m, 3), from coefficients (p,)."""
    own = [k for k, axis in enumerate(sensor.axes) if axis.measures == "m"]
    return sensor.slope(Motion(np.zeros((1, 3))), c)[0][own, 6:]


def split_matrix(matrix: Array) -> SoftIron:
    """Split an invertible D, (3, 3)."""
    u, s, vh = np.linalg.svd(matrix)
    q = u @ vh
    axes = nearest_axes(q)
    return SoftIron(matrix, (u * s) @ u.T, axes, log_so3(axes.T @ q))


def nearest_axes(rows: Array) -> Array:
    """Return the permutation of the axes with signs that is nearest to unit vectors, (3, 3)."""
    order = max(permutations(range(3)), key=lambda one: float(np.abs(rows[range(3), one]).sum()))
    axes = np.zeros((3, 3))
    axes[range(3), order] = np.sign(rows[range(3), order])
    return axes


def axis_names(rows: Array) -> list[str]:
    """Return the names of directions along the axes, (k, 3), such as "-x"."""
    return ["-" * bool(row.sum() < 0) + "xyz"[int(np.abs(row).argmax())] for row in rows]
