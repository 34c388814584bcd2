"""Magnetic heading from specific force and magnetic flux density, and its sensitivity to both.

At rest the specific force f is along the upward vertical z. The field m has the horizontal part H
towards magnetic north x and the vertical part V. West is y = z × x, so H y = z × m. To first order,
errors δf and δm turn the frame (x, y, z) about the vertical by::

    δψ = (y·δm)/H − (V/H) (y·δf)/|f|

Scale errors that all axes share do not turn it, and it grows as 1/cos δ with the dip δ of the
field.
"""

import numpy as np

from inercal.basics.arrays import Array

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
