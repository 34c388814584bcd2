"""Driver for tables with an ACUTROL3000 controller, which uses SCPI-like lines over TCP.

Angles in the lines are in degrees. The commands `:demand:position n,x`, `:demand:rate n,x`,
`:mode:position n`, `:mode:rate n`, `:limit:rate pos,n,x`, `:limit:acc pos,n,x`, `:limit:absolute?
n`, `:read:pos? n`, `:interlock:close n`, `:interlock:reset` and `*stb?` are known from existing
programs. The manual is not available, so the following is assumed. Lines end with LF. A command
that is not a query has no reply. `*stb?` after a command confirms that it was received; bit 0 means
an interlock fault (the status is then 65), and bit 2 means an error. A demand is accepted in any
mode. Encoders are absolute, so axes need no homing. No servo clock is known, so `TableState.time`
is NaN.

Position mode starts from the previous demand, so each demand is set before the mode.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from math import degrees, nan, radians
from typing import TYPE_CHECKING

from inercal.basics.closeable import on_failure
from inercal.host.drivers.rotary_table import (
    AxisLimits,
    AxisState,
    ProtocolError,
    RotaryTable,
    TableFault,
    TableState,
    require_unique_names,
    stop_with_retry,
)
from inercal.host.drivers.table_address import Driver, TableAddress
from inercal.host.drivers.text_dialogue import TextDialogue

if TYPE_CHECKING:
    from inercal.benches.motion_control import ControlledBench

_NUMBER = re.compile(r"[+-]?\d{1,15}(?:\.\d{0,15})?(?:[Ee][+-]?\d{1,2})?", re.ASCII)
_ANGLE_TOLERANCE = radians(0.001)  # rad from the demand; these tables are accurate to arc seconds
# Largest rate at rest, rad/s. A rate readout is noisier than an angle readout. If a table at rest
# appeared to turn, it would be stopped again and then switched off.
_REST_RATE = radians(0.05)
_NO_HOMING = "the encoders of this controller are absolute: no axis is homed"


@dataclass(frozen=True)
class AcutrolAxis:
    """The name and the number of an axis."""

    name: str
    number: int


class Acutrol(RotaryTable):
    """A `RotaryTable` with an ACUTROL3000 controller.

    Parameters
    ----------
    address : str
        Address of the controller, `tcp://HOST:PORT`.
    axes : sequence of AcutrolAxis
        The axes, from outer to inner.
    timeout : float
        Longest time to wait for a reply, s.
    """

    def __init__(self, address: str, axes: Sequence[AcutrolAxis], timeout: float = 1.0):
        self._axes = tuple(axes)
        self.axes = tuple(a.name for a in self._axes)
        self.unsupported = {"home": _NO_HOMING}
        require_unique_names(self.axes)
        # The last commanded angle or rate of each axis.
        self._goals = [(nan, 0.0)] * len(self._axes)
        self._dialogue = TextDialogue(address, b"\n", timeout)
        with on_failure(self.close):
            self.limits = tuple(self._read_limits(a.number) for a in self._axes)

    def identity(self) -> str:
        """Return the reply to `*idn?`."""
        return self._dialogue.ask(b"*idn?\n")

    def enable(self, axis: str | None = None) -> None:
        """Close the interlock of an axis, or of all axes, and leave them at rest in rate mode."""
        for i in self.indices(axis):
            n = self._axes[i].number
            self._send(":interlock:reset", f":mode:off {n}", f":interlock:close {n}")
            self._send(*self._rest_commands(i))

    def home(self, axis: str | None = None) -> None:
        """Do nothing, because the encoders are assumed to be absolute."""

    def move(self, axis: str, angle: float, rate: float, acceleration: float) -> None:
        """See `RotaryTable.move`."""
        i = self.checked_index(axis, rate, acceleration, angle)
        n = self._axes[i].number
        self._send(
            f":limit:rate pos,{n},{_degrees(rate)}",
            f":limit:acc pos,{n},{_degrees(acceleration)}",
            f":demand:position {n},{_degrees(angle)}",
            f":mode:position {n}",
        )
        self._goals[i] = (angle, 0.0)

    def spin(self, axis: str, rate: float, acceleration: float) -> None:
        """See `RotaryTable.spin`."""
        i = self.checked_index(axis, rate, acceleration)
        n = self._axes[i].number
        self._send(
            f":limit:acc rate,{n},{_degrees(acceleration)}",
            f":demand:rate {n},{_degrees(rate)}",
            f":mode:rate {n}",
        )
        self._goals[i] = (nan, rate)

    def stop(self) -> None:
        """Bring all axes to rest in rate mode; this is not a safety function."""
        # A single line is sent, so a problem with one axis does not prevent the others from
        # stopping.
        lines = [line for i in range(len(self._axes)) for line in self._rest_commands(i)]
        stop_with_retry(lambda: self._send(*lines, urgent=True))

    def kill(self, axis: str | None = None, *, coasting: bool = False) -> None:
        """Open the interlock of an axis, or of all axes; see `RotaryTable.kill`."""
        chosen = self.indices(axis)
        if not coasting and any(self.read().axes[i].moving for i in chosen):
            raise TableFault(
                f"{self._dialogue.address}: an axis turns and would coast if killed; call stop() "
                "first, then kill(), or kill(coasting=True) if stopping failed"
            )
        self._send(*(f":interlock:open {self._axes[i].number}" for i in chosen))

    def read(self) -> TableState:
        """Return the present state of the table, without a time."""
        parts = [
            f":read:pos? {n};rate? {n};:interlock? {n}" for n in (a.number for a in self._axes)
        ]
        said = self._dialogue.ask((";".join(parts) + "\n").encode()).split(";")
        if len(said) != 3 * len(parts):
            raise ProtocolError(
                f"{self._dialogue.address}: expected {3 * len(parts)} values as position, rate and "
                f"interlock of the axes, but the controller replied {said!r}; check its remote mode"
            )
        return TableState(
            nan, tuple(self._state(i, said[3 * i : 3 * i + 3]) for i in range(len(self._axes)))
        )

    def close(self) -> None:
        """Close the connection; the table continues its motion."""
        self._dialogue.close()

    def _state(self, i: int, said: list[str]) -> AxisState:
        angle, rate = radians(_number(said[0])), radians(_number(said[1]))
        interlock = said[2].strip().lower()
        goal, spinning = self._goals[i]
        resting = abs(rate) <= _REST_RATE and spinning == 0
        return AxisState(
            angle=angle,
            rate=rate,
            following_error=nan,
            # If no angle was commanded, the axis is always in position.
            in_position=resting and not abs(angle - goal) > _ANGLE_TOLERANCE,
            moving=not resting,
            enabled=interlock == "closed",
            homed=True,
            faults=("interlock fault",) if interlock == "fault" else (),
        )

    def _rest_commands(self, i: int) -> tuple[str, str]:
        """Return the commands that bring an axis to rest in rate mode."""
        n = self._axes[i].number
        self._goals[i] = (nan, 0.0)
        return f":demand:rate {n},0", f":mode:rate {n}"

    def _read_limits(self, n: int) -> AxisLimits:
        said = self._dialogue.ask(f":limit:absolute? {n}\n".encode()).split(",")
        if len(said) != 6:
            raise ProtocolError(
                f"{self._dialogue.address}: expected the six limits of axis {n}, but the "
                f"controller replied {said!r}; check its remote mode"
            )
        rate, acceleration, _, low, high, _ = (radians(_number(text)) for text in said)
        return AxisLimits(rate, acceleration, low, high)

    def _send(self, *commands: str, urgent: bool = False) -> None:
        """Send commands in one line; raises `TableFault` if the status reports a fault."""
        line = ";".join(commands)
        status = int(_number(self._dialogue.ask(f"{line};*stb?\n".encode(), urgent=urgent)))
        if status & 1:
            raise TableFault(
                f"{self._dialogue.address}: interlock fault after {line!r}; remove its cause, "
                "then call enable() to reset it"
            )
        if status & 4:
            raise TableFault(
                f"{self._dialogue.address}: the controller refused {line!r}; check its remote mode "
                "and the limits of the axis"
            )


def _number(text: str) -> float:
    if not _NUMBER.fullmatch(text.strip()):
        raise ProtocolError(
            f"the ACUTROL replied {text[:40]!r} where a number was expected; check its remote mode"
        )
    return float(text)


def _degrees(value: float) -> str:
    return f"{degrees(value):.7f}"


def _open(address: TableAddress, bench: "ControlledBench | None", timeout: float) -> RotaryTable:
    numbers = address.axis_numbers("axes", 9)
    names = address.axis_names("axes", numbers, bench)
    axes = [AcutrolAxis(*axis) for axis in zip(names, numbers, strict=True)]
    return Acutrol(address.tcp(), axes, timeout)


DRIVER = Driver(_open, "acutrol://HOST:PORT?axes=1,2,3")
