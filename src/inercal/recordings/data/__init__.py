"""Load recordings and tables as described in [data] of a run file, for all kinds of benches.

This package defines the [data] section with the keys that all kinds of benches share, the part of a
run that data readers need, and the result that they return. Values with units are text: "100 Hz".
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Generic, Literal, NamedTuple, Self, TypeVar, cast

from pydantic import Field, model_validator

from inercal.basics.errors import InputError, error_location
from inercal.basics.units import parse_quantity, si_factor
from inercal.physics.plan import Step
from inercal.physics.quantities import SensorKind
from inercal.physics.section_settings import BenchUsage, Section, optional
from inercal.physics.sensors import Sensor
from inercal.recordings import Finding, Mark, Observations, Recording
from inercal.recordings.environment import Environment
from inercal.recordings.temperature import (
    CELSIUS,
    TemperatureReadout,
    named_unit,
    temperature_readout,
)

if TYPE_CHECKING:
    from inercal.recordings.segments import RestDetection  # the kernels load with the readers


class ReadbackColumn(NamedTuple):
    """A column with a quantity that the bench measures, and the SI size of its unit."""

    name: str
    column: str
    size: float


class DataSection(Section):
    """[data]: the data file and its columns, by header name or by number counted from 1.

    These keys are common to all kinds of benches; each kind adds its own.
    """

    file: str = Field(examples=["session.csv"])
    kind: Literal["recording", "means"] = "recording"
    accelerometer: tuple[str | int, ...] = ("acc_x", "acc_y", "acc_z")
    gyro: tuple[str | int, ...] = ("gyr_x", "gyr_y", "gyr_z")
    magnetometer: tuple[str | int, ...] = ("mag_x", "mag_y", "mag_z")
    gyro_file: str | None = optional(
        "gyro.mat", about="the gyros' file, with the same rows, if it is not [data] file"
    )
    gyro_time: str | int | None = optional(
        "gyro_time", about="the gyros' own time column, if they were sampled at different times"
    )
    time: str | int | None = None
    time_unit: str = "s"
    rate: str | None = optional("100 Hz")
    counter_modulus: int | float | None = optional(
        about="for a time column that wraps around to 0: after how many of its units", ge=3
    )
    signed_bits: int | None = optional(
        16,
        about="bits of signed readings that were written as unsigned numbers, 0 … 65535",
        ge=8,
        le=32,
    )
    label: str | int | None = None
    temperature: str | int | None = None
    temperature_unit: str = "°C"
    temperature_scale: str | None = optional("340 LSB/K", about="for a thermometer in 'LSB' or 'V'")
    temperature_zero: str | None = optional(
        "36.53 °C", about="for a thermometer in 'LSB' or 'V': temperature at a reading of 0"
    )
    allow_temperature: bool = optional(
        default=False, about="accept temperatures outside −100 to 300 °C, but never below 0 K"
    )
    marks: str = optional(default="found", about="'found', 'labels', or a file of marks")
    nonfinite: Literal["refuse", "drop"] = "refuse"
    sd: dict[SensorKind, str] = Field(
        default_factory=dict[SensorKind, str],
        description="for tables of means: standard deviation of each mean",
        examples=[{"accelerometer": "30 µg", "gyro": "5 °/h"}],
    )
    seconds: str | int | None = optional(about="for tables of means: durations, s")

    @model_validator(mode="before")
    @classmethod
    def _unit_by_name(cls, given: Any) -> Any:
        """State the unit of temperature that the column's name states, such as "temp_F"."""
        if not isinstance(given, dict):
            return given
        keys = cast("dict[str, Any]", given)
        unit = named_unit(keys.get("temperature", ""))
        return keys if unit == CELSIUS.unit else {"temperature_unit": unit, **keys}

    @model_validator(mode="after")
    def _keys_fit_together(self) -> "DataSection":
        timed = self.time is not None and self.time_unit != "sample"
        if self.counter_modulus is not None and self.time is None:
            raise ValueError("counter_modulus needs a time column: name it in the key `time`")
        if self.gyro_time is not None and not (timed and self.kind == "recording"):
            raise ValueError(
                "gyro_time needs a column of times: name it in the key `time`, or remove gyro_time"
            )
        if self.kind == "means" and self.signed_bits is not None:
            raise ValueError("signed_bits is only for recordings: write means with their signs")
        if self.kind == "means" and self.gyro_file is not None:
            raise ValueError(
                "gyro_file is only for recordings: write the means of all axes in a single "
                "table and remove gyro_file"
            )
        columns = (*self.accelerometer, *self.gyro, *self.magnetometer)
        signed = [c for c in columns if str(c).startswith("-")]
        if self.kind == "means" and signed:
            raise ValueError(
                f'"{signed[0]}" reverses a column of a recording; in a table of means write the '
                "readings with their signs"
            )
        given = (self.temperature_scale, self.temperature_zero, self.allow_temperature or None)
        if self.temperature is None and any(value is not None for value in given):
            raise ValueError(
                "temperature_scale, temperature_zero and allow_temperature need a column of "
                "temperature: name it in the key `temperature`, or remove these keys"
            )
        return self

    @property
    def thermometer(self) -> TemperatureReadout:
        """How the temperature column is converted to kelvin.

        Raises
        ------
        InputError
            The unit is not a temperature unit, or raw counts have no scale or no zero.
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
        """The marked sections that are accepted as rests although they move."""
        return ()

    def readback(self, bench: Any) -> tuple[ReadbackColumn, ...]:
        """Return the columns of the rates, angles and levels that the bench measures.

        Raises
        ------
        InputError
            A unit does not belong to the quantity.
        """
        return ()

    def unused_keys(self, use: BenchUsage) -> dict[str, str]:
        """Return the keys that have no effect on the result in this use, each with the reason."""
        reason = 'for kind = "means"; the noise of a recording is estimated from its samples'
        return {} if use.means else {"sd": reason}

    def further_files(self) -> dict[str, str]:
        """Return the additional files, each with its content, such as "readback"."""
        return {}


class RestsSection(DataSection):
    """[data] for a bench that rests in marked sections."""

    accept_moving: tuple[str, ...] | None = optional(
        ["p11"], about="marked sections to accept as rests although the mean changes within them"
    )

    @model_validator(mode="after")
    def _means_do_not_move(self) -> "RestsSection":
        if self.kind == "means" and self.accept_moving is not None:
            raise ValueError("accept_moving is for recordings only; remove it")
        return self

    @property
    def moving_sections(self) -> tuple[str, ...]:
        """The marked sections that are accepted as rests although they move."""
        return self.accept_moving or ()


def unit_size(unit: str, like: str, key: str) -> float:
    """Return the SI size of a unit or of a multiple such as "0.5 rev/s"; errors name `key`.

    Raises
    ------
    InputError
        The unit belongs to another quantity, or its size is not positive.
    """
    key = f"[data] {key}"
    with error_location(key, key=key):
        size = parse_quantity(unit, like).value if unit[:1].isdigit() else si_factor(unit, like)
    if size <= 0:
        raise InputError(f"{key}: {unit!r} is not possible; give a positive unit", key=key)
    return size


D = TypeVar("D", bound=DataSection, covariant=True)


@dataclass(frozen=True, kw_only=True)
class MethodBase:
    """The part of a method that data readers use; `inercal.methods.Method` adds the rest.

    Parameters
    ----------
    name : str
        Name in the run file.
    unknown_attitudes : bool
        Whether the attitudes are free, so that rests are detected and labelled without a plan.
    follows_rest : bool
        Whether the estimator follows the whole recording sample by sample, as a single section.
    without_angles : bool
        Whether the method uses no turntable angles; rests and turns are then found from the gyros.
    sequential : callable or None
        Function that starts the live estimation of a run; None if the method has none.
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
        Path of the run file; other file names are relative to its folder.
    sensor : Sensor
        The accelerometers and gyros with readouts, noise and the coefficients to estimate; includes
        the axes that are not calibrated.
    bench : Bench
    data : DataSection
        The [data] section for this kind of bench.
    method : MethodBase
    plan : callable
        Function that returns the nominal plan.
    rate_hz : float or None
        Sampling rate, if stated, Hz.
    has_plan_keys : bool
        Whether [method] states a plan key.
    reader_options : mapping of str to object
        Keys of [data] that belong to a file-format reader (`inercal.recordings.io.readers`).
    environment : Environment or None
        Temperatures around the bench.
    held_files : mapping of str to Path
        Files with data that a caller passed in memory, by the names that [data] uses for them.
    magnetometer : Sensor or None
        The magnetometers, with the coefficients to estimate. They are kept apart, because the other
        axes are read and calibrated first, as if there were no magnetometers.
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
    magnetometer: Sensor | None = None

    @property
    def adds_coefficients(self) -> bool:
        """Whether score tests may add coefficients to those of the sensor."""
        return False

    @property
    def whole_sensor(self) -> Sensor:
        """The sensor with all of its axes and coefficients; the magnetometers come last."""
        return self.sensor if self.magnetometer is None else self.sensor.beside(self.magnetometer)

    @property
    def with_all_axes(self) -> Self:
        """The run with its magnetometers among the axes of its sensor."""
        return replace(self, sensor=self.whole_sensor, magnetometer=None)

    @cached_property
    def steps(self) -> tuple[Step, ...]:
        """The nominal plan, designed on first access because a hand-held plan takes seconds.

        Raises
        ------
        InputError
            No plan is possible with the options of [method].
        """
        with error_location(f"{self.path}: [method]", file=self.path, key="[method]"):
            return self.plan()

    def file(self, name: str) -> Path:
        """Return the path of a file named in the run file.

        Raises
        ------
        InputError
            The text cannot be a file name.
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
    """The input that an estimator needs, prepared from the data of a run.

    Parameters
    ----------
    recording : Recording or None
        None if the data are a table of means.
    marks : tuple of Mark
    observations : Observations
    plan : tuple of Step
        The planned steps; steps without a row were not carried out.
    steps : tuple of Step
        The plan step of each row.
    findings : tuple of Finding
    conditions : dict of str to str
        Conditions at the bench, in words with units.
    rests : RestDetection or None
        Result of the rest detection, if it used no plan.
    bench : Bench or None
        The bench, if the data determine more of its parameters than the run file states.
    notes : tuple of str
        Further results from the data, in plain words.
    characteristics : tuple of Characteristic
        Characteristics of each axis by the definitions of the standards, for the report and the
        output of `--json`.
    pauses : tuple of int
        Numbers of the recording's gaps during which the bench did not record on purpose.
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
    characteristics: tuple[Any, ...] = ()
    pauses: tuple[int, ...] = ()

    def rows(self, at: Sequence[int]) -> "EstimatorInput":
        """Return the input with only some of its rows; the fit does not use the others."""
        steps, marks = (tuple(some[k] for k in at if some) for some in (self.steps, self.marks))
        rows = self.observations.rows(at)
        return replace(self, observations=rows, marks=marks, plan=steps, steps=steps)

    def sensor_of_samples(self, sensor: Sensor) -> Sensor:
        """Return the sensor with the noise that an estimator uses to weight the observations.

        Estimators that follow individual samples weight them by the stated noise, which does not
        include their rounding. The covariance of means already includes it.
        """
        if self.observations.track is None:
            return sensor
        assert self.recording is not None
        return sensor.rounded(self.recording.rate_hz)
