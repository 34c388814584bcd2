"""What a method is: a plan, the coefficients it sees, and named estimators."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import Any, Generic, Literal, NamedTuple, Protocol, TypeVar

from inercal.arrays import Array
from inercal.calibration.forms import Frame
from inercal.errors import InputError
from inercal.estimate import Estimate, Gaussian
from inercal.recording import Finding, Observations, Track
from inercal.sensors import Sensor

Kind = Literal["f", "w"]
_WORDS = {"f": "accelerometers", "w": "gyros"}
Bench = TypeVar("Bench")
Step = TypeVar("Step")
BenchIn = TypeVar("BenchIn", contravariant=True)
StepIn = TypeVar("StepIn", contravariant=True)


class Estimator(Protocol[BenchIn, StepIn]):
    """From observations to an estimate of the sensor's coefficients, in their order."""

    def __call__(
        self,
        observations: Observations,
        sensor: Sensor,
        bench: BenchIn,
        steps: Sequence[StepIn],
        priors: Sequence[Gaussian] = (),
    ) -> Estimate:
        """Return the estimate; raise NotObserved where the data do not support it."""
        ...


class PartialEstimate(NamedTuple):
    """What the samples so far say of a part of the sensor.

    Parameters
    ----------
    names : tuple of p str
        Coefficients of the part, "gx.bias".
    value : (p,) array
        SI.
    covariance : (p, p) array
        SI.
    nis : float
        Sum of the innovations' squares, normalised by what was stated of them.
    components : int
        How many innovations that is of.
    """

    names: tuple[str, ...]
    value: Array
    covariance: Array
    nis: float
    components: int


class Sequential(Protocol):
    """A sequential estimator that follows one run.

    A run as it goes on and its recording afterwards are the same samples in pieces of different
    lengths; the estimate is the same to the last bit.
    """

    def feed(self, track: Track) -> None:
        """Take in the samples that follow; raise InputError where they cannot be followed."""
        ...

    def estimate(self) -> Mapping[str, PartialEstimate]:
        """Return the estimate by part: "f" and "w", or "all" where the axes are estimated together.

        It is empty until there are enough samples to begin with.
        """
        ...


class SequentialEstimator(Protocol[BenchIn, StepIn]):
    """Begins a sequential estimator of a run."""

    def __call__(
        self,
        estimator: str,
        sensor: Sensor,
        bench: BenchIn,
        steps: Sequence[StepIn],
        priors: Sequence[Gaussian],
        rate_hz: float,
    ) -> Sequential:
        """Return the estimator before the first sample.

        Parameters
        ----------
        estimator : str
            Name of one of the method's.
        sensor : Sensor
        bench : Bench
        steps : sequence of steps
            As planned: how long the run will last may decide which states there are.
        priors : sequence of Gaussian
        rate_hz : float
            Samples per second.

        Raises
        ------
        InputError
            An estimator, a sensor or a prior that cannot be followed.
        """
        ...


@dataclass(frozen=True, eq=False)
class Fit(Generic[Bench, Step]):
    """What an estimator was given, and what it made of it.

    Parameters
    ----------
    estimator : str
        Its name.
    sensor : Sensor
    bench : Bench
        As the estimator took it.
    observations : Observations
    steps : sequence of Step
        Of each row.
    priors : sequence of Gaussian
    estimate : Estimate
    time_offset : bool
        Whether the gyros' delay is asked for.
    """

    estimator: str
    sensor: Sensor
    bench: Bench
    observations: Observations
    steps: Sequence[Step]
    priors: Sequence[Gaussian]
    estimate: Estimate
    time_offset: bool = False


class Remarks(NamedTuple):
    """What a method says of a fit besides its estimate.

    Parameters
    ----------
    findings : tuple of Finding
        What may be wrong, for the verdict.
    notes : tuple of str
        In plain words.
    conditions : mapping of str to str
        For the calibration's conditions, in words with units.
    """

    findings: tuple[Finding, ...] = ()
    notes: tuple[str, ...] = ()
    conditions: Mapping[str, str] = MappingProxyType({})


def _no_remarks(fit: Fit[Any, Any]) -> Remarks:
    return Remarks()


def _mount_frame(bench: object) -> Frame:
    return "mount"


@dataclass(frozen=True)
class Method(Generic[Bench, Step]):
    """A way to calibrate.

    Parameters
    ----------
    name : str
    bench : type
        The kind of bench that it takes.
    default_coefficients : mapping of "f" or "w" to tuple of str
        The groups of coefficients that it finds by default, of accelerometers and of gyros. A
        kind of axis that is not here is left out.
    also : mapping of "f" or "w" to tuple of str
        What it can find on wish.
    needs : tuple of "f" or "w"
        Kinds of axes it cannot do without.
    plan : callable
        Nominal steps; keyword arguments are the method's own (seconds, angle).
    estimators : mapping
        By name; the first is the default.
    source : str
    unknown_attitudes : bool
        Whether attitudes are free: rests are found and named by themselves, not from the plan.
    norm_only_estimators : tuple of str
        Estimators of norms, which see no rotation of the triad: its frame may be stated.
    frame : callable
        From the bench to the frame that misalignments refer to where the run file states none.
    remarks : callable
        From a `Fit` to `Remarks`; called of one that did not converge too.
    sequential : callable or None
        Begins the estimation of a run while it goes on; None where there is none.
    """

    name: str
    bench: type[Bench]
    default_coefficients: Mapping[Kind, tuple[str, ...]]
    needs: tuple[Kind, ...]
    plan: Callable[..., tuple[Step, ...]]
    estimators: Mapping[str, Estimator[Bench, Step]]
    source: str
    also: Mapping[Kind, tuple[str, ...]] = field(default_factory=dict[Kind, tuple[str, ...]])
    unknown_attitudes: bool = False
    norm_only_estimators: tuple[str, ...] = ()
    frame: Callable[[Bench], Frame] = _mount_frame
    remarks: Callable[[Fit[Bench, Step]], Remarks] = _no_remarks
    sequential: SequentialEstimator[Bench, Step] | None = None

    def prepare(
        self, sensor: Sensor, coefficients: Sequence[str] = (), also: Sequence[str] = ()
    ) -> Sensor:
        """Return the part of the sensor the method calibrates, with the chosen coefficients.

        Parameters
        ----------
        sensor : Sensor
        coefficients : sequence of str
            Names or groups in place of the method's own choice.
        also : sequence of str
            Names or groups beside it.

        Raises
        ------
        InputError
            The sensor lacks axes the method needs, or a coefficient is beyond the method.
        """
        kinds = {axis.measures for axis in sensor.axes}
        if not set(self.needs) <= kinds:
            need = " and ".join(_WORDS[kind] for kind in self.needs)
            raise InputError(f"method {self.name} needs {need}; sensor {sensor.name} lacks them")
        part = replace(
            sensor, axes=tuple(a for a in sensor.axes if a.measures in self.default_coefficients)
        )
        own, possible = (
            self._selected_coefficients(part, {}),
            self._selected_coefficients(part, self.also),
        )
        chosen = part.with_coefficients(*coefficients).coefficients if coefficients else own
        more = part.with_coefficients(*also).coefficients
        beyond = [name for name in (*chosen, *more) if name not in possible]
        if beyond:
            seen = "; ".join(
                f"of {_WORDS[kind]} {', '.join((*words, *self.also.get(kind, ())))}"
                for kind, words in self.default_coefficients.items()
            )
            raise InputError(f"method {self.name} cannot see {', '.join(beyond)}: it sees {seen}")
        return replace(part, coefficients=tuple(n for n in possible if n in (*chosen, *more)))

    def possible(self, sensor: Sensor) -> tuple[str, ...]:
        """Return the full names of the coefficients of a sensor's axes that it can estimate."""
        return self._selected_coefficients(sensor, self.also)

    def _selected_coefficients(
        self, part: Sensor, also: Mapping[Kind, tuple[str, ...]]
    ) -> tuple[str, ...]:
        """Return the coefficients the method finds, by default or with what it can find also."""
        names: tuple[str, ...] = ()
        for kind, words in self.default_coefficients.items():
            axes = part.select_axes(kind)
            if axes.axes:
                names += axes.with_coefficients(*words, *also.get(kind, ())).coefficients
        return names

    def estimator(self, name: str) -> Estimator[Bench, Step]:
        """Return an estimator by name ("" is the default).

        Raises
        ------
        InputError
            No such estimator; the message lists those there are.
        """
        if name and name not in self.estimators:
            raise InputError(
                f"method {self.name} has no estimator {name!r}; it has {', '.join(self.estimators)}"
            )
        return self.estimators[name or next(iter(self.estimators))]
