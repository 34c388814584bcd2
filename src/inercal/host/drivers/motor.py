"""Driver for a single-axis rate table with a motor controller: ASCII over a serial port.

The source for the ship rig (Xiao, Liu and Liu 2014) only says that a host sets the speed of the
motor over a link. A controller like that of Ideal Aerosmith at 9600 baud is assumed. Lines end with
CR. The answer to a line is the requested value and a prompt `>`; a `?` before the prompt means that
the command was refused. `ACL x` sets the acceleration (°/s²), `JOG x` turns at a rate (°/s), `STO`
decelerates to rest, `HOM` searches for zero, `VEL x` and `POS x` move to an angle, and `PPO` and
`PVE` print position and rate. The controller reports no clock, so `TableState.time` is NaN. There
is no command that switches the power off.
"""

import re
from math import degrees, nan, radians
from typing import TYPE_CHECKING

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

if TYPE_CHECKING:
    from inercal.benches.motion_control import ControlledBench

_BAND = radians(0.05)  # rad and rad/s; within this, the axis is in position and at rest
_NO_SERVO_OFF = (
    "this controller has no command that switches the power off; possible: stop(), or the drive's "
    "own switch"
)
_NUMBER = re.compile(r"[+-]?\d{1,12}(?:\.\d{0,12})?", re.ASCII)


class Motor(RotaryTable):
    """A single-axis `RotaryTable` with such a controller.

    Parameters
    ----------
    address : str
        Address of the controller: `serial:/dev/ttyUSB0?baud=9600`, or `tcp://HOST:PORT` for a
        serial port server.
    limits : AxisLimits
        Limits of the rig, because the controller reports none.
    axis : str
        Name of the axis.
    timeout : float
        Longest time to wait for a reply, s.
    """

    def __init__(self, address: str, limits: AxisLimits, axis: str = "table", timeout: float = 1.0):
        self.limits, self.axes = (limits,), (axis,)
        self.unsupported = {"servo": _NO_SERVO_OFF}
        self._goal, self._spinning, self._homing, self._homed = nan, 0.0, False, False
        self._dialogue = TextDialogue(address, b">", timeout)

    def identity(self) -> str:
        """Return "", because no identification command is known."""
        return ""

    def enable(self, axis: str | None = None) -> None:
        """Check that the controller answers, by a query of the position; the servo is always on."""
        self.indices(axis)
        self._send("PPO")

    def home(self, axis: str | None = None) -> None:
        """Start the search for zero (`HOM`)."""
        self.indices(axis)
        self._send("HOM")
        self._goal, self._spinning, self._homing = 0.0, 0.0, True

    def move(self, axis: str, angle: float, rate: float, acceleration: float) -> None:
        """See `RotaryTable.move`."""
        self.checked_index(axis, rate, acceleration, angle)
        self._send(f"ACL {degrees(acceleration):.5f}")
        self._send(f"VEL {degrees(rate):.5f}")
        self._send(f"POS {degrees(angle):.5f}")
        self._goal, self._spinning = angle, 0.0

    def spin(self, axis: str, rate: float, acceleration: float) -> None:
        """See `RotaryTable.spin`."""
        self.checked_index(axis, rate, acceleration)
        self._send(f"ACL {degrees(acceleration):.5f}")
        self._send(f"JOG {degrees(rate):.5f}")
        self._goal, self._spinning = nan, rate

    def stop(self) -> None:
        """Decelerate to rest (`STO`) at the last acceleration; this is not a safety function."""
        self._goal, self._spinning = nan, 0.0
        stop_with_retry(lambda: self._send("STO", urgent=True))

    def kill(self, axis: str | None = None, *, coasting: bool = False) -> None:
        """Raise an error, because the controller has no such command; see the module docstring."""
        self.indices(axis)
        raise TableFault(_NO_SERVO_OFF)

    def read(self) -> TableState:
        """Return the present state of the axis, without a time."""
        angle, rate = (radians(self._query_number(what)) for what in ("PPO", "PVE"))
        resting = abs(rate) <= _BAND and self._spinning == 0
        in_position = resting and not abs(angle - self._goal) > _BAND
        self._homed = self._homed or (self._homing and in_position)
        return TableState(
            nan, (AxisState(angle, rate, nan, in_position, not resting, True, self._homed),)
        )

    def close(self) -> None:
        """Close the link; the motor continues its motion."""
        self._dialogue.close()

    def _send(self, line: str, *, urgent: bool = False) -> str:
        said = self._dialogue.ask(f"{line}\r".encode(), urgent=urgent)
        if said.startswith("?"):
            raise TableFault(
                f"{self._dialogue.address}: the motor controller refused {line!r}: it replied "
                f"{said!r}; look the code up in the manual of the drive"
            )
        return said

    def _query_number(self, line: str) -> float:
        said = self._send(line)
        if not _NUMBER.fullmatch(said):
            raise ProtocolError(
                f"{self._dialogue.address}: the motor controller replied {said[:40]!r} to "
                f"{line!r}, where a number was expected; check the baud rate and the drive"
            )
        return float(said)


def _open(address: TableAddress, bench: "ControlledBench | None", timeout: float) -> RotaryTable:
    link = address.link()
    (name,) = address.axis_names("motor", (1,), bench)
    limits = AxisLimits()
    if bench is not None:
        of_axis = bench.axis_motion_limits[0]
        limits = AxisLimits(of_axis.rate, of_axis.acceleration)
    return Motor(link, limits, name, timeout=timeout)


DRIVER = Driver(_open, "motor:serial:PATH?baud=9600")
