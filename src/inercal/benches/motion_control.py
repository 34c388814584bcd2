"""Define how a host drives a bench: its axes, limits, tasks and sensed motion.

A host does not depend on any class of bench. A kind that can be driven has a `MotionControl`, and
its bench is a `ControlledBench`. There are two ways to carry out a plan. A positioning table turns
from angle to angle (`TurnTask`). A rate table rests or spins at a set rate for a time, while the
sensor is in a mounting that an operator changes by hand (`SpinTask`).
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
        Largest rate, rad/s.
    acceleration : float
        Largest acceleration, rad/s².
    jerk : float or None
        Largest jerk, rad/s³. None means no limit; the rate then has a trapezoidal profile.

    Raises
    ------
    InputError
        A limit is not finite or not greater than 0.
    """

    rate: float
    acceleration: float
    jerk: float | None = None

    def __post_init__(self) -> None:
        for what, unit in (("rate", "rad/s"), ("acceleration", "rad/s²"), ("jerk", "rad/s³")):
            size = getattr(self, what)
            if size is not None and not (isfinite(size) and size > 0):
                raise InputError(
                    f"table: the {what} limit is {size} {unit}; it must be greater than 0",
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
        """Motion limits of each axis, outermost first."""
        ...


@dataclass(frozen=True)
class TurnTask:
    """One step of a plan on a positioning table.

    Parameters
    ----------
    label : str
        Label of the section of the recording that belongs to the step.
    start, end : tuple of float
        Angles of all axes at the start and the end of the step, outermost first, rad.
    rate : float
        Rate of the turn from start to end, rad/s; 0 if the table stays still.
    seconds : float
        Length of the section, s. For a turn it follows from angle, rate and acceleration.
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
    """One state of a plan on a rate table.

    Parameters
    ----------
    label : str
    rate : float
        Set rate, rad/s, signed; 0 at rest.
    seconds : float
        Time at this rate, s.
    approach : float
        Duration of the change from the previous rate, s.
    mounting : str
        Name of the sensor's mounting, which labels the samples in the recording.
    instruction : str
        Instruction for the operator, which describes the mounting.
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
    """The functions of a kind of bench that a host needs to drive it.

    Parameters
    ----------
    tasks : callable
        Returns the tasks for a bench and steps, in the order of a run.
    readback : callable
        Returns the names of a bench's readback columns, as in [data], one per axis.
    quantity : "angle" or "rate"
        Quantity that is read back from each axis and recorded. Only angles give an attitude.
    required_keys : mapping of str to str
        Keys of [data] that a host needs for a recording, with an example of each.
    settling : callable
        Returns the time that is cut off at both ends of a hold on a bench, s.
    errors : callable
        Returns the parameters that a simulation draws for a bench and steps, by full name.
    sensed_motion : callable
        Returns a function for a bench, steps and values of these parameters. That function takes
        the angles, rates and accelerations of the axes, (n, k, 3), and the name of the mounting,
        and returns f, ω and the derivative of ω in the sensor's frame, (n, 9).
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
        """Whether the readback gives the attitude of the sensor."""
        return self.quantity == "angle"
