"""Build the moves of a turntable's axes from rest to rest from pieces with constant jerk.

An axis speeds up to a rate, keeps it and slows down symmetrically. Without a jerk limit its rate
has a trapezoidal profile. With a limit its acceleration is trapezoidal and its rate an S-curve::

    t_a = v/a,             way 2 · v t_a/2                         trapezoid
    t_j = min(a/j, √(v/j)),  t_a = v/(j t_j) − t_j,  way v (2 t_j + t_a)   S-curve

t_a is the time of acceleration, t_j the time of its ramps, and the way is the angle needed to speed
up to v and slow down. The axis turns through the rest of the angle at the rate v. If the angle is
too small to reach v, the axis only speeds up to the largest rate that it can reach.

Source: Biagiotti and Melchiorri, Trajectory Planning for Automatic Machines and Robots, Springer
2008, 3.2 (trapezoidal velocity) and 3.4 (double S velocity).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import sqrt

import numpy as np

from inercal.basics.arrays import Array
from inercal.benches.motion_control import AxisMotionLimits


@dataclass(frozen=True, eq=False)
class AxisProfile:
    """Angle of one axis over time in pieces with constant jerk, with rest before and after.

    Parameters
    ----------
    start : (p,) array
        Time at which each piece starts, in increasing order, s.
    state : (p, 4) array
        Angle, rate, acceleration and jerk at the start of each piece, in units of rad and s.
    """

    start: Array
    state: Array

    def evaluate(self, time: Array) -> tuple[Array, Array, Array]:
        """Return angle, rate and acceleration at times (n,), as (n,) arrays in rad and s."""
        piece = np.maximum(np.searchsorted(self.start, time, side="right") - 1, 0)
        t = np.maximum(time - self.start[piece], 0.0)
        angle, rate, acceleration, jerk = self.state[piece].T
        return (
            angle + t * (rate + t * (acceleration / 2 + t * jerk / 6)),
            rate + t * (acceleration + t * jerk / 2),
            acceleration + t * jerk,
        )


def stationary_profile(angle: float) -> AxisProfile:
    """Return the profile of an axis that stays at an angle, rad."""
    return AxisProfile(np.zeros(1), np.array([[angle, 0.0, 0.0, 0.0]]))


def move_profile(angle: float, limits: AxisMotionLimits) -> tuple[float, AxisProfile]:
    """Return the duration of a move from rest to rest, s, and its profile from 0.

    Parameters
    ----------
    angle : float
        Signed angle of the move, rad.
    limits : AxisMotionLimits
        Limits of the axis. The move is the fastest one with this shape within the limits.
    """
    size = abs(angle)
    if size == 0:
        return 0.0, stationary_profile(0.0)
    v = _largest_rate(size, limits)
    ramp = _ramp_time(v, limits)
    if limits.jerk is None:
        steady = v / limits.acceleration
        way = v * steady
        up = [(steady, limits.acceleration, 0.0)]
        down = [(steady, -limits.acceleration, 0.0)]
    else:
        # A rounding error must not make the steady part negative.
        steady = max(v / (limits.jerk * ramp) - ramp, 0.0)
        way = v * (2 * ramp + steady)
        top, j = limits.jerk * ramp, limits.jerk
        up = [(ramp, 0.0, j), (steady, top, 0.0), (ramp, top, -j)]
        down = [(ramp, 0.0, -j), (steady, -top, 0.0), (ramp, -top, j)]
    cruise = max(size - way, 0.0) / v
    pieces = [*up, (cruise, 0.0, 0.0), *down]
    return _join_pieces([p for p in pieces if p[0] > 0], angle)


def _ramp_time(v: float, limits: AxisMotionLimits) -> float:
    """Return the duration of one acceleration ramp on the way to the rate v, s."""
    if limits.jerk is None:
        return 0.0
    return min(limits.acceleration / limits.jerk, sqrt(v / limits.jerk))


def _largest_rate(size: float, limits: AxisMotionLimits) -> float:
    """Return the largest rate that an axis can reach within an angle, rad/s."""
    a, j = limits.acceleration, limits.jerk
    if j is None:
        return min(limits.rate, sqrt(size * a))
    # v (a/j + v/a) = size if the full acceleration is reached, otherwise 2 v √(v/j) = size.
    v = a / 2 * (sqrt((a / j) ** 2 + 4 * size / a) - a / j)
    if v < a**2 / j:
        v = j * (size / (2 * j)) ** (2 / 3)
    return min(limits.rate, v)


def _join_pieces(
    pieces: Sequence[tuple[float, float, float]], angle: float
) -> tuple[float, AxisProfile]:
    """Join pieces (duration, acceleration at start, jerk); return total duration and profile."""
    start, way, rate = 0.0, 0.0, 0.0
    rows: list[tuple[float, float, float, float, float]] = []
    for duration, acceleration, jerk in pieces:
        rows.append((start, way, rate, acceleration, jerk))
        way += duration * (rate + duration * (acceleration / 2 + duration * jerk / 6))
        rate += duration * (acceleration + duration * jerk / 2)
        start += duration
    rows.append((start, abs(angle), 0.0, 0.0, 0.0))  # exact, without accumulated rounding errors
    result = np.array(rows)
    return start, AxisProfile(result[:, 0], np.copysign(1.0, angle) * result[:, 1:])


def join_profiles(moves: Sequence[tuple[float, float, AxisProfile]], angle: float) -> AxisProfile:
    """Return the profile of an axis over all its moves.

    Parameters
    ----------
    moves : sequence of (start, angle, AxisProfile)
        Start, s, initial angle, rad, and profile of each move, in order and without overlap.
    angle : float
        Initial angle of the axis, rad.
    """
    first = stationary_profile(angle)
    starts, states = [first.start], [first.state]
    for start, origin, profile in moves:
        starts.append(profile.start + start)
        states.append(profile.state + np.array([origin, 0.0, 0.0, 0.0]))
    return AxisProfile(np.concatenate(starts), np.concatenate(states))
