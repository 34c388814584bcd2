"""What a host asks of a bench that it drives: axes, limits, the tasks of a plan, what it senses.

A host knows no class of bench. A kind that can be driven states a `MotionControl`; its bench is a
`ControlledBench`. There are two ways to carry out a plan. A table of angles turns from place to
place (`TurnTask`). A table of rates rests or spins at a set rate for a time, with the sensor in a
mounting that an operator changes by hand (`SpinTask`).
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from math import isfinite
from typing import Any, Literal, Protocol

from inercal.basics.arrays import Array
from inercal.basics.errors import InputError
from inercal.basics.parameters import Parameter

Angles = tuple[float, ...]


@dataclass(frozen=True)
class AxisMotionLimits:
    """Limits of the motion of an axis.

    Parameters
    ----------
    rate : float
        rad/s.
    acceleration : float
        rad/s².
    jerk : float or None
        rad/s³; None is no limit: the rate is then a trapezoid.

    Raises
    ------
    InputError
        A limit that is not > 0 and finite.
    """

    rate: float
    acceleration: float
    jerk: float | None = None

    def __post_init__(self) -> None:
        for what, unit in (("rate", "rad/s"), ("acceleration", "rad/s²"), ("jerk", "rad/s³")):
            size = getattr(self, what)
            if size is not None and not (isfinite(size) and size > 0):
                raise InputError(
                    f"table: limit of {what} is {size} {unit}; it must be greater than 0",
                    key=what,
                )


class ControlledBench(Protocol):
    """A bench whose axes a host drives."""

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the axes, outermost first."""
        ...

    @property
    def axis_motion_limits(self) -> tuple[AxisMotionLimits, ...]:
        """The limits of each axis, outermost first."""
        ...


@dataclass(frozen=True)
class TurnTask:
    """One step of a plan on a table of angles.

    Parameters
    ----------
    label : str
        Of the section that it leaves.
    start, end : tuple of float
        Angles of all axes, outermost first, rad: brought there first; there when it is done.
    rate : float
        rad/s of the turn from start to end; 0 of a stay.
    seconds : float
        Length of the section, s; that of a turn follows from angle, rate and acceleration.
    approach : float
        Duration of the motion from the previous step to `start`, s.
    """

    label: str
    start: Angles
    end: Angles
    rate: float
    seconds: float
    approach: float

    @property
    def section(self) -> str:
        """The label of the step's samples in the recording."""
        return self.label


@dataclass(frozen=True)
class SpinTask:
    """One state of a plan on a table of rates.

    Parameters
    ----------
    label : str
    rate : float
        Set rate, rad/s, signed; 0 at rest.
    seconds : float
        At this rate.
    approach : float
        Duration of the change from the previous rate, s.
    mounting : str
        Name of the sensor's mounting, which labels the samples in the recording.
    instruction : str
        The mounting, for the operator.
    """

    label: str
    rate: float
    seconds: float
    approach: float
    mounting: str
    instruction: str

    @property
    def section(self) -> str:
        """The label of the state's samples in the recording."""
        return self.mounting


Task = TurnTask | SpinTask
SensedMotion = Callable[[Array, str], Array]


@dataclass(frozen=True)
class MotionControl:
    """What a host asks of a kind of bench.

    Parameters
    ----------
    tasks : callable
        From bench and steps to the tasks, in the order of a run.
    readback : callable
        From the bench to the names of its readback, as in [data], one of each axis.
    quantity : "angle" or "rate"
        What is read back of an axis and recorded. Only a table of angles has an attitude.
    required_keys : mapping of str to str
        Keys of [data] that a recording by a host needs, with an example of each.
    settling : callable
        From the bench to the time that goes at both ends of a hold, s.
    errors : callable
        From bench and steps to the parameters that a simulation draws, by full name.
    sensed_motion : callable
        From bench, steps and values of these parameters to a function: from angles, rates and
        accelerations of the axes, (n, k, 3), and the name of the mounting, to f, ω and its
        derivative in the sensor's frame, (n, 9).
    """

    tasks: Callable[[Any, Sequence[Any]], Sequence[Task]]
    readback: Callable[[Any], tuple[str, ...]]
    quantity: Literal["angle", "rate"]
    required_keys: Mapping[str, str]
    settling: Callable[[Any], float]
    errors: Callable[[Any, Sequence[Any]], Mapping[str, Parameter]]
    sensed_motion: Callable[[Any, Sequence[Any], Mapping[str, float]], SensedMotion]

    @property
    def has_attitude(self) -> bool:
        """Whether the readback tells the attitude of the sensor."""
        return self.quantity == "angle"
