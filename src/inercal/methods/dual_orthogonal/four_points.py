"""The four cardinal positions: bias, gain and K2 of both accelerometers from sums and differences.

With u and v the readings of a level accelerometer (0° and 180° for A, 270° and 90° for B) and n, m
those of a vertical one, up and down (90° and 270°, 0° and 180°), in g::

    K0 = (u + v)/2        k1 + K3 = √(((n − m)/2)² + ((u − v)/2)²) − 1        K2 = (n + m)/2 − K0

The head is trimmed so that the angles of a pair differ by less than the autocollimator resolves.
The root corrects for the mounting angle: to lowest order it adds ½ ((u − v)/2)², without which an
angle of 300″ leaves 1.1 µg.

That angle is of the level positions; the head's error makes the angle of the vertical positions
different. There the other accelerometer is level and determines it, once δ is known from g²::

    k1 + K3 = (n − m) / (2 cos φ) − 1        φ_A = φ of B − δ        φ_B = φ of A + δ

Source: CN101852817A, step 4, equations 17 and 18; the root and φ are ours.
"""

from collections.abc import Sequence
from math import pi
from typing import NamedTuple

import numpy as np

from inercal.basics.arrays import Array
from inercal.basics.errors import NotObserved
from inercal.benches.dividing_head.passes import CARDINAL_ANGLES, matches_any_angle
from inercal.physics.plan import Index

# Of A and B, as indices of `CARDINAL_ANGLES`
_LEVEL_ROWS, _VERTICAL_ROWS = ((0, 2), (3, 1)), ((1, 3), (0, 2))


class FourPoints(NamedTuple):
    """Of A and B, (..., 2) each, in g."""

    k0: Array
    gain: Array  # k1 + K3
    k2: Array


def four_points(y: Array, delta: Array | None = None, *, corrected: bool = True) -> FourPoints:
    """Return bias, gain and K2 from the four cardinal positions.

    Parameters
    ----------
    y : (..., 4, 2) array
        Readings of A and B at 0°, 90°, 180°, 270°, g.
    delta : (...) array, optional
        δ = δ_B − δ_A where it is known, rad.
    corrected : bool
        Whether the gain is corrected for the mounting angle; False is for comparison.
    """
    k0, gain, k2, half, tilt = (np.empty((*y.shape[:-2], 2)) for _ in range(5))
    for k in range(2):
        u, v, n, m = (y[..., row, k] for row in (*_LEVEL_ROWS[k], *_VERTICAL_ROWS[k]))
        k0[..., k] = (u + v) / 2
        half[..., k], tilt[..., k] = (n - m) / 2, (u - v) / 2
        k2[..., k] = (n + m) / 2 - k0[..., k]
    if not corrected:
        gain = half - 1
    elif delta is None:
        gain = np.hypot(half, tilt) - 1
    else:
        angle = np.arctan2(tilt, half)[..., ::-1] + np.stack([-delta, delta], axis=-1)
        gain = half / np.cos(angle) - 1
    return FourPoints(k0, gain, k2)


def averaging_matrix(steps: Sequence[Index]) -> Array:
    """Return the matrix that averages the readings at each cardinal position, (4, r).

    Raises
    ------
    NotObserved
        A cardinal position that was not visited.
    """
    there = np.array(
        [[matches_any_angle(step.angle, [angle]) for step in steps] for angle in CARDINAL_ANGLES]
    )
    if lacking := tuple(
        f"{180 * angle / pi:.0f}°"
        for angle, at in zip(CARDINAL_ANGLES, there, strict=True)
        if not bool(at.any())
    ):
        raise NotObserved(
            f"estimator patent needs positions at {', '.join(lacking)}; add them, or use estimator "
            "dual or joint",
            lacking,
            key="steps",
        )
    return there / there.sum(axis=1, keepdims=True)
