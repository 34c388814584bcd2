"""Driver for the spindle: a table with one axis and a text protocol of five commands.

Each line ends with LF, and each gets one line as its reply. Angles are in °, times in s::

    ID                            SPINDLE-1 120 240 -720 720     name, largest rate and
                                                                 acceleration, soft limits
    STATE                         12.345 90.0000 0.0000 holds    clock, angle, rate; turns, holds
                                                                 or fault
    MOVE angle rate acceleration  OK
    SPIN rate acceleration        OK
    STOP                          OK

A command that the controller refuses gets `ERR` and a reason. The encoder is absolute, and the
servo is always on.
"""

import re
from math import degrees, nan, radians
from typing import Any

from inercal.basics.closeable import on_failure
from inercal.host.drivers.rotary_table import (
    AxisLimits,
    AxisState,
    ProtocolError,
    RotaryTable,
    TableFault,
    TableState,
    stop_with_retry,
)
from inercal.host.drivers.table_address import Driver, TableAddress
from inercal.host.drivers.text_dialogue import TextDialogue

_NUMBER = re.compile(r"[+-]?\d{1,12}(?:\.\d{0,12})?", re.ASCII)
_ALWAYS_ON = "the servo is always on; switch it off at the cabinet"
_ABSOLUTE = "the encoder is absolute"


class Spindle(RotaryTable):
    """A `RotaryTable` with such a controller.

    Parameters
    ----------
    link : str
        Address of the link, such as `tcp://10.0.0.7:4000` or `serial:/dev/ttyUSB0?baud=9600`.
    axis : str
        Name of the axis.
    timeout : float
        Longest time to wait for a reply, s.
    """

    def __init__(self, link: str, axis: str = "spindle", timeout: float = 1.0):
        self.axes = (axis,)
        self.unsupported = {"servo": _ALWAYS_ON, "home": _ABSOLUTE}
        self._dialogue = TextDialogue(link, b"\n", timeout)
        with on_failure(self.close):
            self._name, *numbers = self._ask("ID", 5)
            rate, acceleration, low, high = (self._angle(text) for text in numbers)
            self.limits = (AxisLimits(rate, acceleration, low, high),)

    def identity(self) -> str:
        """See `RotaryTable.identity`."""
        return self._name

    def enable(self, axis: str | None = None) -> None:
        """Check that the servo is on."""
        self.indices(axis)
        if not self.read().axes[0].enabled:
            raise TableFault(f"{self._dialogue.address}: the drive has a fault; reset it there")

    def home(self, axis: str | None = None) -> None:
        """Do nothing, because the encoder is absolute."""
        self.indices(axis)

    def move(self, axis: str, angle: float, rate: float, acceleration: float) -> None:
        """See `RotaryTable.move`."""
        self.checked_index(axis, rate, acceleration, angle)
        self._command("MOVE", angle, rate, acceleration)

    def spin(self, axis: str, rate: float, acceleration: float) -> None:
        """See `RotaryTable.spin`."""
        self.checked_index(axis, rate, acceleration)
        self._command("SPIN", rate, acceleration)

    def stop(self) -> None:
        """See `RotaryTable.stop`."""
        stop_with_retry(lambda: self._ask("STOP", 1, urgent=True))

    def kill(self, axis: str | None = None, *, coasting: bool = False) -> None:
        """Raise an error, because there is no such command."""
        raise TableFault(_ALWAYS_ON)

    def read(self) -> TableState:
        """See `RotaryTable.read`."""
        time, angle, rate, word = self._ask("STATE", 4)
        if word not in ("turns", "holds", "fault"):
            raise ProtocolError(f"{self._dialogue.address}: {word!r} is not a state of the spindle")
        axis = AxisState(
            self._angle(angle),
            self._angle(rate),
            following_error=nan,
            in_position=word == "holds",
            moving=word == "turns",
            enabled=word != "fault",
            homed=True,
            faults=("drive fault",) if word == "fault" else (),
        )
        return TableState(self._number(time), (axis,))

    def close(self) -> None:
        """Close the link; the spindle continues its motion."""
        self._dialogue.close()

    def _command(self, word: str, *angles: float) -> None:
        """Send a command with angles, in rad."""
        numbers = " ".join(f"{degrees(angle):.5f}" for angle in angles)
        if self._ask(f"{word} {numbers}", 1) != ["OK"]:
            raise ProtocolError(f"{self._dialogue.address}: {word} was not confirmed by OK")

    def _ask(self, line: str, words: int, *, urgent: bool = False) -> list[str]:
        """Send a line, and return the words of its reply."""
        reply = self._dialogue.ask(f"{line}\n".encode(), urgent=urgent)
        if reply.startswith("ERR"):
            raise TableFault(f"{self._dialogue.address}: the spindle refused {line!r}: {reply}")
        found = reply.split()
        if len(found) != words:
            raise ProtocolError(
                f"{self._dialogue.address}: {reply[:40]!r} is not a reply to {line!r}"
            )
        return found

    def _number(self, text: str) -> float:
        if _NUMBER.fullmatch(text):
            return float(text)
        raise ProtocolError(f"{self._dialogue.address}: {text[:40]!r} is not a number")

    def _angle(self, text: str) -> float:
        return radians(self._number(text))


def open_spindle(address: TableAddress, bench: Any, timeout: float) -> Spindle:
    """Open the spindle at an address, and name its axis after the bench."""
    (axis,) = address.axis_names("axis", (1,), bench)
    return Spindle(address.link(), axis, timeout)


DRIVER = Driver(open_spindle, "spindle://HOST:4000", port=4000)
