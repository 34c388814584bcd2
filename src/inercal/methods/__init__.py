"""Calibration methods by name, and the residuals that they share.

A method has a plan, the coefficients that it estimates, and named estimators.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Generic, NamedTuple, Protocol, TypeAlias, TypeVar

from inercal.basics.arrays import Array
from inercal.basics.errors import InputError
from inercal.basics.registry import Registry
from inercal.benches.report_data import Plot
from inercal.physics.quantities import QUANTITIES, Measures
from inercal.physics.sensors import Sensor
from inercal.recordings import Finding, Observations, Track
from inercal.recordings.data import MethodBase
from inercal.recordings.environment import Environment

if TYPE_CHECKING:  # a run file that is refused needs none of these
    from inercal.calibration.forms import Frame
    from inercal.estimation import Estimate, Gaussian

Priors: TypeAlias = "Sequence[Gaussian]"
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
        priors: Priors = (),
    ) -> "Estimate":
        """Return the estimate; raise NotObserved where the data do not support it."""
        ...


class PartialEstimate(NamedTuple):
    """The estimate of a part of the sensor from the samples so far.

    Parameters
    ----------
    names : tuple of p str
        Coefficients of the part, "gx.bias".
    value : (p,) array
        SI.
    covariance : (p, p) array
        SI.
    nis : float
        Sum of the normalised innovations squared.
    components : int
        Number of innovations in that sum.
    """

    names: tuple[str, ...]
    value: Array
    covariance: Array
    nis: float
    components: int


class Sequential(Protocol):
    """A sequential estimator that follows one run.

    The samples arrive in pieces of any length, live or from a recording; how they are cut does not
    change a bit of the estimate.
    """

    def feed(self, track: Track) -> None:
        """Process the next samples; raise InputError where they cannot be used."""
        ...

    def estimate(self) -> Mapping[str, PartialEstimate]:
        """Return the estimate by part: "f" and "w", or "all" where the axes are estimated together.

        Empty until there are enough samples for a first estimate.
        """
        ...


class SequentialEstimator(Protocol[BenchIn, StepIn]):
    """Starts a sequential estimator of a run."""

    def __call__(
        self,
        estimator: str,
        sensor: Sensor,
        bench: BenchIn,
        steps: Sequence[StepIn],
        priors: Priors,
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
            As planned: the length of the run may decide which states the estimator has.
        priors : sequence of Gaussian
        rate_hz : float
            Samples per second.

        Raises
        ------
        InputError
            An estimator, a sensor or a prior that cannot be used sequentially.
        """
        ...


@dataclass(frozen=True, eq=False)
class Fit(Generic[Bench, Step]):
    """The arguments of an estimator and its estimate.

    Parameters
    ----------
    estimator : str
        Its name.
    sensor : Sensor
    bench : Bench
        As the estimator used it.
    observations : Observations
    steps : sequence of Step
        Of each row.
    priors : sequence of Gaussian
    estimate : Estimate
    time_offset : bool
        Whether the gyros' delay is to be estimated.
    environment : Environment or None
        The temperatures around the bench, where they are stated.
    """

    estimator: str
    sensor: Sensor
    bench: Bench
    observations: Observations
    steps: Sequence[Step]
    priors: Priors
    estimate: "Estimate"
    time_offset: bool = False
    environment: Environment | None = None


class Remarks(NamedTuple):
    """Findings, notes and conditions that a method adds to an estimate.

    Parameters
    ----------
    findings : tuple of Finding
        Possible errors, for the verdict.
    notes : tuple of str
        Sentences for the verdict.
    conditions : mapping of str to str
        Of the calibration, as text with units.
    plots : tuple of Plot
        Further figures of the report.
    """

    findings: tuple[Finding, ...] = ()
    notes: tuple[str, ...] = ()
    conditions: Mapping[str, str] = MappingProxyType({})
    plots: tuple[Plot, ...] = ()


def _no_remarks(fit: Fit[Any, Any]) -> Remarks:
    return Remarks()


def _mount_frame(bench: object) -> "Frame":
    return "mount"


def triangular_frame(bench: object) -> "Frame":
    """Return the frame of a method without a mounting: the accelerometers' own."""
    return "triangular"


@dataclass(frozen=True, kw_only=True)
class Method(MethodBase, Generic[Bench, Step]):
    """A way to calibrate: what readers of data use of it, `MethodBase`, and the rest.

    Parameters
    ----------
    bench : type
        The kind of bench that it needs.
    default_coefficients : mapping of "f" or "w" to tuple of str
        The groups of coefficients that it estimates by default, of accelerometers and of gyros.
        Axes of a kind that is not a key are left out.
    also : mapping of "f" or "w" to tuple of str
        The groups that it estimates if the user chooses them.
    needs : tuple of "f" or "w"
        Kinds of axes that the sensor must have.
    plan : callable
        Nominal steps; keyword arguments are the method's own (seconds, angle).
    estimators : mapping
        By name; the first is the default.
    source : str
    norm_only_estimators : tuple of str
        Estimators of norms, which do not observe a rotation of the triad: its frame may be stated.
    closed_formulas : tuple of str
        Estimators whose formulas determine a fixed set of coefficients, or that make no score
        tests: `also = "auto"` is refused.
    frame : callable
        From the bench to the frame that misalignments refer to where the run file states none.
    remarks : callable
        From a `Fit` to `Remarks`; called also for a fit that did not converge.
    constant_rates : bool
        Whether gyros are read at constant rates: a calibration then holds over the range of the
        means, and correcting a recording says where it is left.
    weighs_common_errors : bool
        Whether its estimators weigh rows by their whole covariance, with errors in common.
    final_by_recording : bool
        Whether another estimator than the live one gives the result of the recording.
    """

    bench: type[Bench]
    default_coefficients: Mapping[Measures, tuple[str, ...]]
    needs: tuple[Measures, ...]
    plan: Callable[..., tuple[Step, ...]]
    estimators: Mapping[str, Estimator[Bench, Step]]
    source: str
    also: Mapping[Measures, tuple[str, ...]] = field(
        default_factory=dict[Measures, tuple[str, ...]]
    )
    norm_only_estimators: tuple[str, ...] = ()
    closed_formulas: tuple[str, ...] = ()
    frame: "Callable[[Bench], Frame]" = _mount_frame
    remarks: Callable[[Fit[Bench, Step]], Remarks] = _no_remarks
    constant_rates: bool = False
    weighs_common_errors: bool = False
    sequential: SequentialEstimator[Bench, Step] | None = None
    final_by_recording: bool = False

    def prepare(
        self, sensor: Sensor, coefficients: Sequence[str] = (), also: Sequence[str] = ()
    ) -> Sensor:
        """Return the part of the sensor that the method calibrates, with the chosen coefficients.

        Parameters
        ----------
        sensor : Sensor
        coefficients : sequence of str
            Names or groups instead of the method's defaults; of a group, those that the method
            can estimate.
        also : sequence of str
            Names or groups in addition.

        Raises
        ------
        InputError
            The sensor lacks axes that the method needs, or the method cannot estimate a
            coefficient.
        """
        kinds = {axis.measures for axis in sensor.axes}
        if lacking := tuple(QUANTITIES[kind].sensors for kind in self.needs if kind not in kinds):
            raise InputError(
                f"method {self.name} needs {' and '.join(lacking)}, but sensor {sensor.name} "
                "has none; add them to [sensor], or choose another method",
                key="[sensor]",
                names=lacking,
            )
        part = replace(
            sensor, axes=tuple(a for a in sensor.axes if a.measures in self.default_coefficients)
        )
        own, possible = self._selected_coefficients(part, {}), self.possible(part)
        chosen = _stated_coefficients(part, coefficients, possible) if coefficients else own
        more = _stated_coefficients(part, also, possible)
        if beyond := tuple(name for name in (*chosen, *more) if name not in possible):
            seen = "; ".join(
                f"of {QUANTITIES[kind].sensors} {', '.join((*words, *self.also.get(kind, ())))}"
                for kind, words in self.default_coefficients.items()
            )
            raise InputError(
                f"method {self.name} cannot estimate {', '.join(beyond)}; it estimates {seen}",
                key="[method]",
                names=beyond,
            )
        return replace(part, coefficients=tuple(n for n in possible if n in (*chosen, *more)))

    def possible(self, sensor: Sensor) -> tuple[str, ...]:
        """Return the full names of the coefficients of a sensor's axes that it can estimate."""
        return self._selected_coefficients(sensor, self.also)

    def _selected_coefficients(
        self, part: Sensor, also: Mapping[Measures, tuple[str, ...]]
    ) -> tuple[str, ...]:
        """Return the coefficients that the method estimates by default and of groups `also`."""
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
            No estimator has this name; the message lists the estimators.
        """
        if name and name not in self.estimators:
            raise InputError(
                f"method {self.name} has no estimator {name!r}; it has "
                f"{', '.join(self.estimators)}",
                key="[method] estimator",
                names=(name,),
            )
        return self.estimators[name or next(iter(self.estimators))]


def _stated_coefficients(
    part: Sensor, words: Sequence[str], possible: Sequence[str]
) -> tuple[str, ...]:
    """Return the full names that words state: of a group the possible ones, if there are any."""
    names: tuple[str, ...] = ()
    for word in words:
        stated = part.with_coefficients(word).coefficients
        within = tuple(name for name in stated if name in possible)
        names += within or stated
    return names


METHODS: Registry[Method[Any, Any]] = Registry(
    "inercal.methods",
    "method",
    {
        name: f"inercal.methods.{name}:METHOD"
        for name in (
            "six_position",
            "ferraris",
            "multi_position",
            "centrifuge_norm",
            "dual_orthogonal",
            "tumble",
            "ship_planar",
            "ship_multi_angle",
            "rates_and_poses",
            "turntable_kalman",
            "turntable_discrete",
            "turntable_trajectory",
            "systematic",
            "temperature_ramp",
        )
    },
)


def method(name: str) -> Method[Any, Any]:
    """Return a method by name, with hyphens or underscores.

    Raises
    ------
    InputError
        No method has this name; the message lists the methods.
    """
    return METHODS.find(name.replace("-", "_"))
