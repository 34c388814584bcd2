"""Passes of a dividing head: once through its positions, forward or back."""

from collections.abc import Sequence
from math import pi

import numpy as np
from numpy.typing import NDArray

from inercal.plan import Index

Array = NDArray[np.float64]
SAME = 1e-9  # rad; closer angles are one position of the head
CARDINAL = (0.0, pi / 2, pi, 1.5 * pi)


def beyond_turns(angle: float) -> float:
    """Return the size of an angle beyond whole turns, rad."""
    return abs((angle + pi) % (2 * pi) - pi)


def passes(steps: Sequence[Index]) -> list[int]:
    """Return which pass each step belongs to, from 0.

    A pass ends where the sense changes, or where an angle would come a second time.
    """
    found: list[int] = []
    current: list[Index] = []
    for step in steps:
        again = any(beyond_turns(step.angle - other.angle) < SAME for other in current)
        if current and (again or step.sense != current[0].sense):
            current = []
        found.append(found[-1] + (not current) if found else 0)
        current.append(step)
    return found


def pass_names(steps: Sequence[Index]) -> list[str]:
    """Return the names of the passes, such as "pass 1"."""
    return [f"pass {k}" for k in range(1, max(passes(steps), default=-1) + 2)]


def lacking(steps: Sequence[Index]) -> dict[str, list[float]]:
    """Return the cardinal angles, rad, that passes lack, by the name of the pass."""
    which = passes(steps)
    found: dict[str, list[float]] = {}
    for k, name in enumerate(pass_names(steps)):
        own = [step.angle for step, one in zip(steps, which, strict=True) if one == k]
        missing = [c for c in CARDINAL if not any(beyond_turns(c - a) < SAME for a in own)]
        if missing:
            found[name] = missing
    return found


def ramps(steps: Sequence[Index]) -> Array:
    """Return what a drift of one a pass has made at each step, (passes, r), about the run's mean.

    The positions of a pass follow one another evenly; the drift of one pass goes on in the next.
    """
    which = np.array(passes(steps), dtype=np.int64)
    row = np.arange(len(steps))
    rising: list[Array] = []
    for k in range(int(which.max()) + 1):
        (own,) = np.nonzero(which == k)
        ramp = np.clip((row - own[0]) / own.size, 0.0, 1.0)
        rising.append(ramp - ramp.mean())
    return np.stack(rising)
