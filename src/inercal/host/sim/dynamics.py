"""A table that turns as tables do: profiles, servo lag, limits, faults; no clock but its own.

`advance(until)` runs whole servo cycles up to a bench time and returns the true motion in each of
them; nothing else lets time pass, so that the same cycles give the same numbers at whatever pace.
The equations are in `_kernel`.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import floor, inf, pi
from typing import Any, NamedTuple

import numpy as np

from inercal.arrays import Array
from inercal.host.sim import _kernel as kernel

FAULTS = ("amplifier", "frozen", "jammed")


class Killed(Exception):
    """A motion was asked of an axis whose servo is off."""


@dataclass(frozen=True)
class Axis:
    """How an axis is built; angles in rad, from its own mechanical zero.

    Parameters
    ----------
    name : str
    start : float
        True angle at the start; the encoder counts from there until it is homed.
    index : float
        Where the index pulse is, once a turn.
    omega, zeta : float
        Of the servo: rad/s, and damping.
    feedforward : float
        Of the rate; with 1 a steady rate has no following error.
    torque : float
        Most acceleration that the motor gives, rad/s².
    friction : float
        Deceleration of an axis that coasts, rad/s².
    reading : callable, optional
        Encoder's angle → what is read of it, rad: harmonics. The servo feels the angle itself.
    noise : callable, optional
        Number of the servo cycle → noise of what is read in it, rad, so that it is the same however
        often it is asked for.
    delay : float
        s by which what is read is late; the servo and the following error are not.
    """

    name: str = "axis"
    start: float = 0.0
    index: float = 0.0
    omega: float = 60.0
    zeta: float = 0.8
    feedforward: float = 0.98
    torque: float = 50.0
    friction: float = 0.2
    reading: Callable[[float], float] | None = None
    noise: Callable[[int], float] | None = None
    delay: float = 0.0


class Report(NamedTuple):
    """What a controller can say of an axis: rad and rad/s from its zero; flags of `_kernel`."""

    reading: float
    rate: float
    following_error: float
    flags: int


@dataclass(frozen=True)
class Motion:
    """The true motion, a row a servo cycle: `time` (n,) s, others (n, axes) rad, rad/s, rad/s²."""

    time: Array
    angle: Array
    rate: Array
    acceleration: Array


class Table:
    """A simulated table.

    Parameters
    ----------
    axes : sequence of Axis
        Outer to inner; their servos are off.
    frequency : float
        Servo cycles a second.

    Raises
    ------
    ValueError
        A delay that is negative or longer than what is kept of the encoder.
    """

    def __init__(self, axes: Sequence[Axis], frequency: float = 8388608e3 / 3713707):
        self.axes = tuple(axes)
        self.period = 1.0 / frequency
        self.cycle = 0
        # One row an axis: the controllers' simulators set and read its fields.
        self.state: Any = np.zeros(len(self.axes), kernel.AXIS).view(np.recarray)
        self._past = np.zeros((len(self.axes), kernel.MOST_SMOOTH))
        self._shown = np.empty((len(self.axes), kernel.PAST))
        self._said = np.empty((len(self.axes), 5))
        self._plain = self.state.view(np.ndarray)
        for x, axis in zip(self.state, self.axes, strict=True):
            x.omega, x.zeta, x.feedforward = axis.omega, axis.zeta, axis.feedforward
            x.torque, x.friction, x.index = axis.torque, axis.friction, axis.index
            x.angle = x.encoder = x.raw = x.desired = x.zero = axis.start
            x.speed, x.acceleration, x.abort, x.smooth = 1.0, 1.0, 10.0, 1
            x.low, x.high, x.fatal, x.band = -inf, inf, inf, 1e-5
            x.delay = axis.delay * frequency
            if not 0 <= x.delay <= kernel.PAST - 2:
                most = (kernel.PAST - 2) * self.period
                raise ValueError(f"a delay of {axis.delay} s; possible: 0 to {most:.3g} s")
        self._shown[:] = np.array([[axis.start] for axis in self.axes])
        # No cycle, but what is not yet compiled is now, and not while a host waits for an answer.
        self._run(np.empty((0, len(self.axes), 3)))
        self.report()

    @property
    def time(self) -> float:
        """Bench time at the end of the last servo cycle, s."""
        return self.cycle * self.period

    def advance(self, until: float) -> Motion:
        """Run the servo cycles that end by bench time `until`, s; return the motion in them."""
        out = self.turn(until)
        time = self.period * np.arange(self.cycle - len(out) + 1, self.cycle + 1, dtype=np.float64)
        return Motion(time, out[..., 0], out[..., 1], out[..., 2])

    def turn(self, until: float) -> Array:
        """As `advance`; return angle, rate and acceleration as one array (n, axes, 3)."""
        # A time that was computed as a multiple of the period belongs to its cycle.
        last = floor(until / self.period + 1e-6)
        count = max(last - self.cycle, 0)
        out = np.empty((count, len(self.axes), 3))
        if count:
            self._run(out)
        return out

    def _run(self, out: Array) -> None:
        kernel.advance(self._plain, self._past, self._shown, self.cycle, len(out), self.period, out)
        self.cycle += len(out)

    def enable(self, i: int) -> None:
        """Close the servo where the axis stands; what had tripped is forgotten."""
        x = self.state[i]
        if not x.closed and not x.amplifier:
            x.closed, x.tripped = 1, 0
            self._past[i] = 0.0

    def kill(self, i: int) -> None:
        """Take the power off."""
        self.state[i].closed = 0

    def go(self, i: int, angle: float) -> None:
        """Move to `angle`, rad from the axis' zero."""
        x = self._willing(i)
        x.goal, x.mode = x.zero + angle, kernel.GO

    def run(self, i: int, direction: float) -> None:
        """Turn at the set speed, onward if `direction` is 1, back if it is −1."""
        x = self._willing(i)
        x.direction, x.mode = direction, kernel.RUN

    def search(self, i: int, direction: float = 1.0) -> None:
        """Turn until the index pulse, go there, and make it zero."""
        x = self._willing(i)
        x.direction, x.mode, x.homed = direction, kernel.SEARCH, 0

    def halt(self, i: int, abort: bool = False) -> None:
        """Decelerate to rest as motions do, or at the deceleration of aborts."""
        x = self.state[i]
        x.mode, x.aborting = kernel.HOLD, int(abort)

    def fault(self, i: int, what: str, on: bool = True) -> None:
        """Set or clear a fault of `FAULTS`: amplifier off, encoder frozen, axis jammed."""
        if what not in FAULTS:
            raise ValueError(f"no fault {what!r}; possible: {', '.join(FAULTS)}")
        self.state[i][what] = int(on)

    def report(self) -> list[Report]:
        """Return what can be said of every axis."""
        kernel.report(self._plain, self._shown, self.cycle, self._said)
        said: list[Report] = []
        for axis, (read, rate, error, zero, flags) in zip(
            self.axes, self._said.tolist(), strict=True
        ):
            if axis.reading is not None:
                read = axis.reading(read)
            if axis.noise is not None:
                read += axis.noise(self.cycle)
            said.append(Report(read - zero, rate, error, int(flags)))
        return said

    def reading(self, i: int) -> float:
        """Return what is read of the encoder, rad from the axis' zero."""
        return self.report()[i].reading

    def moving(self, i: int) -> bool:
        """Tell whether the commanded rate is other than zero, or about to be."""
        return bool(self.report()[i].flags & kernel.MOVING)

    def _willing(self, i: int) -> Any:
        x = self.state[i]
        if not x.closed:
            raise Killed
        x.aborting = x.limited = 0
        return x


def three_axes() -> tuple[Axis, ...]:
    """Outer, middle and inner axis of a table for IMUs; they stand anywhere when switched on."""
    return (
        Axis("outer", start=0.4, omega=40.0, torque=20.0),
        Axis("middle", start=-0.7, omega=50.0, torque=30.0),
        Axis("inner", start=pi / 3, omega=60.0, torque=60.0),
    )
