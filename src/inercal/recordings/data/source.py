"""The view of a run that readers of data use, and their result."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol, TypeVar

from inercal.physics.plan import Step
from inercal.physics.sensors import Sensor
from inercal.recordings import Finding, Mark, Observations, Recording
from inercal.recordings.data.data_section import DataSection
from inercal.recordings.environment import Environment

if TYPE_CHECKING:
    from inercal.recordings.segments import RestDetection  # the kernels load with the readers

D = TypeVar("D", bound=DataSection, covariant=True)


class ChosenMethod(Protocol):
    """The view of the method that readers of data use."""

    @property
    def name(self) -> str:
        """Its name in the run file."""
        ...

    @property
    def unknown_attitudes(self) -> bool:
        """Whether it estimates the attitudes: there is no plan that rows must fit."""
        ...

    @property
    def follows_rest(self) -> bool:
        """Whether the whole recording is one rest, whose samples it follows."""
        ...

    @property
    def without_angles(self) -> bool:
        """Whether it uses no angle of a turntable: the gyros show rests and turns."""
        ...

    @property
    def sequential(self) -> object:
        """Its sequential estimator; None where it has none."""
        ...


class Source(Protocol[D]):
    """The parts of a run that its data need; `Run` of the run file satisfies it."""

    @property
    def path(self) -> Path:
        """The run file, which messages name."""
        ...

    @property
    def data(self) -> D:
        """[data], of the kind of bench."""
        ...

    @property
    def sensor(self) -> Sensor:
        """The axes to read, and the wanted coefficients."""
        ...

    @property
    def bench(self) -> Any:
        """The bench, of the kind whose reader is called."""
        ...

    @property
    def method(self) -> ChosenMethod:
        """The method."""
        ...

    @property
    def environment(self) -> Environment | None:
        """The temperatures around the bench."""
        ...

    @property
    def rate_hz(self) -> float | None:
        """Samples per second, where stated."""
        ...

    @property
    def reader_options(self) -> Mapping[str, object]:
        """Keys of [data] that belong to the reader of a format."""
        ...

    @property
    def has_plan_keys(self) -> bool:
        """Whether the run file has keys of the plan."""
        ...

    @property
    def steps(self) -> tuple[Step, ...]:
        """The nominal plan."""
        ...

    def file(self, name: str) -> Path:
        """Return the path of a file that the run file names."""
        ...


@dataclass(frozen=True, eq=False)
class EstimatorInput:
    """What an estimator needs, made from a run's data.

    Parameters
    ----------
    recording : Recording or None
        None where the data are a table of means.
    marks : tuple of Mark
    observations : Observations
    plan : tuple of Step
        The planned steps; steps without a row were not carried out.
    steps : tuple of Step
        The step of each row.
    findings : tuple of Finding
    conditions : dict of str to str
        Conditions of the bench, in words with units.
    rests : RestDetection or None
        The detection of rests, where it used no plan.
    bench : Bench or None
        The bench, where the data determine more of it than the run file states.
    notes : tuple of str
        Further results from the data, in plain words.
    """

    recording: Recording | None
    marks: tuple[Mark, ...]
    observations: Observations
    plan: tuple[Step, ...]
    steps: tuple[Step, ...]
    findings: tuple[Finding, ...]
    conditions: dict[str, str] = field(default_factory=dict[str, str])
    rests: "RestDetection | None" = None
    bench: Any = None
    notes: tuple[str, ...] = ()

    def sensor_of_samples(self, sensor: Sensor) -> Sensor:
        """Return the sensor with the noise by which an estimator weighs the observations.

        Estimators that follow samples weigh single ones by the stated noise, which does not include
        their rounding; the covariance of means does.
        """
        if self.observations.track is None:
            return sensor
        assert self.recording is not None
        return sensor.rounded(self.recording.rate_hz)
