"""The dynamics of a simulated table, and the base class of simulated controllers.

`advance(until)` computes whole servo cycles up to a bench time and returns the true motion in each
cycle. Time passes only in this way, so the same cycles give the same numbers at any speed. The
equations for motion profiles, servo lag, limits and faults are in `_table_kernel`.
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
    """A motion was commanded on an axis whose servo is off."""


@dataclass(frozen=True)
class AxisDynamics:
    """The properties of an axis; angles are in rad from the mechanical zero of the axis.

    Parameters
    ----------
    name : str
    start : float
        True initial angle. The encoder counts from this angle until the axis is homed.
    index : float
        Position of the index pulse, which occurs once per turn.
    omega, zeta : float
        Natural frequency of the servo, rad/s, and its damping ratio.
    feedforward : float
        Rate feedforward; if it is 1, there is no following error at a steady rate.
    torque : float
        Largest acceleration that the motor can produce, rad/s².
    friction : float
        Deceleration of the axis when it coasts, rad/s².
    reading : callable, optional
        Function that converts the encoder's angle to the readback, rad, to simulate harmonics. The
        servo uses the angle itself.
    noise : callable, optional
        Function that returns the readback noise in a servo cycle, rad, from the number of the
        cycle. Repeated readings in one cycle are therefore equal.
    delay : float
        Delay of the readback, s; the servo and the following error have no delay.
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
    """A controller's report on an axis: rad, rad/s from its zero; flags of `_table_kernel`."""

    reading: float
    rate: float
    following_error: float
    flags: int


class SimulatedTable:
    """A simulated table with one or more axes.

    Parameters
    ----------
    axes : sequence of Axis
        The axes, from outer to inner. Their servos are initially off.
    frequency : float
        Servo cycles per second.

    Raises
    ------
    InputError
        A delay is negative or longer than the stored history of the encoder.
    """

    def __init__(self, axes: Sequence[AxisDynamics], frequency: float = 8388608e3 / 3713707):
        self.axes = tuple(axes)
        self.period = 1.0 / frequency
        self.cycle = 0
        # There is one row for each axis. The simulators of controllers set and read its fields.
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
        # No cycle is computed, but the kernels are compiled now and not while a host waits for an
        # answer.
        self._run_cycles(np.empty((0, len(self.axes), 3)))
        self.report()

    @property
    def time(self) -> float:
        """Bench time at the end of the last servo cycle, s."""
        return self.cycle * self.period

    def advance(self, until: float) -> Array:
        """Compute the servo cycles up to bench time `until`, s, and return the motion in them.

        The angles, rad, rates, rad/s, and accelerations, rad/s², are one array, (n, axes, 3).
        """
        # A time that was computed as a multiple of the period must belong to this cycle.
        last = floor(until / self.period + 1e-6)
        count = max(last - self.cycle, 0)
        out = np.empty((count, len(self.axes), 3))
        if count:
            self._run_cycles(out)
        return out

    def _run_cycles(self, out: Array) -> None:
        kernel.advance_axes(
            self._records, self._rate_history, self._encoder_history, self.cycle, self.period, out
        )
        self.cycle += len(out)

    def enable(self, i: int) -> None:
        """Close the servo loop at the present position, and clear a trip."""
        x = self.state[i]
        if not x.closed and not x.amplifier:
            x.closed, x.tripped = 1, 0
            self._rate_history[i] = 0.0

    def kill(self, i: int) -> None:
        """Switch the power of an axis off."""
        self.state[i].closed = 0

    def move_axis(self, i: int, angle: float) -> None:
        """Move an axis to `angle`, rad from its zero."""
        x = self._closed_axis(i)
        x.goal, x.mode = x.zero + angle, kernel.GO

    def rotate_axis(self, i: int, direction: float) -> None:
        """Turn an axis at the set speed; `direction` is 1 (forward) or −1 (backward)."""
        x = self._closed_axis(i)
        x.direction, x.mode = direction, kernel.RUN

    def search(self, i: int, direction: float = 1.0) -> None:
        """Turn an axis to the index pulse, and make this position the zero."""
        x = self._closed_axis(i)
        x.direction, x.mode, x.homed = direction, kernel.SEARCH, 0

    def halt(self, i: int, abort: bool = False) -> None:
        """Decelerate an axis to rest with its normal deceleration or, if `abort`, faster."""
        x = self.state[i]
        x.mode, x.aborting = kernel.HOLD, int(abort)

    def fault(self, i: int, what: str, on: bool = True) -> None:
        """Set or clear a fault from `FAULTS`: amplifier off, encoder frozen or axis jammed."""
        if what not in FAULTS:
            raise unknown_fault(what, ", ".join(FAULTS))
        self.state[i][what] = int(on)

    def report(self) -> list[AxisReport]:
        """Return the reports of all axes."""
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
        """Return the encoder's readback, rad from the axis' zero."""
        return self.report()[i].reading

    def is_moving(self, i: int) -> bool:
        """Return whether the commanded rate is not zero or is about to change."""
        return bool(self.report()[i].flags & kernel.MOVING)

    def _closed_axis(self, i: int) -> Any:
        x = self.state[i]
        if not x.closed:
            raise ServoOffError
        x.aborting = x.limited = 0
        return x


def three_axes() -> tuple[AxisDynamics, ...]:
    """Return the outer, middle and inner axes of an IMU table, with arbitrary initial angles."""
    return (
        AxisDynamics("outer", start=0.4, omega=40.0, torque=20.0),
        AxisDynamics("middle", start=-0.7, omega=50.0, torque=30.0),
        AxisDynamics("inner", start=pi / 3, omega=60.0, torque=60.0),
    )


class Controller:
    """A `server.Device` that turns a table; subclasses add the sessions.

    Parameters
    ----------
    table : Table
    """

    def __init__(self, table: SimulatedTable):
        self.table = table

    @property
    def time(self) -> float:
        """Bench time, s."""
        return self.table.time

    def advance(self, until: float) -> None:
        """Let bench time pass."""
        self.table.advance(until)

    def fault(self, words: str) -> None:
        """Set a fault of the table, such as `amplifier 2` or `frozen 1 off` (axes count from 1).

        Raises
        ------
        InputError
            There is no such fault or axis. The message lists the possible faults.
        """
        count = len(self.table.axes)
        match words.split():
            case [what, number, *state] if (
                what in FAULTS
                and number in map(str, range(1, count + 1))
                and state in ([], ["on"], ["off"])
            ):
                self.table.fault(int(number) - 1, what, state != ["off"])
            case _:
                axes = f"then an axis from 1 to {count}, then on or off"
                raise unknown_fault(words, f"{', '.join(FAULTS)}, {axes}")


class LineSession:
    """A connection on which a controller receives lines and answers each line at once.

    Received bytes are split at `ending`, and `answer` processes a line.
    """

    def __init__(self, ending: bytes, answer: Callable[[str], str]):
        self._ending, self._answer = ending, answer
        self._buffer = b""

    def feed(self, data: bytes) -> bytes:
        """See `server.Session.feed`."""
        *lines, self._buffer = (self._buffer + data).split(self._ending)
        return "".join(self._answer(line.decode("latin-1").strip()) for line in lines).encode()
