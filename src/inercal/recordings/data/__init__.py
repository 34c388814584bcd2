"""From [data] of a run file to recordings and tables, for all kinds of benches.

The section with the keys of every kind of bench, the view of a run that readers of data use, and
their result. Values with units are text: "100 Hz".
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Generic, Literal, NamedTuple, TypeVar

from pydantic import Field, model_validator

from inercal.basics.errors import InputError
from inercal.basics.units import parse_quantity, si_factor
from inercal.physics.plan import Step
from inercal.physics.section_settings import BenchUsage, Section
from inercal.physics.sensors import Sensor
from inercal.recordings import Finding, Mark, Observations, Recording
from inercal.recordings.environment import Environment
from inercal.recordings.temperature import TemperatureReadout, temperature_readout

if TYPE_CHECKING:
    from inercal.recordings.segments import RestDetection  # the kernels load with the readers


class ReadbackColumn(NamedTuple):
    """A column of a quantity that the bench measures: name, column, and SI size of its unit."""

    name: str
    column: str
    size: float


class DataSection(Section):
    """[data]: the file and its columns, by header name or by number counted from 1.

    Keys that every kind of bench has; a kind adds its own.
    """

    file: str = Field(examples=["session.csv"])
    kind: Literal["recording", "means"] = "recording"
    accelerometer: tuple[str | int, ...] = ("acc_x", "acc_y", "acc_z")
    gyro: tuple[str | int, str | int, str | int] = ("gyr_x", "gyr_y", "gyr_z")
    gyro_file: str | None = Field(
        None,
        description="the gyros' file, with the same rows, where it differs from [data] file",
        examples=["gyro.mat"],
    )
    gyro_time: str | int | None = Field(
        None,
        description="the gyros' column of times, where they were sampled at times of their own",
        examples=["gyro_time"],
    )
    time: str | int | None = None
    time_unit: str = "s"
    rate: str | None = Field(None, examples=["100 Hz"])
    counter_modulus: int | None = Field(
        None, ge=3, description="of a time column in 'sample': after so many it begins at 0 again"
    )
    label: str | int | None = None
    temperature: str | int | None = None
    temperature_unit: str = "°C"
    temperature_scale: str | None = Field(
        None, description="of a thermometer in 'LSB' or 'V'", examples=["340 LSB/K"]
    )
    temperature_zero: str | None = Field(
        None,
        description="of a thermometer in 'LSB' or 'V': temperature at a reading of 0",
        examples=["36.53 °C"],
    )
    allow_temperature: bool = Field(
        False, description="accept temperatures outside −100 to 300 °C; none is below 0 K"
    )
    marks: str = Field("found", description="'found', 'labels', or a file of marks")
    nonfinite: Literal["refuse", "drop"] = "refuse"
    sd: dict[Literal["accelerometer", "gyro"], str] = Field(
        default_factory=dict[Literal["accelerometer", "gyro"], str],
        description="of means: the standard deviation of each",
        examples=[{"accelerometer": "30 µg", "gyro": "5 °/h"}],
    )
    seconds: str | int | None = Field(None, description="of means: column of durations, s")

    @model_validator(mode="after")
    def _keys_fit_together(self) -> "DataSection":
        timed = self.time is not None and self.time_unit != "sample"
        if self.counter_modulus is not None and (timed or self.time is None):
            raise ValueError(
                "counter_modulus needs a counter: state its column as time, and "
                'time_unit = "sample"'
            )
        if self.gyro_time is not None and not (timed and self.kind == "recording"):
            raise ValueError(
                "gyro_time works only with a column of times: state time, or remove gyro_time"
            )
        if self.kind == "means" and self.gyro_file is not None:
            raise ValueError(
                "gyro_file is only for recordings: write the means of all axes in a single "
                "table and remove gyro_file"
            )
        signed = [c for c in (*self.accelerometer, *self.gyro) if str(c).startswith("-")]
        if self.kind == "means" and signed:
            raise ValueError(
                f'"{signed[0]}" reverses a column of a recording; in a table of means write the '
                "readings with their signs"
            )
        given = (self.temperature_scale, self.temperature_zero, self.allow_temperature or None)
        if self.temperature is None and any(value is not None for value in given):
            raise ValueError(
                "temperature_scale, temperature_zero and allow_temperature need a column of "
                "temperature: name it in temperature, or remove them"
            )
        return self

    @property
    def thermometer(self) -> TemperatureReadout:
        """How the column of temperature states temperatures.

        Raises
        ------
        InputError
            A unit that is no temperature, or counts without scale and zero.
        """
        return temperature_readout(
            self.temperature_unit,
            self.temperature_scale,
            self.temperature_zero,
            allowed=self.allow_temperature,
        )

    @property
    def row(self) -> str | int | None:
        """The column that names the rows, or the sections of a recording."""
        return self.label

    @property
    def moving_sections(self) -> tuple[str, ...]:
        """The marked sections that count as rests though they move."""
        return ()

    def readback(self, bench: Any) -> tuple[ReadbackColumn, ...]:
        """Return the columns of rates, angles and levels that the bench measures.

        Raises
        ------
        InputError
            A unit of another quantity.
        """
        return ()

    def unused_keys(self, use: BenchUsage) -> dict[str, str]:
        """Return the keys that change no result in this use, each with the reason."""
        return {}

    def further_files(self) -> dict[str, str]:
        """Return further files by their content, such as "readback"."""
        return {}


class RestsSection(DataSection):
    """[data] of a bench that rests in marked sections."""

    accept_moving: tuple[str, ...] | None = Field(
        None,
        description="marked sections that count as rests though their mean changes within them",
        examples=[["p11"]],
    )

    @model_validator(mode="after")
    def _means_do_not_move(self) -> "RestsSection":
        if self.kind == "means" and self.accept_moving is not None:
            raise ValueError("accept_moving is for recordings only; remove it")
        return self

    @property
    def moving_sections(self) -> tuple[str, ...]:
        """The marked sections that count as rests though they move."""
        return self.accept_moving or ()


def unit_size(unit: str, like: str, key: str) -> float:
    """Return the SI size of a unit, or of a size such as "0.5 rev/s"; an error names `key`.

    Raises
    ------
    InputError
        A unit of another quantity, or a size that is not positive.
    """
    key = f"[data] {key}"
    try:
        size = parse_quantity(unit, like).value if unit[:1].isdigit() else si_factor(unit, like)
    except InputError as error:
        raise error.located(key, key=key) from None
    if size <= 0:
        raise InputError(f"{key}: {unit!r} is not possible; give a positive unit", key=key)
    return size


D = TypeVar("D", bound=DataSection, covariant=True)


@dataclass(frozen=True, kw_only=True)
class MethodBase:
    """The part of a method that readers of data use; `inercal.methods.Method` adds the rest.

    Parameters
    ----------
    name : str
        In the run file.
    unknown_attitudes : bool
        Whether attitudes are free: rests are detected and labelled without a plan.
    follows_rest : bool
        Whether the whole recording is one rest, whose samples the estimator follows.
    without_angles : bool
        Whether it uses no angle of a turntable: the gyros show rests and turns.
    sequential : callable or None
        Starts the live estimation of a run; None where the method has none.
    """

    name: str
    unknown_attitudes: bool = False
    follows_rest: bool = False
    without_angles: bool = False
    sequential: Callable[..., object] | None = None


@dataclass(frozen=True, eq=False, kw_only=True)
class RunBase(Generic[D]):
    """The part of a run that its data need; `inercal.runfile.Run` adds the rest.

    Parameters
    ----------
    path : Path
        The run file; other files are named relative to its folder.
    sensor : Sensor
        With readouts, noise and the coefficients to be estimated; all axes, also those that are
        not calibrated.
    bench : Bench
    data : DataSection
        Of the kind of bench.
    method : MethodBase
    plan : callable
        Returns the nominal plan.
    rate_hz : float or None
        Samples per second, where stated.
    has_plan_keys : bool
        Whether [method] states a key of the plan.
    reader_options : mapping of str to object
        Keys of [data] that belong to the reader of a format (`inercal.recordings.io.readers`).
    environment : Environment or None
        The temperatures around the bench.
    held_files : mapping of str to Path
        Files that hold what a call gave in memory, by the names that [data] has for them.
    """

    path: Path
    sensor: Sensor
    bench: Any
    data: D
    method: MethodBase
    plan: Callable[[], tuple[Step, ...]]
    rate_hz: float | None
    has_plan_keys: bool = False
    reader_options: Mapping[str, object] = field(default_factory=dict[str, object])
    environment: Environment | None = None
    held_files: Mapping[str, Path] = field(default_factory=dict[str, Path])

    @property
    def steps(self) -> tuple[Step, ...]:
        """The nominal plan, designed when it is first read: a plan by hand takes seconds.

        Raises
        ------
        InputError
            The options of [method] allow no plan.
        """
        return self._steps

    @cached_property
    def _steps(self) -> tuple[Step, ...]:
        try:
            return self.plan()
        except InputError as error:
            raise error.located(f"{self.path}: [method]", file=self.path, key="[method]") from None

    def file(self, name: str) -> Path:
        """Return the path of a file named in the run file.

        Raises
        ------
        InputError
            The text can be no name.
        """
        if "\0" in name:
            raise InputError(
                f"{self.path}: {name!r} contains a zero character, which a file name cannot "
                "have; correct the name",
                file=self.path,
            )
        return self.held_files.get(name, self.path.parent / name)


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
