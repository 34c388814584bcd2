"""A kind of bench: its interface to the rest of the package.

One object of this type, registered under `inercal.benches`, is a kind of bench. Its functions
return data, which report and terminal draw and print.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Generic, TypeVar

import numpy as np

from inercal.basics.units import Measured, format_count
from inercal.benches.contract import Bench, SensorSimulation, SimulatedMotion
from inercal.benches.motion_control import MotionControl
from inercal.benches.operator_sheet import Sheet
from inercal.benches.report_data import (
    Columns,
    MeasuredDirection,
    Plot,
    ReportInput,
    describe_row,
    specific_force_directions,
)
from inercal.physics.plan import Step
from inercal.physics.section_settings import BenchSection, key_error
from inercal.physics.sensors import Noise, Readout, Sensor, imu, triad
from inercal.recordings import Recording
from inercal.recordings.data import DataSection, EstimatorInput, RunBase

if TYPE_CHECKING:
    from inercal.recordings.segments import RestDetection  # the kernels load with the readers

B = TypeVar("B", bound=Bench)
D = TypeVar("D", bound=DataSection)
Output = tuple[Readout, Noise]
PlanFunction = Callable[[], tuple[Step, ...]]
Simulate = Callable[
    [B, Sequence[Any], float, np.random.Generator, int, Sensor, bool], SensorSimulation
]


@dataclass(frozen=True)
class Effect:
    """A known effect that a bench corrects for.

    Parameters
    ----------
    name : str
    field : str
        Of the bench, that holds its value.
    absent : Measured or float
        The field's value without the effect.
    unit, per : str and float
        The value as printed: unit, and how many of it one SI unit is.
    affects_rates : bool
        Whether it acts only on gyros.
    """

    name: str
    field: str
    absent: Measured | float
    unit: str
    per: float
    affects_rates: bool = False


@dataclass(frozen=True)
class Vocabulary:
    """Words of reports and messages for a kind of bench.

    Parameters
    ----------
    row : str
        One row of the observations, "state or mounting".
    turning_device : str
        The device that turns the sensor, "table".
    rows : str
        The rows at rates, "states".
    attitudes : str
        Heading of the table of rows.
    components : str
        Definition of the components of the bench's errors, for the report; may be empty.
    unjudged : str
        Meaning of the residuals where the rows leave no degrees of freedom.
    """

    row: str = "position or turn"
    turning_device: str = "arm"
    rows: str = "rows"
    attitudes: str = "Attitudes covered"
    components: str = "Components 1 and 2 are at right angles to the nominal direction."
    unjudged: str = ""


def accept_any_budget(bench: Any, steps: Sequence[Any]) -> str:
    """Refuse no budget."""
    return ""


def total_step_duration(bench: Any, steps: Sequence[Step]) -> float:
    """Return the sum of the durations of the steps, s."""
    return sum(step.seconds for step in steps)


def simulate_without_sensor(
    perform: Callable[..., SimulatedMotion], *, in_hand: bool = False
) -> Simulate[Any]:
    """Return `Kind.simulate` of a bench whose simulation needs no sensor.

    Parameters
    ----------
    perform : callable
        From bench, steps, samples per second, generator and number of trials to the motion.
    in_hand : bool
        Whether `perform` also takes the keyword `carried`: the sensor may stay in a hand.
    """
    return _SimulationWithoutSensor(perform, in_hand)


@dataclass(frozen=True)
class _SimulationWithoutSensor:
    """Not a function within the other: this one can be sent to another process."""

    perform: Callable[..., SimulatedMotion]
    in_hand: bool

    def __call__(
        self,
        bench: Any,
        steps: Sequence[Any],
        rate_hz: float,
        rng: np.random.Generator,
        trials: int,
        sensor: Sensor,
        carried: bool,
    ) -> SensorSimulation:
        more = {"carried": carried} if self.in_hand else {}
        return SensorSimulation(self.perform(bench, steps, rate_hz, rng, trials, **more), sensor)


def three_axis_sensor(
    name: str, columns: tuple[str | int, ...], accelerometer: Output, gyro: Output | None
) -> Sensor:
    """Return a triad, or an IMU where gyros are stated; without coefficients.

    Parameters
    ----------
    name : str
    columns : tuple of str or int
        [data] accelerometer.
    accelerometer, gyro : tuple of Readout and Noise
        Of each axis.

    Raises
    ------
    InputError
        Another number of columns than three.
    """
    if len(columns) != len("xyz"):
        raise key_error(
            "[data] accelerometer",
            f"{format_count(len(columns), 'column')}; name three, of x, y, z",
        )
    return triad(name, "f", "a", *accelerometer) if gyro is None else imu(name, accelerometer, gyro)


def keep_plan(
    options: Mapping[str, Any], bench: Any, folder: Path, plan: PlanFunction
) -> PlanFunction:
    """Return the method's plan unchanged."""
    return plan


def keep_recording(recording: Recording, sensor: Sensor, bench: Any) -> Recording:
    """Return the recording unchanged."""
    return recording


def no_files(run: RunBase[Any], done: SimulatedMotion, rng: np.random.Generator) -> dict[str, Any]:
    """Return no further files."""
    return {}


def no_plots(shown: ReportInput) -> tuple[Plot, ...]:
    """Return no plots."""
    return ()


def no_tables(run: RunBase[Any], shown: ReportInput) -> dict[str, Columns]:
    """Return no tables."""
    return {}


@dataclass(frozen=True)
class Kind(Generic[B, D]):
    """A kind of bench.

    Parameters
    ----------
    name : str
        [bench] kind.
    bench : type
        A dataclass, `Bench`.
    section : type
        [bench] of a run file, a `BenchSection` with the key `kind`.
    data : type
        [data] of a run file, a `DataSection`.
    build : callable
        From the section, and the folder of the files that it names, to the bench.
    steps : tuple of type
        The types of steps that it carries out.
    observe : callable
        From a run to the input of an estimator: it reads a recording or a table of means.
    simulate : callable
        From bench, steps, samples per second, generator, number of trials, sensor, and whether the
        sensor stays in the hand between steps.
    seconds : callable
        From bench and steps to their longest duration, s; by default the sum of the steps.
    words : Vocabulary
    effects : tuple of Effect
        Effects that a budget lists.
    refuses_budget : callable
        Returns the reason why a budget of a plan is not possible; "" where it is possible.
    rows_of_table : bool
        Whether the table of means defines the states, not the method's plan: a budget then needs a
        plan.
    sampled : bool
        Whether methods use every sample, not means of steps.
    spins : bool
        Whether the bench carries the sensor round, so that it senses more than gravity.
    sensor : callable
        The sensor on the bench, from its name, [data] accelerometer, readout and noise.
    plan : callable
        From the keys of [method] that concern the plan, the bench, the run file's folder and the
        method's plan, to the plan of a run.
    audit : callable
        Adds findings to a recording before it is used.
    files : callable
        Further recordings that a simulation writes, by the names in [data].
    sheet : callable or None
        The worksheet of the operator; None where plans are fixed.
    rests : callable or None
        The rests in a refused recording; None for a bench without rests.
    directions : callable
        The measured direction of each row; may be empty.
    plots : callable
        Further figures of the report.
    row : callable
        A row in words.
    tables : callable
        Tables written with the calibration, by their content: "states".
    motion_control : MotionControl or None
        What a host asks; None of a bench that no host drives.
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
    spins: bool = False
    sensor: Callable[[str, tuple[str | int, ...], Output, Output | None], Sensor] = (
        three_axis_sensor
    )
    plan: Callable[[Mapping[str, Any], B, Path, PlanFunction], PlanFunction] = keep_plan
    audit: Callable[[Recording, Sensor, B], Recording] = keep_recording
    files: Callable[[RunBase[D], SimulatedMotion, np.random.Generator], dict[str, Recording]] = (
        no_files
    )
    sheet: Callable[[RunBase[D]], Sheet] | None = None
    rests: "Callable[[RunBase[D], Recording], RestDetection] | None" = None
    directions: Callable[[ReportInput], tuple[MeasuredDirection, ...]] = specific_force_directions
    plots: Callable[[ReportInput], tuple[Plot, ...]] = no_plots
    row: Callable[[Step, ReportInput, int], str] = describe_row
    tables: Callable[[RunBase[D], ReportInput], Mapping[str, Columns]] = no_tables
    motion_control: MotionControl | None = None
