"""What every rotary table can do, in SI, whichever controller turns it.

Signs and zeros are the table's own: an angle is what its encoder says since it was homed, positive
as the controller counts. `TableState.time` is the controller's servo clock, never the host's: at
30 °/s, 20 ms of jitter on the way are 0.6°.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from math import degrees, inf, isfinite, radians
from typing import Literal

from inercal.basics.errors import InercalError, InputError
from inercal.host.closeable import Closeable
from inercal.host.link import LinkLost

Feature = Literal["servo", "home"]  # what a controller may be unable to do on one axis
REST_RATE = radians(0.5)  # rad/s; a PMAC of few counts a turn rounds its rates to almost that


class ProtocolError(InercalError):
    """A reply that does not follow the protocol, or did not arrive whole; none of it is used."""


class TableFault(InercalError):
    """The table refuses a command or has stopped; `str(error)` says why and what is possible."""


@dataclass(frozen=True)
class AxisLimits:
    """The limits that the controller enforces for an axis.

    Parameters
    ----------
    rate, acceleration : float
        Highest that may be asked for, rad/s and rad/s².
    low, high : float
        Soft limits, rad; infinite where there are none.
    following_error : float
        The servo gives up beyond it, rad.
    """

    rate: float = inf
    acceleration: float = inf
    low: float = -inf
    high: float = inf
    following_error: float = inf

    def check(
        self, axis: str, rate: float, acceleration: float, angle: float | None = None
    ) -> None:
        """Raise `InputError` for a motion beyond the limits of the axis."""
        if angle is not None and not self.low <= angle <= self.high:
            raise InputError(
                f"axis {axis}: {degrees(angle):.6g}° is beyond the soft limits; possible: "
                f"{degrees(self.low):.6g}° to {degrees(self.high):.6g}°",
                key="angle",
                names=(axis,),
            )
        requested = [("acceleration", acceleration, self.acceleration, "°/s²")]
        if angle is not None:
            requested.append(("rate", rate, self.rate, "°/s"))
        elif rate != 0:  # A spin at 0 brings the axis to rest; a move needs a rate to get there.
            requested.append(("rate", abs(rate), self.rate, "°/s"))
        for what, value, most, unit in requested:
            if not (0 < value <= most and isfinite(value)):
                raise InputError(
                    f"axis {axis}: {what} {degrees(value):.6g} {unit} is not possible; it must be "
                    f"above 0 and at most {degrees(most):.6g} {unit}",
                    key=what,
                    names=(axis,),
                )


@dataclass(frozen=True)
class AxisState:
    """One axis at one instant; NaN for a number that the controller does not report.

    Parameters
    ----------
    angle, rate, following_error : float
        rad, rad/s, rad: the encoder's, not the commanded.
    in_position, moving : bool
        Within the servo's band of the target; the commanded rate is not zero.
    enabled, homed : bool
        The servo holds the axis; its zero has been found.
    faults : tuple of str
        Why it does not turn, in words; empty if all is well.
    at_low, at_high : bool
        A limit switch is closed, at the end of smaller or larger angles.
    """

    angle: float
    rate: float
    following_error: float
    in_position: bool
    moving: bool
    enabled: bool
    homed: bool
    faults: tuple[str, ...] = ()
    at_low: bool = False
    at_high: bool = False

    @property
    def settled(self) -> bool:
        """Whether the move is over; both flags are needed: an axis in motion may be in its band."""
        return self.in_position and not self.moving

    @property
    def rests(self) -> bool:
        """Whether the axis neither turns nor is commanded to."""
        return abs(self.rate) < REST_RATE and not self.moving

    @property
    def status_text(self) -> str:
        """What the axis does, for an operator: its faults, else "off", "turns" or "holds"."""
        if self.faults:
            return ", ".join(self.faults)
        return "off" if not self.enabled else "turns" if self.moving else "holds"


@dataclass(frozen=True)
class TableState:
    """All axes, outer to inner, in one reading.

    Parameters
    ----------
    time : float
        The controller's servo clock as it stands, s; NaN where it tells none. Where it starts again
        (`RotaryTable.wrap_period`), it is counted on within one connection.
    axes : tuple of AxisState
    span : float
        s that passed in the controller between the reading's first number and its last; 0 where all
        belong to one servo cycle. `time` is the middle.
    """

    time: float
    axes: tuple[AxisState, ...]
    span: float = 0.0


class RotaryTable(Closeable, ABC):
    """A table of one or more axes. One object serves one thread; a stop path opens its own.

    Every method raises `LinkLost` where the controller is gone, `ProtocolError` where it cannot be
    understood and `TableFault` where it refuses. To close it lets go of the controller; the table
    goes on with what it does.

    Attributes
    ----------
    axes : tuple of str
        Names, outer to inner.
    limits : tuple of AxisLimits
        As the controller is set.
    wrap_period : float
        After how many s the controller's clock starts again at 0; infinite where never.
    unsupported : mapping of str to str
        What the controller cannot do on one axis: "servo" off, "home", each with the reason.
    """

    axes: tuple[str, ...]
    limits: tuple[AxisLimits, ...]
    wrap_period: float = inf
    unsupported: Mapping[Feature, str]

    @abstractmethod
    def identity(self) -> str:
        """Return how the controller identifies itself; "" if it does not answer."""

    @abstractmethod
    def enable(self, axis: str | None = None) -> None:
        """Close the servo loop of an axis where it stands; without an axis, of all."""

    @abstractmethod
    def home(self, axis: str | None = None) -> None:
        """Start the search for zero on an axis, or on all; over when homed and settled."""

    @abstractmethod
    def move(self, axis: str, angle: float, rate: float, acceleration: float) -> None:
        """Start toward `angle` (rad), at most at `rate` (rad/s) and `acceleration` (rad/s²)."""

    @abstractmethod
    def spin(self, axis: str, rate: float, acceleration: float) -> None:
        """Bring an axis to `rate` (rad/s, signed) at `acceleration` (rad/s²), and keep it there."""

    @abstractmethod
    def stop(self) -> None:
        """Decelerate all axes and hold them. No safety function: that is the hardware interlock.

        The command is sent before any answer is waited for, also on a new connection.
        `ProtocolError` says that it was not answered, `LinkLost` that no connection was possible.
        """

    @abstractmethod
    def kill(self, axis: str | None = None, *, coasting: bool = False) -> None:
        """Take the power off an axis, or off all; refused while it turns, unless it may coast."""

    @abstractmethod
    def read(self) -> TableState:
        """Return where the table is now."""


def axis_index(axis: str, axes: tuple[str, ...]) -> int:
    """Return the index of the axis named `axis`; raises `InputError` that names the axes."""
    if axis not in axes:
        raise InputError(f"no axis {axis!r}; this table has {', '.join(axes)}", names=(axis,))
    return axes.index(axis)


def axis_indices(axis: str | None, axes: tuple[str, ...]) -> tuple[int, ...]:
    """Return the index of one axis, or those of all; raises as `axis_index`."""
    return tuple(range(len(axes))) if axis is None else (axis_index(axis, axes),)


def require_unique_names(axes: tuple[str, ...]) -> None:
    """Raise `InputError` if there are no axes, or if two have the same name."""
    if not axes or len(set(axes)) < len(axes):
        raise InputError(
            f"the axes of the table are {', '.join(axes) or 'none'}; give at least one, each with "
            "its own name",
            names=axes,
        )


def stop_with_retry(stop: Callable[[], object]) -> None:
    """Stop the table, and repeat the command if it was not acknowledged.

    The connection is a new one then, and to stop twice is to stop.
    """
    try:
        stop()
    except (ProtocolError, LinkLost):
        stop()
