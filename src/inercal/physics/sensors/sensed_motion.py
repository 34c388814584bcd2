"""The components of the motion (f, ω, m) that the axes of a sensor measure.

Three independent axes of a kind measure a vector, so its components are those along x, y and z.
One or two axes measure only the components along their own directions.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from inercal.basics.arrays import Array
from inercal.physics.quantities import KINDS, Measures
from inercal.physics.sensors.axis import Axis


class SensedMotion(NamedTuple):
    """The q components of the motion that a sensor measures.

    Parameters
    ----------
    names : tuple of q str
        "fx", "wz", …; "f1", "f2", … for one or two axes that are not along different case axes.
    measures : tuple of q "f", "w" or "m"
    rows : (q, width) array
        Direction of each component in (f, ω), or in (f, ω, m) if there are magnetometers.
    basis : (width, k) array
        Orthonormal basis of these directions; k < q if some of them are parallel.
    """

    names: tuple[str, ...]
    measures: tuple[Measures, ...]
    rows: Array
    basis: Array


def sensed_motion(axes: Sequence[Axis]) -> SensedMotion:
    """Return the components of the motion that the axes of a sensor measure."""
    names: list[str] = []
    measures: list[Measures] = []
    rows: list[Array] = []
    basis: list[Array] = []
    width = motion_width(axes)
    for kind in KINDS[: width // 3]:
        own = np.array([axis.i for axis in axes if axis.measures == kind]).reshape(-1, 3)
        rank = int(np.linalg.matrix_rank(own))
        if rank == len("xyz"):
            own = orthonormal = np.eye(3)
        else:
            orthonormal = np.linalg.svd(own)[2][:rank]
        names += [kind + name for name in case_letters(own) or map(str, range(1, len(own) + 1))]
        measures.extend(kind for _ in own)
        place = np.eye(3, width, 3 * KINDS.index(kind))
        rows += list(own @ place)
        basis += list(orthonormal @ place)
    return SensedMotion(
        tuple(names), tuple(measures), np.array(rows), np.ascontiguousarray(np.transpose(basis))
    )


def motion_width(axes: Sequence[Axis]) -> int:
    """Return the number of components of the motion: 6 for (f, ω), 9 for (f, ω, m)."""
    return 3 * (len(KINDS) if any(axis.measures == "m" for axis in axes) else len("fw"))


def case_letters(directions: Array) -> tuple[str, ...]:
    """Return the letters of unit vectors, (m, 3), along different case axes; empty for others.

    >>> case_letters(np.array([[0, 0, 1], [1, 0, 0]]))
    ('z', 'x')
    >>> case_letters(np.array([[0, 0, 1], [0, 0, 1]])), case_letters(np.array([[0, 0, -1]]))
    ((), ())
    """
    letters = tuple("xyz"[k] for k in directions.argmax(axis=1).tolist())
    along = bool((directions.max(axis=1, initial=0) == 1).all())
    return letters if along and len(set(letters)) == len(letters) else ()
