"""The part of a report that a kind of bench contributes, as data: directions, plots and tables.

A bench returns numbers and words; the report draws and prints them.
"""

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import acos, nan
from typing import TYPE_CHECKING, Any

import numpy as np

from inercal.basics.arrays import Array
from inercal.basics.parameters import Parameter
from inercal.physics.motion import Motion
from inercal.physics.plan import Step
from inercal.physics.sensors import G0, Sensor
from inercal.recordings import Mark, Observations, Recording

if TYPE_CHECKING:  # what is estimated loads after the run file is checked
    from inercal.estimation import Estimate

Columns = Mapping[str, Sequence[str] | Sequence[float] | Sequence[int]]


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class ReportInput(ABC):
    """The part of an outcome that its bench reports; `inercal.pipeline.Outcome` adds the rest.

    Parameters
    ----------
    estimate : Estimate
        With the bench's nuisances and the residuals.
    observations : Observations
    steps : tuple of Step
        Of each observation.
    bench : Bench
    expected : mapping of str to Parameter
        The bench's parameters that act on these steps, by full name, as they were stated.
    recording : Recording or None
        None when the data are a table of means.
    marks : tuple of Mark
        Of the recording.
    """

    estimate: "Estimate"
    observations: Observations
    steps: tuple[Step, ...]
    bench: Any
    expected: Mapping[str, Parameter]
    recording: Recording | None
    marks: tuple[Mark, ...]

    @property
    @abstractmethod
    def sensor(self) -> Sensor:
        """The sensor with its estimated coefficients."""

    @abstractmethod
    def sensed_motion(self, w: Array | None = None) -> Motion:
        """Return the motion that the calibrated sensor measured, at the temperatures of the means.

        Parameters
        ----------
        w : (r, 3) array, optional
            Angular rate where the sensor has no gyros, rad/s.
        """


@dataclass(frozen=True, eq=False)
class MeasuredDirection:
    """The measured direction of one row.

    Parameters
    ----------
    step : Step
    unit_vector : (3,) array
        Unit vector in the sensor's frame: up in a hold, the axis of a turn, the specific force
        where the bench turns.
    deviation_angle : float
        Angle from the nominal direction, rad; NaN where it is unknown.
    """

    step: Step
    unit_vector: Array
    deviation_angle: float


def measured_direction(step: Step, vector: Array, nominal: Array | None) -> MeasuredDirection:
    """Return the direction of a vector and its angle from the nominal direction, if known."""
    unit = vector / np.linalg.norm(vector)
    if nominal is None:
        return MeasuredDirection(step, unit, nan)
    cosine = unit @ nominal / np.linalg.norm(nominal)
    return MeasuredDirection(step, unit, acos(float(np.clip(cosine, -1.0, 1.0))))


def specific_force_directions(shown: ReportInput) -> tuple[MeasuredDirection, ...]:
    """Return the direction of the specific force in each row, against the nominal direction."""
    nominal, sensed = shown.bench.mean_motion(shown.steps, {}).f, shown.sensed_motion().f
    return tuple(map(measured_direction, shown.steps, sensed, nominal))


@dataclass(frozen=True, eq=False)
class Series:
    """Points of a panel.

    Parameters
    ----------
    x, y : (n,) arrays
        In the units that the panel's labels name.
    name : str
    sd : (n,) array, optional
        Drawn as ±2.
    hollow : bool
        Drawn as the reference of the comparison.
    """

    x: Array
    y: Array
    name: str
    sd: Array | None = None
    hollow: bool = False


@dataclass(frozen=True)
class Panel:
    """One panel of a plot; panels of a plot have one height and one scale."""

    title: str
    x: str
    series: tuple[Series, ...]
    ticks: tuple[float, ...] = ()


@dataclass(frozen=True)
class Plot:
    """A figure of the report.

    Parameters
    ----------
    name : str
        Of the figure, one word.
    title : str
        Description for readers who do not see it.
    text : str
        Caption.
    y : str
        Label of the panels' common axis.
    panels : tuple of Panel
    """

    name: str
    title: str
    text: str
    y: str
    panels: tuple[Panel, ...] = ()


def describe_row(step: Step, shown: ReportInput, row: int) -> str:
    """Return a step in words."""
    return step.describe()


def describe_spin(step: Step, shown: ReportInput, row: int) -> str:
    """Return a state at a rate, and the norm of its readings, in words."""
    force = float(np.linalg.norm(shown.observations.mean[row, :3])) / G0
    return f"{step.describe()}; reads {force:.4g} g"
