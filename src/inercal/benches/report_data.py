"""Define what a kind of bench adds to a report, as data: directions, plots and tables.

A bench returns only numbers and words; the report draws and prints them.
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

if TYPE_CHECKING:  # estimates are loaded after the run file is checked
    from inercal.estimation import Estimate

Columns = Mapping[str, Sequence[str] | Sequence[float] | Sequence[int]]


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class ReportInput(ABC):
    """The part of an outcome that its bench reports; `inercal.pipeline.Outcome` adds the rest.

    Parameters
    ----------
    estimate : Estimate
        The estimate, with the bench's nuisances and the residuals.
    observations : Observations
    steps : tuple of Step
        The step of each observation.
    bench : Bench
    expected : mapping of str to Parameter
        Stated values of the bench's parameters that act on these steps, by full name.
    recording : Recording or None
        The recording; None if the data are a table of means.
    marks : tuple of Mark
        Marks in the recording.
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
            Angular rate, rad/s, if the sensor has no gyros.
        """


@dataclass(frozen=True, eq=False)
class MeasuredDirection:
    """The measured direction of one row.

    Parameters
    ----------
    step : Step
    unit_vector : (3,) array
        Unit vector in the sensor's frame: the upward direction during a hold, the axis during a
        turn, or the direction of the specific force while the bench spins.
    deviation_angle : float
        Angle from the nominal direction, rad; NaN if it is unknown.
    """

    step: Step
    unit_vector: Array
    deviation_angle: float


def measured_direction(step: Step, vector: Array, nominal: Array | None) -> MeasuredDirection:
    """Return the direction of a vector and its angle from the nominal direction, if known."""
    unit = vector / (np.linalg.norm(vector) or nan)  # a dead sensor measures no direction
    if nominal is None:
        return MeasuredDirection(step, unit, nan)
    cosine = unit @ nominal / np.linalg.norm(nominal)
    return MeasuredDirection(step, unit, acos(float(np.clip(cosine, -1.0, 1.0))))


def specific_force_directions(shown: ReportInput) -> tuple[MeasuredDirection, ...]:
    """Return the direction of the specific force in each row, compared with the nominal one.

    The result is empty if the accelerometers do not measure all components.
    """
    if shown.sensor.rank("f") < len("xyz"):
        return ()
    nominal, sensed = shown.bench.mean_motion(shown.steps, {}).f, shown.sensed_motion().f
    return tuple(map(measured_direction, shown.steps, sensed, nominal))


@dataclass(frozen=True, eq=False)
class Series:
    """A series of points in a panel.

    Parameters
    ----------
    x, y : (n,) arrays
        Coordinates of the points, in the units that the panel's labels name.
    name : str
    sd : (n,) array, optional
        Standard deviations of y, drawn as bars of ±2 standard deviations.
    hollow : bool
        Whether the points are drawn hollow, as the reference of the comparison.
    """

    x: Array
    y: Array
    name: str
    sd: Array | None = None
    hollow: bool = False


@dataclass(frozen=True)
class Panel:
    """One panel of a plot; all panels of a plot have the same height and scale."""

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
        Name of the figure, one word.
    title : str
        Description for readers who cannot see the figure.
    text : str
        Caption of the figure.
    y : str
        Label of the y axis that the panels share.
    panels : tuple of Panel
    """

    name: str
    title: str
    text: str
    y: str
    panels: tuple[Panel, ...] = ()


def describe_row(step: Step, shown: ReportInput, row: int) -> str:
    """Describe a step in words."""
    return step.describe()


def describe_spin(step: Step, shown: ReportInput, row: int) -> str:
    """Describe a state at a rate, and the norm of its readings, in words."""
    force = float(np.linalg.norm(shown.observations.mean[row, :3])) / G0
    return f"{step.describe()}; reads {force:.4g} g"
