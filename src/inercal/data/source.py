"""What a reader of data sees of a run, and what it makes of them."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol, TypeVar

from inercal.data.data_section import DataSection
from inercal.plan import Step
from inercal.recording import Finding, Mark, Observations, Recording
from inercal.sensors import Sensor

if TYPE_CHECKING:
    from inercal.segments import RestDetection  # the kernels load with the readers

D = TypeVar("D", bound=DataSection, covariant=True)


class ChosenMethod(Protocol):
    """What a reader of data sees of the method."""

    @property
    def name(self) -> str:
        """As the run file has it."""
        ...

    @property
    def unknown_attitudes(self) -> bool:
        """Whether it finds the attitudes itself: there is no plan that rows must fit."""
        ...

    @property
    def sequential(self) -> object:
        """What follows a run while it goes on; None where there is none."""
        ...


class Source(Protocol[D]):
    """A run as far as its data are read: the run file's own type satisfies it."""

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
        """The axes that are read, and the coefficients wanted."""
        ...

    @property
    def bench(self) -> Any:
        """The bench, of the kind that reads."""
        ...

    @property
    def method(self) -> ChosenMethod:
        """The method."""
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
        """Whether the run file says something of the plan."""
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
        None when means were read straight in.
    marks : tuple of Mark
    observations : Observations
    plan : tuple of Step
        What was to be done; steps without a row were not carried out.
    steps : tuple of Step
        Of each row.
    findings : tuple of Finding
    conditions : dict of str to str
        Of the bench, in words with units.
    rests : RestDetection or None
        How rests were found, where they were found without a plan.
    bench : Bench or None
        Where the data tell more of it than the run file states.
    notes : tuple of str
        What the data tell besides, in plain words.
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
