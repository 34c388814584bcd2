"""The common interface of all rotary tables, in SI, for any controller.

Signs and zeros are defined by the table: an angle is the encoder's reading since homing, and it is
positive in the counting direction of the controller. `TableState.time` is the time of the
controller's servo clock and not of the host's clock, because at 30 °/s a transmission jitter of 20
ms corresponds to 0.6°.

In a log frame, the state of a table is a little-endian payload. It contains time and span as
float64, and then for each axis: angle, rate and following error as float64, and one byte of flags.
One flag means that the axis has a fault; an event in the journal names the fault.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from math import degrees, inf, isfinite, nan, radians
from struct import Struct
from typing import Any, Literal, NamedTuple

import numpy as np

from inercal.basics.arrays import Array, Bools
from inercal.basics.closeable import Closeable
from inercal.basics.errors import InercalError, InputError
from inercal.host.link import LinkLost

Feature = Literal["servo", "home"]  # functions that may be impossible for a single axis
REST_RATE = radians(0.5)  # rad/s; almost the rate resolution of a PMAC with few counts per turn


class ProtocolError(InercalError):
    """A reply violates the protocol or is not complete; no part of it is used."""


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
        Following error at which the servo switches off, rad.
    """

    rate: float = inf
    acceleration: float = inf
    low: float = -inf
    high: float = inf
    following_error: float = inf

    def check(
        self, axis: str, rate: float, acceleration: float, angle: float | None = None
    ) -> None:
        """Raise an `InputError` if a motion exceeds the limits of the axis."""
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
    """The state of an axis at one instant; numbers that the controller does not report are NaN.

    Parameters
    ----------
    angle, rate, following_error : float
        Values in rad, rad/s and rad. They are measured by the encoder, not commanded.
    in_position, moving : bool
        Whether the axis is within the servo's tolerance around its target, and whether it is
        commanded to move. An axis that was stopped is in position where it was stopped.
    enabled, homed : bool
        Whether the servo holds the axis, and whether the zero of the axis was found.
    faults : tuple of str
        Faults that prevent the axis from turning, as texts; empty if there are none.
    at_low, at_high : bool
        Whether the limit switch at the low end, and at the high end, is closed.
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
        """Whether the move is complete; a moving axis may also pass through its target."""
        return self.in_position and not self.moving

    @property
    def rests(self) -> bool:
        """Whether the axis neither turns nor is commanded to turn."""
        return abs(self.rate) < REST_RATE and not self.moving

    @property
    def status_text(self) -> str:
        """Text for an operator: the faults of the axis, or else "off", "turns" or "holds"."""
        if self.faults:
            return ", ".join(self.faults)
        return "off" if not self.enabled else "turns" if self.moving else "holds"


@dataclass(frozen=True)
class TableState:
    """The state of all axes in one reading, from outer to inner.

    Parameters
    ----------
    time : float
        Time of the controller's servo clock, s; NaN if it is not reported. If the clock wraps
        (`RotaryTable.wrap_period`), the time continues as long as the driver object exists; see
        `RotaryTable.unwrapped_time`.
    axes : tuple of AxisState
    span : float
        Time in the controller between the first and the last number of the reading, s; 0 if all
        belong to one servo cycle. `time` is the middle of this span.
    """

    time: float
    axes: tuple[AxisState, ...]
    span: float = 0.0


class RotaryTable(Closeable, ABC):
    """A table with one or more axes; an object must only be used in one thread.

    To stop the table from another thread, open a second object. Every method raises `LinkLost` if
    the controller is gone, `ProtocolError` if its reply is not understood, and `TableFault` if it
    refuses a command. `close` releases the controller; the table continues its motion.

    Attributes
    ----------
    axes : tuple of str
        Names of the axes, from outer to inner.
    limits : tuple of AxisLimits
        Limits that are set in the controller.
    wrap_period : float
        Time after which the controller's clock wraps around to 0, s; infinite if it never does.
    unsupported : mapping of str to str
        Functions that the controller cannot carry out for a single axis, "servo" (switching off) or
        "home", each with the reason.
    """

    axes: tuple[str, ...]
    limits: tuple[AxisLimits, ...]
    wrap_period: float = inf
    unsupported: Mapping[Feature, str]
    _last_time, _wrapped_time = nan, 0.0

    @abstractmethod
    def identity(self) -> str:
        """Return the identification of the controller; "" if there is no answer."""

    @abstractmethod
    def enable(self, axis: str | None = None) -> None:
        """Close the servo loop of an axis, or of all axes, at the present position."""

    @abstractmethod
    def home(self, axis: str | None = None) -> None:
        """Start the search for the zero of one or all axes; it ends when they are settled."""

    @abstractmethod
    def move(self, axis: str, angle: float, rate: float, acceleration: float) -> None:
        """Start a move to `angle` (rad) at up to `rate` (rad/s) and `acceleration` (rad/s²)."""

    @abstractmethod
    def spin(self, axis: str, rate: float, acceleration: float) -> None:
        """Turn an axis at a signed `rate` (rad/s), reached at `acceleration` (rad/s²)."""

    @abstractmethod
    def stop(self) -> None:
        """Decelerate all axes and hold them; the hardware interlock is the safety function.

        Even on a new connection, the command is sent before any answer has arrived. `ProtocolError`
        means that it was not answered. `LinkLost` means that no connection was possible.
        """

    @abstractmethod
    def kill(self, axis: str | None = None, *, coasting: bool = False) -> None:
        """Switch off the power of one or all axes; an axis that turns must be allowed to coast."""

    @abstractmethod
    def read(self) -> TableState:
        """Return the present state of the table."""

    def unwrapped_time(self, time: float) -> float:
        """Return a time that continues where the controller's clock wraps around, s.

        Call this once for each reading, with the time that the controller reports. A step back by
        more than half of `wrap_period` is a wrap, and as large a step forward undoes one, because
        it was a wrong digit. The table must be read more often than this.
        """
        step = time - self._last_time
        if isfinite(self.wrap_period) and isfinite(step):
            self._wrapped_time -= self.wrap_period * round(step / self.wrap_period)
        self._last_time = time
        return time + self._wrapped_time

    def indices(self, axis: str | None) -> tuple[int, ...]:
        """Return the index of one axis, or the indices of all axes; see `axis_index`."""
        return tuple(range(len(self.axes))) if axis is None else (axis_index(axis, self.axes),)

    def checked_index(
        self, axis: str, rate: float, acceleration: float, angle: float | None = None
    ) -> int:
        """Return the index of an axis after checking a motion; see `AxisLimits.check`."""
        i = axis_index(axis, self.axes)
        self.limits[i].check(axis, rate, acceleration, angle)
        return i


def axis_index(axis: str, axes: tuple[str, ...]) -> int:
    """Return the index of an axis by its name; the `InputError` lists the names."""
    if axis not in axes:
        raise InputError(f"no axis {axis!r}; this table has {', '.join(axes)}", names=(axis,))
    return axes.index(axis)


def require_unique_names(axes: tuple[str, ...]) -> None:
    """Raise an `InputError` if there are no axes or two have the same name."""
    if not axes or len(set(axes)) < len(axes):
        raise InputError(
            f"the axes of the table are {', '.join(axes) or 'none'}; give at least one, each with "
            "its own name",
            names=axes,
        )


def stop_with_retry(stop: Callable[[], object]) -> None:
    """Stop the table; if the command was not acknowledged, repeat it once.

    After a missing reply, the second command uses a new connection. Repeating a stop is harmless.
    A `TableFault` is not repeated, because the controller has refused the command.
    """
    try:
        stop()
    except (ProtocolError, LinkLost):
        stop()


_HEAD = Struct("<dd")
_AXIS = Struct("<dddB")
_FLAGS = _IN_POSITION, _MOVING, _ENABLED, _HOMED, _FAULT = 1, 2, 4, 8, 16


class StateArrays(NamedTuple):
    """A series of table states in s, rad and rad/s."""

    time: Array  # (n,) by the clock of the table's controller
    span: Array  # (n,)
    angle: Array  # (n, k)
    rate: Array  # (n, k)
    following_error: Array  # (n, k)
    settled: Bools  # (n,), all axes
    homed: Bools  # (n,), all axes


def pack_state(state: TableState) -> bytes:
    """Convert a state to the payload of a log frame."""
    parts = [_HEAD.pack(state.time, state.span)]
    for a in state.axes:
        states = (a.in_position, a.moving, a.enabled, a.homed, bool(a.faults))
        flags = sum(flag for flag, on in zip(_FLAGS, states, strict=True) if on)
        parts.append(_AXIS.pack(a.angle, a.rate, a.following_error, flags))
    return b"".join(parts)


def unpack_states(payloads: Sequence[bytes]) -> StateArrays:
    """Convert several payloads to arrays of states.

    Parameters
    ----------
    payloads : sequence of bytes
        One or more payloads.

    Raises
    ------
    InputError
        The length of a payload does not match a state or differs from the length of the first.
    """
    k = _axis_count(payloads[0])
    if any(len(one) != len(payloads[0]) for one in payloads):
        raise InputError(
            "the log contains states of tables with different numbers of axes; read each run's log "
            "separately",
            key="payloads",
        )
    rows = np.frombuffer(b"".join(payloads), _record_dtype(k))
    of = rows["axes"]
    settled = (of["flags"] & (_IN_POSITION | _MOVING) == _IN_POSITION).all(axis=-1)
    homed = (of["flags"] & _HOMED != 0).all(axis=-1)
    return StateArrays(
        rows["time"], rows["span"], of["angle"], of["rate"], of["error"], settled, homed
    )


@cache
def _record_dtype(k: int) -> np.dtype[Any]:
    axis = np.dtype([("angle", "<f8"), ("rate", "<f8"), ("error", "<f8"), ("flags", "u1")])
    return np.dtype([("time", "<f8"), ("span", "<f8"), ("axes", axis, (k,))])


def _axis_count(payload: bytes) -> int:
    """Return the number of axes in a payload."""
    k, rest = divmod(len(payload) - _HEAD.size, _AXIS.size)
    if k < 1 or rest:
        raise InputError(
            f"the log has a table state of {len(payload)} bytes; a state has {_HEAD.size} bytes "
            f"and {_AXIS.size} more per axis: the log is of another version",
            key="payload",
        )
    return k
