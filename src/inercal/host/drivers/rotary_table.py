"""The common interface of all rotary tables, in SI, whichever controller turns them.

Signs and zeros are the table's own: an angle is the encoder's reading since homing, positive in the
controller's counting direction. `TableState.time` is the controller's servo clock, never the
host's, because at 30 °/s a transmission jitter of 20 ms corresponds to 0.6°.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from math import degrees, inf, isfinite, radians
from typing import Literal

from inercal.basics.errors import InercalError, InputError
from inercal.host.closeable import Closeable
from inercal.host.link import LinkLost

Feature = Literal["servo", "home"]  # functions that a controller may lack for a single axis
REST_RATE = radians(0.5)  # rad/s; almost the rate resolution of a PMAC with few counts per turn


class ProtocolError(InercalError):
    """A reply breaks the protocol or is not complete; no part of it is used."""


class TableFault(InercalError):
    """The table refuses a command or has stopped; `str(error)` says why and what is possible."""


@dataclass(frozen=True)
class AxisLimits:
    """The limits that the controller enforces for an axis.

    Parameters
    ----------
    rate, acceleration : float
        Highest rate and acceleration that can be commanded, rad/s and rad/s².
    low, high : float
        Soft limits, rad; infinite if there are none.
    following_error : float
        Following error beyond which the servo switches off, rad.
    """

    rate: float = inf
    acceleration: float = inf
    low: float = -inf
    high: float = inf
    following_error: float = inf

    def check(
        self, axis: str, rate: float, acceleration: float, angle: float | None = None
    ) -> None:
        """Raise `InputError` if a motion exceeds the limits of the axis."""
        if angle is not None and not self.low <= angle <= self.high:
            raise InputError(
                f"axis {axis}: {degrees(angle):.6g}° is beyond the soft limits; possible: "
                f"{degrees(self.low):.6g}° to {degrees(self.high):.6g}°",
                key="angle",
                names=(axis,),
            )
        requested = [("acceleration", acceleration, self.acceleration, "°/s²")]
        if angle is not None or rate != 0:  # a spin at 0 stops the axis, but a move needs a rate
            requested.append(("rate", abs(rate) if angle is None else rate, self.rate, "°/s"))
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
    """The state of one axis at one instant; NaN for numbers that the controller does not report.

    Parameters
    ----------
    angle, rate, following_error : float
        Measured by the encoder, not commanded: rad, rad/s and rad.
    in_position, moving : bool
        Whether the axis is within the servo's band around its target, and whether it is commanded
        to move.
    enabled, homed : bool
        Whether the servo holds the axis, and whether its zero has been found.
    faults : tuple of str
        Faults that keep the axis from turning, as texts; empty if there are none.
    at_low, at_high : bool
        Whether the limit switch at the low or the high end is closed.
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
        """Whether the move is over; uses both flags, as a moving axis may cross its band."""
        return self.in_position and not self.moving

    @property
    def rests(self) -> bool:
        """Whether the axis neither turns nor is commanded to turn."""
        return abs(self.rate) < REST_RATE and not self.moving

    @property
    def status_text(self) -> str:
        """Text for an operator: the axis's faults, otherwise "off", "turns" or "holds"."""
        if self.faults:
            return ", ".join(self.faults)
        return "off" if not self.enabled else "turns" if self.moving else "holds"


@dataclass(frozen=True)
class TableState:
    """All axes in one reading, from outer to inner.

    Parameters
    ----------
    time : float
        Time of the controller's servo clock, s; NaN if it reports none. If the clock wraps
        (`RotaryTable.wrap_period`), the time continues across the wrap within one connection.
    axes : tuple of AxisState
    span : float
        Time between the first and the last number of the reading in the controller, s; 0 if all
        belong to one servo cycle. `time` is the middle of this span.
    """

    time: float
    axes: tuple[AxisState, ...]
    span: float = 0.0


class RotaryTable(Closeable, ABC):
    """A table with one or more axes. One object serves one thread; a stop path opens its own.

    Every method raises `LinkLost` if the controller is gone, `ProtocolError` if its reply is not
    understood, and `TableFault` if it refuses. Closing releases the controller; the table continues
    its motion.

    Attributes
    ----------
    axes : tuple of str
        Names of the axes, from outer to inner.
    limits : tuple of AxisLimits
        Limits as set in the controller.
    wrap_period : float
        Time after which the controller's clock restarts at 0, s; infinite if it never does.
    unsupported : mapping of str to str
        Functions that the controller lacks for a single axis, "servo" (switching off) or "home",
        each with the reason.
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
        """Close the servo loop of an axis at its present position; without an axis, of all axes."""

    @abstractmethod
    def home(self, axis: str | None = None) -> None:
        """Start to search for the zero of one or all axes; finished when homed and settled."""

    @abstractmethod
    def move(self, axis: str, angle: float, rate: float, acceleration: float) -> None:
        """Start a move to `angle` (rad) at up to `rate` (rad/s) and `acceleration` (rad/s²)."""

    @abstractmethod
    def spin(self, axis: str, rate: float, acceleration: float) -> None:
        """Bring an axis to a signed `rate` (rad/s) at `acceleration` (rad/s²), and hold it."""

    @abstractmethod
    def stop(self) -> None:
        """Decelerate all axes and hold them; the hardware interlock is the safety function.

        The command is sent before waiting for any answer, even on a new connection. `ProtocolError`
        means that it was not answered, and `LinkLost` that no connection was possible.
        """

    @abstractmethod
    def kill(self, axis: str | None = None, *, coasting: bool = False) -> None:
        """Switch off the power of one or all axes; refused while one turns, unless it may coast."""

    @abstractmethod
    def read(self) -> TableState:
        """Return the present state of the table."""

    def indices(self, axis: str | None) -> tuple[int, ...]:
        """Return the index of one axis, or of all axes; raises as `axis_index` does."""
        return tuple(range(len(self.axes))) if axis is None else (axis_index(axis, self.axes),)

    def checked_index(
        self, axis: str, rate: float, acceleration: float, angle: float | None = None
    ) -> int:
        """Return the index of an axis that may move like this; raises as `AxisLimits.check`."""
        i = axis_index(axis, self.axes)
        self.limits[i].check(axis, rate, acceleration, angle)
        return i


def axis_index(axis: str, axes: tuple[str, ...]) -> int:
    """Return the index of the axis `axis`; raises an `InputError` that names the axes."""
    if axis not in axes:
        raise InputError(f"no axis {axis!r}; this table has {', '.join(axes)}", names=(axis,))
    return axes.index(axis)


def require_unique_names(axes: tuple[str, ...]) -> None:
    """Raise `InputError` if there are no axes, or if two have the same name."""
    if not axes or len(set(axes)) < len(axes):
        raise InputError(
            f"the axes of the table are {', '.join(axes) or 'none'}; give at least one, each with "
            "its own name",
            names=axes,
        )


def stop_with_retry(stop: Callable[[], object]) -> None:
    """Stop the table, and repeat the command once if it was not acknowledged.

    The second command uses a new connection; repeating a stop is harmless.
    """
    try:
        stop()
    except (ProtocolError, LinkLost):
        stop()
