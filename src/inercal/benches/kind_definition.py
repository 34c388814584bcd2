"""A kind of bench: its interface to the rest of the package, and the kinds by name.

Each kind of bench is one `Kind` object, registered under `inercal.benches`. Its functions return
data; the report draws them and the terminal prints them.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Generic, TypeVar

import numpy as np

from inercal.basics.errors import InputError
from inercal.basics.registry import Registry
from inercal.basics.units import Measured
from inercal.benches.contract import Bench, SensorSimulation, SimulatedMotion
from inercal.benches.report_data import (
    Columns,
    MeasuredDirection,
    Plot,
    ReportInput,
    describe_row,
    specific_force_directions,
)
from inercal.benches.stated_axes import three_axes
from inercal.physics.plan import Step
from inercal.physics.section_settings import BenchSection
from inercal.physics.sensors import Sensor
from inercal.recordings import Recording
from inercal.recordings.data import DataSection, EstimatorInput, RunBase

if TYPE_CHECKING:
    from inercal.benches.motion_control import MotionControl
    from inercal.benches.operator_sheet import Sheet
    from inercal.recordings.segments import RestDetection  # the kernels load with the readers


B = TypeVar("B", bound=Bench)
D = TypeVar("D", bound=DataSection)
PlanFunction = Callable[[], tuple[Step, ...]]
Simulate = Callable[
    [B, Sequence[Any], float, "np.random.Generator", int, Sensor, bool], SensorSimulation
]


@dataclass(frozen=True)
class Effect:
    """A known effect that a bench corrects for.

    Parameters
    ----------
    name : str
    field : str
        Name of the bench's field with the size of the effect.
    absent : Measured or float
        Value of that field when the effect is absent.
    unit, per : str and float
        Unit in which the value is printed, and the number of these units in one SI unit.
    affects_rates : bool
        Whether the effect acts only on gyros.
    """

    name: str
    field: str
    absent: Measured | float
    unit: str
    per: float
    affects_rates: bool = False


@dataclass(frozen=True)
class Vocabulary:
    """Words that reports and messages use for a kind of bench.

    Parameters
    ----------
    row : str
        Word for one row of the observations, such as "state or mounting".
    turning_device : str
        Word for the device that turns the sensor, such as "table".
    rows : str
        Word for the rows in which the bench turns, such as "states".
    attitudes : str
        Heading of the table of rows.
    components : str
        Definition of the components of the bench's errors, for the report; may be empty.
    unjudged : str
        Meaning of the residuals if there are no degrees of freedom.
    """

    row: str = "position or turn"
    turning_device: str = "arm"
    rows: str = "rows"
    attitudes: str = "Attitudes covered"
    components: str = "Components 1 and 2 are at right angles to the nominal direction."
    unjudged: str = ""


def accept_any_budget(bench: Any, steps: Sequence[Any]) -> str:
    """Accept every budget: return no reason to refuse it."""
    return ""


def total_step_duration(bench: Any, steps: Sequence[Step]) -> float:
    """Return the total duration of the steps, s."""
    return sum(step.seconds for step in steps)


def simulate_without_sensor(perform: Callable[..., SimulatedMotion]) -> Simulate[Any]:
    """Return a `Kind.simulate` function for a bench whose simulation does not need the sensor.

    Parameters
    ----------
    perform : callable
        Returns the motion, given bench, steps, samples per second, generator and number of trials.
    """
    return partial(_simulate, perform)  # a nested function cannot be sent to a process


def _simulate(
    perform: Callable[..., SimulatedMotion],
    bench: Any,
    steps: Sequence[Any],
    rate_hz: float,
    rng: "np.random.Generator",
    trials: int,
    sensor: Sensor,
    carried: bool,
) -> SensorSimulation:
    return SensorSimulation(perform(bench, steps, rate_hz, rng, trials), sensor)


def keep_plan(
    options: Mapping[str, Any], bench: Any, folder: Path, plan: PlanFunction
) -> PlanFunction:
    """Return the method's plan unchanged."""
    return plan


def keep_recording(recording: Recording, sensor: Sensor, bench: Any) -> Recording:
    """Return the recording unchanged."""
    return recording


def no_files(
    run: RunBase[Any], done: SimulatedMotion, rng: "np.random.Generator"
) -> dict[str, Any]:
    """Return an empty mapping, because the bench writes no further recordings."""
    return {}


def no_plots(shown: ReportInput) -> tuple[Plot, ...]:
    """Return no plots."""
    return ()


def all_steps(steps: Sequence[Any]) -> Sequence[Any]:
    """Return all steps."""
    return steps


def no_tables(run: RunBase[Any], shown: ReportInput) -> dict[str, Columns]:
    """Return no tables."""
    return {}


@dataclass(frozen=True)
class Kind(Generic[B, D]):
    """A kind of bench.

    Parameters
    ----------
    name : str
        Value of [bench] kind in a run file.
    bench : type
        Class of the bench, a dataclass that implements `Bench`.
    section : type
        Type of the section [bench] in a run file, a `BenchSection` with the key `kind`.
    data : type
        Type of the section [data] in a run file, a `DataSection`.
    build : callable
        Builds the bench from the section and the folder of the files that the section names.
    steps : tuple of type
        Types of steps that the bench carries out.
    observe : callable
        Reads the recording or table of means of a run and returns the input of an estimator.
    simulate : callable
        Simulates the motion. Its arguments are bench, steps, samples per second, generator, number
        of trials, sensor, and whether the sensor stays in the hand between steps.
    seconds : callable
        Returns the longest duration of steps on a bench, s; by default the sum of their durations.
    words : Vocabulary
    effects : tuple of Effect
        Effects that a budget lists.
    refuses_budget : callable
        Returns the reason why a budget for a plan is not possible, or "" if it is possible.
    rows_of_table : bool
        Whether the states are defined by the table of means instead of the method's plan. A budget
        then needs a plan.
    sampled : bool
        Whether methods use every sample instead of the means of steps.
    drift_from_slopes : bool
        Whether the drift of accelerometers is estimated from the slopes within the sections of a
        recording, if no slow noise is stated.
    spins : bool
        Whether the bench rotates the sensor on an arm, so that it senses more than gravity.
    sensor : callable
        Builds the sensor on the bench from its name and the `StatedAxes` of each kind that the
        run file states: accelerometers, gyros, magnetometers.
    plan : callable
        Returns the plan of a run, given the keys of [method] that concern the plan, the bench, the
        run file's folder and the method's plan.
    audit : callable
        Adds findings to a recording before it is used.
    files : callable
        Returns further recordings that a simulation writes, by their names in [data].
    sheet : callable or None
        Returns the operator's worksheet; None if the plans are fixed.
    rests : callable or None
        Returns the rests in a refused recording; None for a bench without rests.
    directions : callable
        Returns the measured direction of each row; may be empty.
    plots : callable
        Returns further figures for the report.
    row : callable
        Describes a row in words.
    tables : callable
        Returns tables that are written with the calibration, by their content, such as "states".
    fitted : callable
        Returns the steps of a plan whose readings enter the fit.
    motion_control : MotionControl or None
        Interface for a host that drives the bench; None if no host can drive it.
    """

    name: str
    bench: type[B]
    section: type[BenchSection]
    data: type[D]
    build: Callable[[Any, Path], B]
    steps: tuple[type, ...]
    observe: Callable[[RunBase[D]], EstimatorInput]
    simulate: Simulate[B]
    seconds: Callable[[B, Sequence[Any]], float] = total_step_duration
    words: Vocabulary = Vocabulary()
    effects: tuple[Effect, ...] = ()
    refuses_budget: Callable[[B, Sequence[Any]], str] = accept_any_budget
    rows_of_table: bool = False
    sampled: bool = False
    drift_from_slopes: bool = False
    spins: bool = False
    sensor: Callable[..., Sensor] = three_axes
    plan: Callable[[Mapping[str, Any], B, Path, PlanFunction], PlanFunction] = keep_plan
    audit: Callable[[Recording, Sensor, B], Recording] = keep_recording
    files: Callable[[RunBase[D], SimulatedMotion, "np.random.Generator"], dict[str, Recording]] = (
        no_files
    )
    sheet: "Callable[[RunBase[D]], Sheet] | None" = None
    rests: "Callable[[RunBase[D], Recording], RestDetection] | None" = None
    directions: Callable[[ReportInput], tuple[MeasuredDirection, ...]] = specific_force_directions
    plots: Callable[[ReportInput], tuple[Plot, ...]] = no_plots
    row: Callable[[Step, ReportInput, int], str] = describe_row
    tables: Callable[[RunBase[D], ReportInput], Mapping[str, Columns]] = no_tables
    fitted: Callable[[Sequence[Any]], Sequence[Any]] = all_steps
    motion_control: "MotionControl | None" = None


_OWN = ("hand", "centrifuge", "dividing_head", "rate_table", "rate_platform", "turntable")
KINDS: Registry[Kind[Any, Any]] = Registry(
    "inercal.benches", "kind of bench", {name: f"inercal.benches.{name}.kind:KIND" for name in _OWN}
)


def kind_for_class(bench: type[Any]) -> Kind[Any, Any]:
    """Return the kind whose benches are of this class.

    Raises
    ------
    InputError
        The class belongs to no kind of bench.
    """
    for kind in KINDS.values():
        if issubclass(bench, kind.bench):
            return kind
    raise InputError(
        f"class {bench.__name__} belongs to no kind of bench; the kinds are {', '.join(KINDS)}"
    )


def kind_name_for_class(bench: type[Any]) -> str:
    """Return the name of the kind that has this class, or the class's own name if none has it."""
    return next((name for name, kind in KINDS.items() if kind.bench is bench), bench.__name__)


def kind_for_bench(bench: Bench) -> Kind[Any, Any]:
    """Return the kind of a bench.

    Raises
    ------
    InputError
        The class of the bench belongs to no kind.
    """
    return kind_for_class(type(bench))
