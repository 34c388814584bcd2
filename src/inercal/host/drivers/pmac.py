"""Driver for tables with a Turbo PMAC controller, over Ethernet; each axis is a motor.

Units of the controller: positions and following errors are in counts, `#nV` is in counts per servo
cycle (rounded to 0.1 by the controller), I-variables are in counts, counts/ms and counts/ms², and
Ixx11 and Ixx28 are in 1/16 count. One count is 2π/counts_per_turn rad.

**Time.** X:$0 counts servo cycles in 24 bits (the manual's suggested M100); one cycle is
I10/8388608 ms. A reading requests this count twice in one line, before and after the positions. If
the counts are equal, all values belong to one cycle; otherwise `TableState.span` is the time
between them. The count wraps after 2 h at 2.26 kHz (`Pmac.wrap_period`). Times continue correctly
across a wrap only if the table is read more often than this. The link has no checksum, and a
corrupted digit must not be mistaken for a wrap. A reading is therefore rejected if its two counts
differ by more than the longest time of a reply, or if the first count goes back by at most this
time. If both counts go back further, the clock has restarted.

**Limits.** Rates are limited by Ixx16 and accelerations by Ixx17, which this driver never writes.
It sets the jog variables Ixx19 and Ixx22 for each motion, because old values would limit the
motion. Soft limits are Ixx13 and Ixx14 (0 means no limit).

Source: Delta Tau, Turbo PMAC Software Reference Manual.
"""

from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from math import inf, tau
from typing import TYPE_CHECKING

from inercal.basics.closeable import on_failure
from inercal.basics.errors import InputError
from inercal.host.drivers import pmac_codec as codec
from inercal.host.drivers.pmac_codec import CommandRefused
from inercal.host.drivers.pmac_dialogue import PmacDialogue
from inercal.host.drivers.rotary_table import (
    AxisLimits,
    AxisState,
    ProtocolError,
    RotaryTable,
    TableFault,
    TableState,
    require_unique_names,
)
from inercal.host.drivers.table_address import Driver, TableAddress
from inercal.host.link import LinkLost

if TYPE_CHECKING:
    from inercal.benches.motion_control import ControlledBench

_CYCLES = 1 << 24  # number of cycles after which X:$0 wraps
# Time after a command during which a motor may still report rest, s. It starts at the next
# real-time interrupt (I8), which is a few servo cycles later.
_STARTING = 0.02
_MOST_MOTORS = 32
_LIMITS = (0, 11, 13, 14, 16, 17, 60)


@dataclass(frozen=True)
class PmacAxis:
    """An axis: name, motor number (1 to 32), and counts per turn (< 0 reverses the axis)."""

    name: str
    motor: int
    counts_per_turn: float


class Pmac(RotaryTable):
    """A `RotaryTable` with a Turbo PMAC controller.

    Parameters
    ----------
    address : str
        Address of the controller, `tcp://HOST:1025`.
    axes : sequence of PmacAxis
        The axes, from outer to inner.
    timeout : float
        Longest time for a complete reply, s.

    Raises
    ------
    InputError
        The axes are impossible, a motor is not activated, or its loop skips servo cycles.
    LinkLost
        No Turbo PMAC answers at the address.
    """

    def __init__(self, address: str, axes: Sequence[PmacAxis], timeout: float = 1.0):
        self._axes = tuple(axes)
        self.axes = tuple(a.name for a in self._axes)
        self.unsupported = {}
        require_unique_names(self.axes)
        for axis in self._axes:
            if not (1 <= axis.motor <= _MOST_MOTORS and 0 < abs(axis.counts_per_turn) < inf):
                raise InputError(
                    f"axis {axis.name}: the motor number must be 1 to 32, is {axis.motor}, and "
                    f"the counts per turn finite and not 0, are {axis.counts_per_turn:g}",
                    names=(axis.name,),
                )
        motors = [a.motor for a in self._axes]
        self._ask_state = "RHX$0 " + " ".join(f"#{m}P#{m}V#{m}F#{m}?" for m in motors) + " RHX$0"
        self._cycle, self._clock_wraps = 0, 0
        self._start_cycles: list[int | None] = [None] * len(self._axes)
        self._timeout = timeout
        self._dialogue = PmacDialogue(address, timeout)
        with on_failure(self.close):
            self.period = codec.parse_number(self._ask("I10", 1)[0]) / 8388608 * 1e-3
            if self.period <= 0:
                raise ProtocolError(
                    f"{address}: the servo clock is stopped (I10 is not above 0); start it with a "
                    "positive I10"
                )
            self.wrap_period = _CYCLES * self.period
            self.limits = tuple(self._read_limits(a) for a in self._axes)

    def identity(self) -> str:
        """Return the version of the firmware and the type of the controller."""
        version, kind = self._ask("VERSION TYPE", 2)
        return f"Turbo PMAC {kind.strip()}, firmware {version.strip()}"

    def enable(self, axis: str | None = None) -> None:
        """Close the servo loop of an axis, or of all axes, at the present position (`J/`)."""
        self._ask(" ".join(f"#{self._axes[i].motor}J/" for i in self.indices(axis)))

    def home(self, axis: str | None = None) -> None:
        """Start to search for the zero of an axis, or of all axes (`HM`)."""
        chosen = self.indices(axis)
        homing = " ".join(f"#{self._axes[i].motor}HM" for i in chosen)
        cycle = codec.parse_word(self._ask(f"{homing} RHX$0", 1)[0], 6)
        for i in chosen:
            self._start_cycles[i] = cycle

    def move(self, axis: str, angle: float, rate: float, acceleration: float) -> None:
        """Start a move to `angle` (`J=`); see `RotaryTable.move`."""
        i = self.checked_index(axis, rate, acceleration, angle)
        counts = angle / tau * self._axes[i].counts_per_turn
        self._jog(i, rate, acceleration, f"J={_decimal_text(counts)}")

    def spin(self, axis: str, rate: float, acceleration: float) -> None:
        """Turn an axis at `rate` (`J+`, `J-`; `J/` for 0); see `RotaryTable.spin`."""
        i = self.checked_index(axis, rate, acceleration)
        forward = rate * self._axes[i].counts_per_turn > 0
        self._jog(i, rate, acceleration, "J/" if rate == 0 else "J+" if forward else "J-")

    def stop(self) -> None:
        """Decelerate all axes at Ixx15 (`^A`) and hold them; this is not a safety function.

        `^A` also closes the loops of killed motors. Motors that still turn afterwards, or all
        motors if `^A` is not answered in time, get the command `J/` with the same deceleration. If
        an axis does not answer this either, the caller must use other means, such as the watchdog.

        Raises
        ------
        CommandRefused, ProtocolError
            A motor refuses `J/` or does not answer. All other motors have received the command.
        LinkLost
            The controller cannot be reached.
        """
        try:
            heard = self._dialogue.control("A")
        except LinkLost:
            heard = self._dialogue.control("A")  # perhaps on a new connection
        motors = [a.motor for a in self._axes]
        if heard:
            with suppress(ProtocolError, LinkLost):
                state = self.read()
                motors = [m for m, axis in zip(motors, state.axes, strict=True) if axis.moving]
        # The connection is dropped because late replies may still arrive on it.
        with on_failure(self._dialogue.drop, *((ProtocolError, LinkLost) if heard else ())):
            # A reply of one line can be distinguished from a late answer to ^A.
            self._each(
                (f"I{m}20=0 I{m}21=0 I{m}19=I{m}15 #{m}J/ RHX$0" for m in motors),
                lambda line: self._dialogue.ask_now(line, 1),
            )
        if not heard:
            self._dialogue.drop()

    def kill(self, axis: str | None = None, *, coasting: bool = False) -> None:
        """Open the loop of an axis, or of all axes, and switch the power off (`K`).

        Raises
        ------
        TableFault
            An axis turns and would coast. `coasting=True` permits this.
        """
        chosen = self.indices(axis)
        if not coasting:
            axes = self.read().axes
            for name, state in ((self.axes[i], axes[i]) for i in chosen):
                if state.enabled and not state.settled:
                    raise TableFault(
                        f"axis {name} turns and would coast if killed; call stop() first, then "
                        "kill(), or kill(coasting=True) if stopping failed",
                        names=(name,),
                    )
        self._each((f"#{self._axes[i].motor}K" for i in chosen), self._ask)

    def read(self) -> TableState:
        """Return the present state of the table, with the servo clock as its time."""
        lines = self._ask(self._ask_state, 4 * len(self._axes) + 2)
        first, last = codec.parse_word(lines[0], 6), codec.parse_word(lines[-1], 6)
        during, back = (last - first) % _CYCLES, self._cycle - first
        most = self._timeout / self.period
        if during > most or 0 < back <= most:
            raise ProtocolError(
                f"{self._dialogue.address}: the servo clock jumped: a reading began at {first:X} "
                f"and ended at {last:X} (hexadecimal cycles), the previous one was at "
                f"{self._cycle:X}; check the link, and whether the controller restarted"
            )
        states = tuple(
            self._state(i, first, lines[1 + 4 * i : 5 + 4 * i]) for i in range(len(self._axes))
        )
        self._clock_wraps += back > 0
        self._cycle = first
        cycles = self._clock_wraps * _CYCLES + first + during / 2
        return TableState(cycles * self.period, states, during * self.period)

    def close(self) -> None:
        """Close the connection; the table continues its motion."""
        self._dialogue.close()

    def _ask(self, line: str, replies: int = 0) -> list[str]:
        return self._dialogue.ask(line, replies)

    def _each(self, lines: Iterable[str], ask: Callable[[str], object]) -> None:
        """Send the lines to all motors, even if a line fails for one motor."""
        failure: CommandRefused | ProtocolError | LinkLost | None = None
        for line in lines:
            try:
                ask(line)
            except (CommandRefused, ProtocolError, LinkLost) as error:
                failure = failure or error
        if failure:
            raise failure

    def _state(self, i: int, cycle: int, lines: list[str]) -> AxisState:
        axis, started = self._axes[i], self._start_cycles[i]
        position, velocity, error = (codec.parse_number(text) for text in lines[:3])
        status = codec.parse_status(lines[3])
        if started is not None and (cycle - started) % _CYCLES * self.period > _STARTING:
            started = self._start_cycles[i] = None
        count = tau / axis.counts_per_turn
        ends = [codec.NEGATIVE_END in status.faults, codec.POSITIVE_END in status.faults]
        at_low, at_high = ends if count > 0 else reversed(ends)
        return AxisState(
            angle=position * count,
            rate=velocity * count / self.period,
            following_error=error * count,
            in_position=status.in_position and started is None,
            moving=status.moving,
            enabled=status.enabled,
            homed=status.homed,
            faults=status.faults,
            at_low=at_low,
            at_high=at_high,
        )

    def _read_limits(self, axis: PmacAxis) -> AxisLimits:
        names = " ".join(f"I{axis.motor}{n:02d}" for n in _LIMITS)
        active, fatal, high, low, rate, acceleration, skipped = (
            codec.parse_number(text) for text in self._ask(names, len(_LIMITS))
        )
        if active != 1 or skipped != 0:
            raise InputError(
                f"axis {axis.name}: motor {axis.motor} is not activated or skips servo cycles; "
                f"set I{axis.motor}00=1 and I{axis.motor}60=0",
                names=(axis.name,),
            )
        count = tau / abs(axis.counts_per_turn)
        soft = (low * count if low else -inf, high * count if high else inf)
        if axis.counts_per_turn < 0:
            soft = (-soft[1], -soft[0])
        return AxisLimits(
            rate=rate * 1e3 * count,
            acceleration=acceleration * 1e6 * count,
            low=soft[0],
            high=soft[1],
            following_error=fatal / 16 * count if fatal else inf,
        )

    def _jog(self, i: int, rate: float, acceleration: float, command: str) -> None:
        """Set rate and acceleration of an axis, and start its motion.

        The acceleration time (Ixx20) and the S-curve time (Ixx21) are set to 0, so only Ixx19
        determines the acceleration.
        """
        axis = self._axes[i]
        per_turn, n = abs(axis.counts_per_turn) / tau, axis.motor
        speed = f"I{n}22={_decimal_text(abs(rate) * per_turn * 1e-3)} " if rate else ""
        change = _decimal_text(acceleration * per_turn * 1e-6)
        line = f"I{n}20=0 I{n}21=0 I{n}19={change} {speed}#{n}{command}"
        self._start_cycles[i] = codec.parse_word(self._ask(f"{line} RHX$0", 1)[0], 6)


def _decimal_text(value: float) -> str:
    """Return a number in the controller's notation, without an exponent."""
    return f"{value:.12f}".rstrip("0").rstrip(".")


def _open(address: TableAddress, bench: "ControlledBench | None", timeout: float) -> RotaryTable:
    motors = address.axis_numbers("motors", _MOST_MOTORS)
    names = address.axis_names("motors", motors, bench)
    counts = address.counts(len(motors))
    axes = [PmacAxis(*axis) for axis in zip(names, motors, counts, strict=True)]
    return Pmac(address.tcp(), axes, timeout)


DRIVER = Driver(_open, "pmac://HOST:1025?motors=1,2,3&counts=3600000", port=1025)
