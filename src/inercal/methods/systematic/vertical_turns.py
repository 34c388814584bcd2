"""Turns about the vertical: gravity at their two ends is the same, so azimuth alone measures them.

One ppm of a quarter turn is 0.3″, azimuth of a navigation-grade IMU 80″: such a turn says next to
nothing of the scale factor and the misalignments of the gyro about its axis.
"""

from collections.abc import Sequence
from math import degrees

import numpy as np

from inercal.basics.arrays import Array
from inercal.physics.frames import log_so3

_VERTICAL = 0.9  # cosine of the turn's axis with the vertical, beyond which it is about it
_TURNED = 0.02  # rad; a smaller turn has no axis
_NAMED = 4  # turns in a message


def vertical_turn_messages(attitudes: Array, labels: Sequence[str]) -> tuple[str, ...]:
    """Return a warning for each body axis with turns about the vertical.

    Parameters
    ----------
    attitudes : (m, 3, 3) array
        C, body to n, at each rest.
    labels : sequence of m str
        Of the rests.
    """
    before, after = attitudes[:-1], attitudes[1:]
    in_body = log_so3(np.swapaxes(before, -1, -2) @ after)
    angle = np.linalg.norm(in_body, axis=-1)
    up = np.einsum("kij,kj->ki", before, in_body)[:, 2]
    about = np.abs(up) > _VERTICAL * np.maximum(angle, _TURNED)
    body = np.abs(in_body).argmax(axis=-1)
    found: list[str] = []
    for k, axis in enumerate("xyz"):
        turns = np.flatnonzero(about & (body == k))
        if not turns.size:
            continue
        level = float(degrees(angle[(body == k) & ~about].sum()))
        names = [f"{labels[i]} to {labels[i + 1]}" for i in turns[:_NAMED].tolist()]
        rest = f" and {turns.size - _NAMED} more" if turns.size > _NAMED else ""
        found.append(
            f"body axis {axis} turns about the vertical {turns.size} "
            f"time{'s' * (turns.size > 1)} ({', '.join(names)}{rest}): gravity does not measure "
            f"such a turn; about level axes it turns by {level:.0f}° in all. Scale factor and "
            f"misalignments of the gyro about {axis} need turns about a level axis"
        )
    return tuple(found)
