"""A table that turns as tables do: profiles, servo lag, limits, faults; no clock but its own.

`advance(until)` runs whole servo cycles up to a bench time and returns the true motion in each of
them; nothing else lets time pass, so that the same cycles give the same numbers at whatever pace.
The equations are in `_table_kernel`.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import floor, inf, pi
from typing import Any, NamedTuple

import numpy as np

from inercal.basics.arrays import Array
from inercal.basics.errors import InputError
from inercal.host.sim import _table_kernel as kernel
from inercal.host.sim.faults import unknown_fault

FAULTS = ("amplifier", "frozen", "jammed")


class ServoOffError(Exception):
    """A motion was asked of an axis whose servo is off."""


@dataclass(frozen=True)
class AxisDynamics:
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


class AxisReport(NamedTuple):
    """What a controller can say of an axis: rad, rad/s from its zero; flags of `_table_kernel`."""

    reading: float
    rate: float
    following_error: float
    flags: int


@dataclass(frozen=True)
class AxesMotion:
    """The true motion, a row a servo cycle: `time` (n,) s, others (n, axes) rad, rad/s, rad/s²."""

    time: Array
    angle: Array
    rate: Array
    acceleration: Array


class SimulatedTable:
    """A simulated table.

    Parameters
    ----------
    axes : sequence of Axis
        Outer to inner; their servos are off.
    frequency : float
        Servo cycles a second.

    Raises
    ------
    InputError
        A delay that is negative or longer than what is kept of the encoder.
    """

    def __init__(self, axes: Sequence[AxisDynamics], frequency: float = 8388608e3 / 3713707):
        self.axes = tuple(axes)
        self.period = 1.0 / frequency
        self.cycle = 0
        # One row an axis: the controllers' simulators set and read its fields.
        self.state: Any = np.zeros(len(self.axes), kernel.AXIS).view(np.recarray)
        self._rate_history = np.zeros((len(self.axes), kernel.MAX_SMOOTH))
        self._encoder_history = np.empty((len(self.axes), kernel.ENCODER_HISTORY))
        self._report_rows = np.empty((len(self.axes), 5))
        self._records = self.state.view(np.ndarray)
        for x, axis in zip(self.state, self.axes, strict=True):
            x.omega, x.zeta, x.feedforward = axis.omega, axis.zeta, axis.feedforward
            x.torque, x.friction, x.index = axis.torque, axis.friction, axis.index
            x.angle = x.encoder = x.raw = x.desired = x.zero = axis.start
            x.speed, x.acceleration, x.abort, x.smooth = 1.0, 1.0, 10.0, 1
            x.low, x.high, x.fatal, x.band = -inf, inf, inf, 1e-5
            x.delay = axis.delay * frequency
            if not 0 <= x.delay <= kernel.ENCODER_HISTORY - 2:
                most = (kernel.ENCODER_HISTORY - 2) * self.period
                raise InputError(
                    f"an encoder delay of {axis.delay:.4g} s is not possible; give 0 to "
                    f"{most:.3g} s",
                    key="delay",
                )
        self._encoder_history[:] = np.array([[axis.start] for axis in self.axes])
        # No cycle, but what is not yet compiled is now, and not while a host waits for an answer.
        self._run_cycles(np.empty((0, len(self.axes), 3)))
        self.report()

    @property
    def time(self) -> float:
        """Bench time at the end of the last servo cycle, s."""
        return self.cycle * self.period

    def advance(self, until: float) -> AxesMotion:
        """Run the servo cycles that end by bench time `until`, s; return the motion in them."""
        out = self.advance_array(until)
        time = self.period * np.arange(self.cycle - len(out) + 1, self.cycle + 1, dtype=np.float64)
        return AxesMotion(time, out[..., 0], out[..., 1], out[..., 2])

    def advance_array(self, until: float) -> Array:
        """As `advance`; return angle, rate and acceleration as one array (n, axes, 3)."""
        # A time that was computed as a multiple of the period belongs to its cycle.
        last = floor(until / self.period + 1e-6)
        count = max(last - self.cycle, 0)
        out = np.empty((count, len(self.axes), 3))
        if count:
            self._run_cycles(out)
        return out

    def _run_cycles(self, out: Array) -> None:
        kernel.advance_axes(
            self._records,
            self._rate_history,
            self._encoder_history,
            self.cycle,
            len(out),
            self.period,
            out,
        )
        self.cycle += len(out)

    def enable(self, i: int) -> None:
        """Close the servo where the axis stands; what had tripped is forgotten."""
        x = self.state[i]
        if not x.closed and not x.amplifier:
            x.closed, x.tripped = 1, 0
            self._rate_history[i] = 0.0

    def kill(self, i: int) -> None:
        """Take the power off."""
        self.state[i].closed = 0

    def move_axis(self, i: int, angle: float) -> None:
        """Move to `angle`, rad from the axis' zero."""
        x = self._closed_axis(i)
        x.goal, x.mode = x.zero + angle, kernel.GO

    def rotate_axis(self, i: int, direction: float) -> None:
        """Turn at the set speed, onward if `direction` is 1, back if it is −1."""
        x = self._closed_axis(i)
        x.direction, x.mode = direction, kernel.RUN

    def search(self, i: int, direction: float = 1.0) -> None:
        """Turn until the index pulse, go there, and make it zero."""
        x = self._closed_axis(i)
        x.direction, x.mode, x.homed = direction, kernel.SEARCH, 0

    def halt(self, i: int, abort: bool = False) -> None:
        """Decelerate to rest as motions do, or at the deceleration of aborts."""
        x = self.state[i]
        x.mode, x.aborting = kernel.HOLD, int(abort)

    def fault(self, i: int, what: str, on: bool = True) -> None:
        """Set or clear a fault of `FAULTS`: amplifier off, encoder frozen, axis jammed."""
        if what not in FAULTS:
            raise unknown_fault(what, ", ".join(FAULTS))
        self.state[i][what] = int(on)

    def report(self) -> list[AxisReport]:
        """Return what can be said of every axis."""
        kernel.report_axes(self._records, self._encoder_history, self.cycle, self._report_rows)
        said: list[AxisReport] = []
        for axis, (read, rate, error, zero, flags) in zip(
            self.axes, self._report_rows.tolist(), strict=True
        ):
            if axis.reading is not None:
                read = axis.reading(read)
            if axis.noise is not None:
                read += axis.noise(self.cycle)
            said.append(AxisReport(read - zero, rate, error, int(flags)))
        return said

    def reading(self, i: int) -> float:
        """Return what is read of the encoder, rad from the axis' zero."""
        return self.report()[i].reading

    def is_moving(self, i: int) -> bool:
        """Tell whether the commanded rate is other than zero, or about to be."""
        return bool(self.report()[i].flags & kernel.MOVING)

    def _closed_axis(self, i: int) -> Any:
        x = self.state[i]
        if not x.closed:
            raise ServoOffError
        x.aborting = x.limited = 0
        return x


def three_axes() -> tuple[AxisDynamics, ...]:
    """Outer, middle and inner axis of a table for IMUs; they stand anywhere when switched on."""
    return (
        AxisDynamics("outer", start=0.4, omega=40.0, torque=20.0),
        AxisDynamics("middle", start=-0.7, omega=50.0, torque=30.0),
        AxisDynamics("inner", start=pi / 3, omega=60.0, torque=60.0),
    )
