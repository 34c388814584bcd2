"""Passes of a dividing head: once through its positions, in any order."""

from collections.abc import Iterable, Sequence
from math import pi

import numpy as np

from inercal.arrays import Array
from inercal.plan import Index

ANGLE_TOLERANCE = 1e-4  # rad; closer angles are one position, whose angle was read or typed anew
CARDINAL_ANGLES = (0.0, pi / 2, pi, 1.5 * pi)


def distance_from_whole_turns(angle: float) -> float:
    """Return the size of an angle, rad, beyond whole turns."""
    return abs((angle + pi) % (2 * pi) - pi)


def matches_any_angle(angle: float, others: Iterable[float]) -> bool:
    """Return whether an angle, rad, is that of one of other positions, whole turns apart or not."""
    return any(distance_from_whole_turns(angle - other) < ANGLE_TOLERANCE for other in others)


def first_visit_rows(steps: Sequence[Index]) -> list[int]:
    """Return for each step the row at which its position was first visited."""
    found: list[int] = []
    first: list[int] = []
    for k, step in enumerate(steps):
        place = next((j for j in first if matches_any_angle(step.angle, [steps[j].angle])), k)
        if place == k:
            first.append(k)
        found.append(place)
    return found


def pass_numbers(steps: Sequence[Index]) -> list[int]:
    """Return which pass each step belongs to, from 0.

    A pass ends where positions come a second time one after another. A single one, as that which
    closes the turn or one that was taken again, belongs to the pass it comes in.
    """
    where = first_visit_rows(steps)
    found: list[int] = []
    current: set[int] = set()
    number = 0
    for k, place in enumerate(where):
        if place in current and k + 1 < len(where) and where[k + 1] in current:
            number += 1
            current.clear()
        found.append(number)
        current.add(place)
    return found


def pass_names(steps: Sequence[Index]) -> list[str]:
    """Return the names of the passes, such as "pass 1"."""
    return [f"pass {k}" for k in range(1, max(pass_numbers(steps), default=-1) + 2)]


def missing_cardinal_angles(steps: Sequence[Index]) -> dict[str, list[float]]:
    """Return the cardinal angles, rad, that passes lack, by the name of the pass."""
    which = pass_numbers(steps)
    found: dict[str, list[float]] = {}
    for k, name in enumerate(pass_names(steps)):
        own = [step.angle for step, one in zip(steps, which, strict=True) if one == k]
        missing = [angle for angle in CARDINAL_ANGLES if not matches_any_angle(angle, own)]
        if missing:
            found[name] = missing
    return found


def evenly_spaced_angles(steps: Sequence[Index]) -> Array | None:
    """Return the even angles, (r,) rad, at which the steps stand, or None where they are uneven.

    Angles that were read or typed stand there but for `ANGLE_TOLERANCE`.
    """
    n = len(set(first_visit_rows(steps)))
    if n == 0:
        return None
    first = steps[0].angle if distance_from_whole_turns(steps[0].angle) > ANGLE_TOLERANCE else 0.0
    turns = [round((step.angle - first) * n / (2 * pi)) for step in steps]
    grid = [first + turn * 2 * pi / n for turn in turns]
    off = max(abs(a - step.angle) for a, step in zip(grid, steps, strict=True))
    uneven = off > ANGLE_TOLERANCE or len({turn % n for turn in turns}) < n
    return None if uneven else np.array(grid)


def drift_ramps(steps: Sequence[Index]) -> Array:
    """Return what a drift of one a pass has made at each step, (passes, r), about the run's mean.

    Positions follow one another evenly, a pass being as many as the longest has; the drift of one
    pass goes on from that of the one before.
    """
    which = np.array(pass_numbers(steps), dtype=np.int64)
    row = np.arange(len(steps))
    longest = int(np.bincount(which).max())
    rising: list[Array] = []
    for k in range(int(which.max()) + 1):
        (own,) = np.nonzero(which == k)
        ramp = np.clip(row - own[0], 0, own.size) / longest
        rising.append(ramp - ramp.mean())
    return np.stack(rising)
