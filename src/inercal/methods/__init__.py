"""Calibration methods by name, and the residual functions that they share.

A method consists of a plan, the coefficients that it can estimate, and named estimators.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Generic, NamedTuple, Protocol, TypeAlias, TypeVar

import numpy as np

from inercal.basics.arrays import Array
from inercal.basics.errors import InputError
from inercal.basics.registry import Registry
from inercal.benches.report_data import Plot
from inercal.physics.quantities import ANGULAR_RATE, QUANTITIES, SPECIFIC_FORCE, Measures
from inercal.physics.sensors import Sensor
from inercal.recordings import Finding, Observations, Track
from inercal.recordings.data import MethodBase
from inercal.recordings.environment import Environment

if TYPE_CHECKING:  # not needed when a run file is rejected
    from inercal.calibration.forms import Frame
    from inercal.estimation import Estimate, Gaussian

Priors: TypeAlias = "Sequence[Gaussian]"
Bench = TypeVar("Bench")
Step = TypeVar("Step")
BenchIn = TypeVar("BenchIn", contravariant=True)
StepIn = TypeVar("StepIn", contravariant=True)


class Estimator(Protocol[BenchIn, StepIn]):
    """Estimates the sensor's coefficients, in the sensor's order, from observations."""

    def __call__(
        self,
        observations: Observations,
        sensor: Sensor,
        bench: BenchIn,
        steps: Sequence[StepIn],
        priors: Priors = (),
    ) -> "Estimate":
        """Return the estimate; raise NotObserved if the data cannot determine a coefficient."""
        ...


class PartialEstimate(NamedTuple):
    """The estimate for one part of the sensor, from the samples processed so far.

    Parameters
    ----------
    names : tuple of p str
        Names of the estimated coefficients, such as "gx.bias".
    value : (p,) array
        Estimated values, SI.
    covariance : (p, p) array
        Their covariance, SI.
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

    The samples may arrive in pieces of any length, live or from a recording. The estimate is
    identical to the last bit, however the samples are divided into pieces.
    """

    def feed(self, track: Track) -> None:
        """Process the next samples; raise InputError if they cannot be used."""
        ...

    def estimate(self) -> Mapping[str, PartialEstimate]:
        """Return the estimates by part: "f" and "w", or "all" if the axes are estimated together.

        The mapping is empty until there are enough samples for a first estimate.
        """
        ...


class SequentialEstimator(Protocol[BenchIn, StepIn]):
    """Function that creates a sequential estimator for a run."""

    def __call__(
        self,
        estimator: str,
        sensor: Sensor,
        bench: BenchIn,
        steps: Sequence[StepIn],
        priors: Priors,
        rate_hz: float,
    ) -> Sequential:
        """Return a sequential estimator that has not processed any samples yet.

        Parameters
        ----------
        estimator : str
            Name of one of the method's estimators.
        sensor : Sensor
        bench : Bench
        steps : sequence of steps
            The planned steps. The estimator may choose its states by the length of the run.
        priors : sequence of Gaussian
        rate_hz : float
            Samples per second.

        Raises
        ------
        InputError
            The estimator, the sensor or a prior cannot be used sequentially.
        """
        ...


@dataclass(frozen=True, eq=False)
class Fit(Generic[Bench, Step]):
    """The arguments of an estimator and its estimate.

    Parameters
    ----------
    estimator : str
        Name of the estimator.
    sensor : Sensor
    bench : Bench
        The bench as the estimator used it.
    observations : Observations
    steps : sequence of Step
        The step of each row.
    priors : sequence of Gaussian
    estimate : Estimate
    time_offset : bool
        Whether the gyros' delay should be estimated.
    environment : Environment or None
        The temperatures around the bench, if they are stated.
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


class AddMagnetometers(Protocol[Bench, Step]):
    """Adds magnetometers to a fit of accelerometers and gyros."""

    def __call__(self, fit: "Fit[Bench, Step]", field: Sensor, /) -> "tuple[Estimate, Remarks]":
        """Return the estimate of all axes, and remarks on the field."""
        ...


class Remarks(NamedTuple):
    """The findings, notes and conditions that a method adds to an estimate.

    Parameters
    ----------
    findings : tuple of Finding
        Possible errors, which the verdict lists.
    notes : tuple of str
        Sentences for the verdict.
    conditions : mapping of str to str
        Conditions of the calibration, as text with units.
    plots : tuple of Plot
        Additional figures for the report.
    """

    findings: tuple[Finding, ...] = ()
    notes: tuple[str, ...] = ()
    conditions: Mapping[str, str] = MappingProxyType({})
    plots: tuple[Plot, ...] = ()


def _no_remarks(fit: Fit[Any, Any]) -> Remarks:
    return Remarks()


def _accept(sensor: Sensor, observations: Observations, priors: Priors) -> None:
    """Accept all coefficients."""


def _mount_frame(bench: object) -> "Frame":
    return "mount"


def triangular_frame(bench: object) -> "Frame":
    """Return the accelerometers' own frame, for a method without a mounting."""
    return "triangular"


@dataclass(frozen=True, kw_only=True)
class Method(MethodBase, Generic[Bench, Step]):
    """A calibration method, which extends `MethodBase`, the part that the data readers use.

    Parameters
    ----------
    bench : type
        The kind of bench that the method needs.
    default_coefficients : mapping of "f", "w" or "m" to tuple of str
        The groups of coefficients that the method estimates by default, for accelerometers ("f"),
        gyros ("w") and magnetometers ("m"). Axes whose kind is missing here are not calibrated.
    also : mapping of "f" or "w" to tuple of str
        The groups that the method estimates only if the user selects them.
    needs : tuple of "f" or "w"
        Kinds of axes that the sensor must have.
    plan : callable
        Returns the nominal steps; its keyword arguments are specific to the method (seconds,
        angle).
    estimators : mapping
        The estimators by name; the first is the default.
    source : str
        The publications that describe the method.
    norm_only_estimators : tuple of str
        Estimators that use only norms. Norms do not show a rotation of the triad, so the user may
        state the triad's frame.
    closed_formulas : tuple of str
        Estimators whose formulas determine a fixed set of coefficients, or that do not compute
        score tests. The program rejects `also = "auto"` with these estimators.
    frame : callable
        Maps the bench to the frame that misalignments refer to if the run file states none.
    remarks : callable
        Maps a `Fit` to `Remarks`; it is also called for a fit that did not converge.
    constant_rates : bool
        Whether gyros are read at constant rates. If so, the calibration is valid over the range
        of the mean rates, and correcting a recording reports samples outside that range.
    weighs_common_errors : bool
        Whether the estimators weight rows by their full covariance, including errors that rows
        share.
    final_by_recording : bool
        Whether the final result of a recording comes from a different estimator than the live one.
    require_determined : callable
        Raises an error if the sensor's coefficients cannot be determined from observations of this
        kind with these priors, as far as this is known without an estimate.
    add_magnetometers : callable or None
        Maps a `Fit` of accelerometers and gyros, and the magnetometers, to the estimate of all axes
        and remarks on the field; None if the method cannot calibrate magnetometers.
    triads_because : str
        Why the method needs three axes of each kind, as a clause; empty if it takes any number.
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
    require_determined: Callable[[Sensor, Observations, Priors], None] = _accept
    add_magnetometers: "AddMagnetometers[Bench, Step] | None" = None
    triads_because: str = ""

    def prepare(
        self, sensor: Sensor, coefficients: Sequence[str] = (), also: Sequence[str] = ()
    ) -> Sensor:
        """Return the part of the sensor that the method calibrates, with the selected coefficients.

        Parameters
        ----------
        sensor : Sensor
        coefficients : sequence of str
            Names or groups that replace the method's defaults. From a group, the method uses the
            coefficients that it can estimate.
        also : sequence of str
            Additional names or groups.

        Raises
        ------
        InputError
            The sensor does not have the axes that the method needs, or the method cannot estimate a
            coefficient.
        """
        if self.triads_because:
            self._require_triads(sensor)
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
                f"for {QUANTITIES[kind].sensors}: {', '.join((*words, *self.also.get(kind, ())))}"
                for kind, words in self.default_coefficients.items()
            )
            raise InputError(
                f"method {self.name} cannot estimate {', '.join(beyond)}; available {seen}",
                key="[method]",
                names=beyond,
            )
        return replace(part, coefficients=tuple(n for n in possible if n in (*chosen, *more)))

    def _require_triads(self, sensor: Sensor) -> None:
        for quantity in (SPECIFIC_FORCE, ANGULAR_RATE):
            kind, channels = quantity.symbol, sensor.select_axes(quantity.symbol).channels
            directions = sensor.input_axes(kind)
            if channels and not np.array_equal(directions, np.eye(3)):
                raise InputError(
                    f"method {self.name} needs three {quantity.sensors} along x, y and z, because "
                    f"{self.triads_because}; sensor {sensor.name} has {', '.join(channels)}: "
                    "choose a method with known attitudes, such as six_position, rates_and_poses "
                    "or turntable_discrete, which needs the angles of the table",
                    key=f"[sensor.{quantity.sensor}]",
                    names=channels,
                )

    def possible(self, sensor: Sensor) -> tuple[str, ...]:
        """Return the full names of all coefficients of the sensor that the method can estimate."""
        return self._selected_coefficients(sensor, self.also)

    def _selected_coefficients(
        self, part: Sensor, also: Mapping[Measures, tuple[str, ...]]
    ) -> tuple[str, ...]:
        """Return the coefficients estimated by default, and those in the groups `also`."""
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
            No estimator has this name; the message lists the available estimators.
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
    """Return the full names for `words`; a group gives all that the method can estimate."""
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
            "field_and_rates",
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
    """Return the method with this name, written with hyphens or underscores.

    Raises
    ------
    InputError
        No method has this name; the message lists the available methods.
    """
    return METHODS.find(name.replace("-", "_"))
