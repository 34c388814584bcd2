"""Magnetic fields: the soft iron of a triad, magnetic heading, and units of flux density.

The matrix D of three magnetometers, reading = D h + o, is split into shape and attitude.

D = P Q has a symmetric positive P, which is scale factors and soft iron, and an orthogonal Q, which
is the attitude of the triad in the sensor's frame. Q = Π R, where Π is the nearest permutation of
the axes with signs, and R is a rotation by less than 90°: the sensor's frame is first turned by R,
then the axes are exchanged. Q is a reflection if the axes are left-handed, and so is Π.

The magnetic heading follows from the specific force f and the magnetic flux density m. At rest the
specific force f is along the upward vertical z. The field m has the horizontal part H towards
magnetic north x and the vertical part V. West is y = z × x, so H y = z × m. To first order, errors
δf and δm turn the frame (x, y, z) about the vertical by::

    δψ = (y·δm)/H − (V/H) (y·δf)/|f|

Scale errors that all axes share do not turn it, and it grows as 1/cos δ with the dip δ of the
field.
"""

from itertools import permutations, product
from typing import NamedTuple

import numpy as np

from inercal.basics.arrays import Array
from inercal.basics.units import si_factor
from inercal.physics.frames import log_so3
from inercal.physics.motion import Motion
from inercal.physics.sensors import Sensor

EARTH_FIELD = (22e-6, 67e-6)  # T, over all places on Earth (World Magnetic Model 2025)
POSSIBLE_FIELD = (10e-6, 200e-6)  # T; indoors, iron changes the field of the Earth
_UNITS = ("T", "mT", "µT", "nT", "gauss", "mG")


def unit_of_earth_field(strength: float) -> str | None:
    """Return the unit in which a number is the strength of the Earth's field; None if none is.

    The ranges of the units do not overlap, because they differ by factors of 10 at least.

    >>> [unit_of_earth_field(x) for x in (48.6, 0.486, 486.0, 48600.0, 5.0)]
    ['µT', 'gauss', 'mG', 'nT', None]
    """
    low, high = EARTH_FIELD
    return next((unit for unit in _UNITS if low <= strength * si_factor(unit) <= high), None)


def unit_hint(strength: float) -> str:
    """Return a hint to the unit that fits a number, such as "; 486 fits in mG"; may be empty."""
    unit = unit_of_earth_field(strength)
    return "" if unit is None else f", and {strength:.4g} fits if the unit is {unit}"


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


_HEADINGS = 24


def heading_gradient(f: Array, m: Array) -> Array:
    """Return the derivatives of the heading with respect to f and m.

    Parameters
    ----------
    f, m : (..., 3) arrays
        Specific force at rest, m/s², and magnetic flux density, T, in the sensor's frame.

    Returns
    -------
    (..., 6) array
        rad per m/s² and rad per T; NaN if f is zero or m is vertical or zero.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        up = f / np.linalg.norm(f, axis=-1, keepdims=True)
        west = np.cross(up, m)  # times H
        by_m = west / np.sum(west**2, axis=-1, keepdims=True)
        tilt = -np.sum(up * m, axis=-1, keepdims=True) * by_m
        by_f = tilt / np.linalg.norm(f, axis=-1, keepdims=True)
    return np.concatenate([by_f, by_m], axis=-1)


def level_attitudes(
    tilt: float, dip: float, strength: float, gravity: float
) -> tuple[Array, Array]:
    """Return f and m at headings all around, with z of the sensor within `tilt` of the vertical.

    Parameters
    ----------
    tilt : float
        Roll and pitch, rad; all four directions are returned unless it is zero.
    dip : float
        Angle of the field below the horizontal, rad.
    strength : float
        Magnetic flux density, T.
    gravity : float
        m/s².

    Returns
    -------
    (n, 3) arrays
    """
    psi = np.arange(_HEADINGS) * 2 * np.pi / _HEADINGS
    level = np.stack([np.cos(psi), np.sin(psi), np.full(_HEADINGS, -np.tan(dip))], axis=-1)
    level *= strength * np.cos(dip)
    f: list[Array] = []
    m: list[Array] = []
    for angle in (tilt, -tilt) if tilt else (0.0,):
        c, s = np.cos(angle), np.sin(angle)
        for turn in ([[1, 0, 0], [0, c, s], [0, -s, c]], [[c, 0, -s], [0, 1, 0], [s, 0, c]]):
            mat = np.array(turn, dtype=float)
            f.append(np.tile(gravity * mat[:, 2], (_HEADINGS, 1)))
            m.append(level @ mat.T)
    return np.concatenate(f), np.concatenate(m)
