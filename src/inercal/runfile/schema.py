"""Define the schema of a run file, with the keys of each section.

Values with units are text, such as "60 µg/√Hz". If the default of a key is not a typical value, the
key has an example, which error messages show.
"""

from collections.abc import Mapping
from functools import cache, partial
from typing import Any, Literal, cast

from pydantic import Field, create_model, field_validator

from inercal.basics.errors import InputError
from inercal.benches.kind_definition import KINDS
from inercal.physics.section_settings import (
    DESCRIPTION,
    PLANNING,
    BenchSection,
    BenchUsage,
    Section,
    optional,
)
from inercal.recordings.data import DataSection
from inercal.recordings.io.readers import known_options, readers_with_option
from inercal.runfile.job import JobSection


class ReadoutSection(Section):
    """Keys of [sensor.accelerometer], [sensor.gyro] and [sensor.magnetometer]: output and noise."""

    unit: str = Field(description="output unit, such as 'LSB' or 'V'", examples=["m/s²"])
    unit_assumed: bool = optional(
        default=False,
        about="whether the unit is a guess that neither the user nor the data confirm",
    )
    scale: str | None = optional("2048 LSB/g", about="nominal scale factor")
    axis: str | tuple[str | tuple[float, float, float], ...] | None = optional(
        "z",
        ["x", "-z"],
        [[0.6, 0, 0.8]],
        about="direction of each axis in the case, if there are not three along x, y, z",
    )

    @field_validator("axis", mode="before")
    @classmethod
    def _one_direction_of_three_numbers(cls, axis: object) -> object:
        given: list[object] = cast("list[object]", axis) if isinstance(axis, list) else [axis]
        if not all(isinstance(one, int | float) for one in given):
            return cast("object", axis)
        if len(given) != len("xyz"):
            raise ValueError("a direction has three numbers, such as [0.6, 0, 0.8]")
        return [given]

    offset: float = optional(default=0.0, about="output at zero, in output units")
    full_scale: str | None = optional("16 g", "2000 °/s", about="largest reading")
    white: str | None = optional("60 µg/√Hz", "0.1 °/√h", about="velocity or angle random walk")
    bias_instability: str | None = optional("20 µg", "5 °/h")
    random_walk: str | None = optional("1 µg/√s", "1 °/h/√s")
    quantisation: str | None = optional("0.5 mg", "0.02 °/s", about="resolution of the reading")

    @property
    def directions(self) -> tuple[str | tuple[float, float, float], ...]:
        """The stated directions of the axes; empty if there are none."""
        return (self.axis,) if isinstance(self.axis, str) else self.axis or ()

    def unused_keys(self, use: BenchUsage) -> dict[str, str]:
        """Return the keys that have no effect with this method, with the reason and the remedy."""
        if use.rest and use.magnetometers:
            reason = f"{use.method} assumes that biases are constant during the recording"
            return dict.fromkeys(("bias_instability", "random_walk"), reason)
        if not use.means:
            return {}
        reason = "averaged readings contain no samples; state noise and instability in [data.sd]"
        return dict.fromkeys(("white", "bias_instability", "random_walk", "quantisation"), reason)


class MagnetometerSection(ReadoutSection):
    """Keys of [sensor.magnetometer]."""

    def unused_keys(self, use: BenchUsage) -> dict[str, str]:
        """See `ReadoutSection.unused_keys`; slow changes of the field are found from the data."""
        reason = f"{use.method} finds slow changes of the field and of its sensors from the data"
        slow = dict.fromkeys(("bias_instability", "random_walk"), reason)
        return {**super().unused_keys(use), **slow}


class SensorSection(Section):
    """Keys of [sensor]."""

    name: str = optional(default="sensor", json_schema_extra=DESCRIPTION)
    form: Literal["reference", "tilted"] | None = optional(
        about="'reference', but 'tilted' on a dividing head"
    )
    frame: Literal["mount", "symmetric"] = "mount"
    accelerometer: ReadoutSection | None = None
    gyro: ReadoutSection | None = None
    magnetometer: MagnetometerSection | None = None
    truth: dict[str, str | float] = Field(
        default_factory=dict, examples=[{"ax.k0": "32 mg"}], json_schema_extra=DESCRIPTION
    )


class SearchSection(Section):
    """Keys of [method.search]: options for the estimator `global` of `ship_multi_angle`."""

    seed: int = optional(default=0, ge=0)
    time_limit: str = "20 s"
    goal: str = optional(default="5 %", about="largest relative error of a norm")
    scale_error: str = optional(
        default="10 %", about="largest deviation of each scale factor from nominal"
    )
    cross_axis: str = "10 %"
    bias: str = "0.2 g"


def _filter_sd(example: str, of: str) -> None:
    """Declare the key for the initial standard deviation of some filter states."""
    return optional(example, about=f"standard deviation of {of}")


class FilterInitialSection(Section):
    """Keys of [method.filter.initial]: initial standard deviations of the filter states."""

    gyro_bias: str | None = _filter_sd("1000 °/h", "the gyros' biases")
    gyro_scale: str | None = _filter_sd("5000 ppm", "the gyros' scale factors")
    gyro_misalignment: str | None = _filter_sd("20 ′", "the gyros' misalignments")
    accelerometer_bias: str | None = _filter_sd("5 mg", "the accelerometers' biases")
    accelerometer_scale: str | None = _filter_sd("5000 ppm", "the accelerometers' scale factors")
    accelerometer_misalignment: str | None = _filter_sd("20 ′", "the accelerometers' misalignments")
    attitude: str | None = _filter_sd("30 ″", "the attitude in both filters")


class FilterSection(Section):
    """Keys of [method.filter]: filter parameters of turntable_kalman that replace the defaults."""

    readback_sd: str | None = optional("4 ″", about="measurement noise R of the attitude")
    velocity_sd: str | None = optional(
        "0.1 mm/s", about="measurement noise R of the velocity at rest"
    )
    epoch: str | None = optional("0.2 s", about="time between covariance updates")
    bias_drift: bool | None = optional(False, about="whether biases drift")
    table_states: Literal["whole", "lean", "exact"] | None = optional(
        "lean", about="table errors that are filter states"
    )
    initial: FilterInitialSection | None = None


class MethodSection(Section):
    """Keys of [method]."""

    name: str = Field(examples=["six_position"])
    estimator: str = optional("ml", default="")
    coefficients: tuple[str, ...] = optional(
        ["bias", "scale"],
        default=(),
        about="coefficients to estimate instead of the method's default",
    )
    also: Literal["auto"] | tuple[str, ...] = optional(
        ["g", "k2"],
        "auto",
        default=(),
        about="additional coefficients; 'auto': those that score tests ask for",
    )
    temperature_order: Literal["auto"] | tuple[int, int, int] | None = optional(
        "auto",
        [3, 2, 1],
        about="orders of bias, scale factor and misalignment in temperature, or 'auto'",
    )
    seconds: str | None = optional("20 s", about="length of each hold in a simulation")
    path: str | None = optional(
        "fast", about="plan for a turntable: 'paper', 'fast', 'discrete', or a file with its steps"
    )
    turn: str | tuple[str, ...] | None = optional(
        "-360 °", about="angle of the turns, positive counter-clockwise, or angles about x, y and z"
    )
    turn_seconds: str | None = optional("6 s")
    positions: int | None = optional(
        about="rests or positions of a plan by hand, or positions on a dividing head"
    )
    reverse: bool | None = optional(about="whether a dividing head also runs the plan in reverse")
    time_offset: bool = optional(
        default=False, about="whether the time delay of the gyros is also estimated"
    )
    attitudes: str | None = optional("half-circle", about="plan of attitudes on a centrifuge")
    rates: tuple[str, ...] | None = optional(["60 rpm", "120 rpm"], about="arm rates in the plan")
    small_rates: tuple[str, ...] | None = optional(
        ["0.01 °/s", "0.02 °/s"],
        about="rates about zero and about the slowest rate, for threshold and resolution",
    )
    small_tilts: tuple[str, ...] | None = optional(
        ["1 ″", "2 ″"],
        about="tilts about two positions of a dividing head, for threshold and resolution",
    )
    warm_up: int | None = optional(
        30,
        about="first readings on a dividing head, without a turn, for warm-up drift and stability",
        ge=12,
    )
    turns: int | None = optional(about="complete turns of the arm during each dwell of the plan")
    search: SearchSection | None = None
    filter: FilterSection | None = None
    prior_file: str | None = optional(
        "static.calibration.json",
        about="calibration file with bias and scale factor from a static test",
    )
    prior: dict[str, str] = Field(default_factory=dict, examples=[{"az.k0": "40 mg ± 5 mg"}])
    prior_from: dict[str, dict[str, str]] = Field(
        default_factory=dict,
        description="per calibration file: coefficient of this run = coefficient of the file",
        examples=[{"static.calibration.json": {"a.k3": "ax.k3"}}],
    )
    prior_type: str | None = Field(
        None,
        description="file from inercal prior, made from earlier sensors of the type",
        examples=["type.prior.toml"],
    )


_planning_key = partial(optional, json_schema_extra=PLANNING)


class EnvironmentSection(Section):
    """Keys of [environment]: the temperatures around the bench."""

    kind: Literal["soaks", "ramp"] = optional(
        default="soaks",
        about="'soaks': run the plan at each temperature; 'ramp': vary the temperature",
    )
    temperature_sd: str | None = optional(
        "0.1 K", about="standard uncertainty of the temperature, common to all readings of a soak"
    )
    accelerometer_repeatability: str | None = optional(
        "50 µg", about="scatter of the biases from soak to soak"
    )
    gyro_repeatability: str | None = optional(
        "5 °/h", about="scatter of the biases from soak to soak"
    )
    lag: str | None = optional(
        "20 s ± 5 s", about="delay of the recorded temperature behind the sensing element"
    )
    warm_up: str | None = optional(
        "300 s", about="warm-up time constant of the biases, for a ramp up and down"
    )
    temperatures: tuple[str, ...] = _planning_key(
        ["-40 °C", "25 °C", "85 °C"],
        default=(),
        about="for a simulation or a chamber: soak temperatures, or turning points of a ramp",
    )
    ramp_rate: str | None = _planning_key(
        "2 K/min", about="for a simulation: rate of the chamber between the temperatures"
    )
    wait: str | None = _planning_key(
        "30 min", about="for a simulation or a chamber: rest time at each temperature"
    )
    case_time: str | None = _planning_key(
        "4 min", about="for a simulation: thermal time constant of the case"
    )
    tolerance: str | None = _planning_key(
        "0.5 K", about="for a chamber: largest difference from its set temperature during a soak"
    )
    drift: str | None = _planning_key(
        "0.1 K/min",
        about="for a chamber: largest drift of the sensor's own temperature during a soak",
    )
    steady_time: str | None = _planning_key(
        "10 min",
        about="for a chamber: time for which tolerance and drift are kept before the plan starts",
    )
    longest_wait: str | None = _planning_key(
        "3 h", about="for a chamber: the run ends if a soak is not stable after this time"
    )
    limits: tuple[str, str] | None = _planning_key(
        ["-45 °C", "90 °C"],
        about="for a chamber: lowest and highest permitted temperature of chamber and sensor",
    )
    max_rate: str | None = _planning_key(
        "10 K/min", about="for a chamber: largest permitted rate of its temperature"
    )


class SpecificationSection(Section):
    """Keys of [specification]: limits for coefficients, and the decision rule."""

    rule: Literal["guarded", "simple"] = optional(
        default="guarded",
        about="'guarded': pass only outside the guard band; 'simple': no guard band",
    )
    factor: float = optional(
        default=1.0, about="width of the guard band as a multiple of U, for rule 'guarded'"
    )
    uncertainty: Literal["session", "next_use"] = optional(
        default="session",
        about="uncertainty used: that of this session, or that of the sensor's next use",
    )
    repeatability: str | None = optional(
        "ACC-1.repeatability.json", about="file from inercal repeat, for uncertainty = 'next_use'"
    )
    limits: dict[str, str | tuple[str, str]] = Field(
        description="limits for a coefficient or for a group of coefficients",
        examples=[{"bias": "± 20 mg", "ax.k1": ["-1 %", "2 %"], "k2": "≤ 50 µg/g²"}],
    )


class RunSchema(Section):
    """All sections of a run file."""

    sensor: SensorSection
    bench: BenchSection
    data: DataSection
    method: MethodSection
    job: JobSection | None = optional(json_schema_extra=DESCRIPTION)
    specification: SpecificationSection | None = None
    environment: EnvironmentSection | None = None


@cache
def schema_for_kind(kind: str) -> type[RunSchema]:
    """Return the schema of a run file for one kind of bench.

    Parameters
    ----------
    kind : str
        Name of the kind, a key of `KINDS`.
    """
    chosen = KINDS[kind]
    return create_model(
        "RunSchema", __base__=RunSchema, bench=(chosen.section, ...), data=(chosen.data, ...)
    )


def reader_options(
    data: Mapping[str, Any], section: type[DataSection]
) -> tuple[dict[str, Any], dict[str, Any]]:
    """Split [data] into the keys of the section itself and the options of file readers.

    The reader is chosen when a file is read. It then raises an error for options that it does not
    know.

    Raises
    ------
    InputError
        An option of a reader has the same name as a key of [data].
    """
    own = section.model_fields
    if all(key in own for key in data):
        return dict(data), {}  # returned early: no search through the installed packages
    options = tuple(known_options())
    for key in options:
        if key in own:
            raise InputError(
                f"reader {' and '.join(readers_with_option(key))} has an option {key!r}, which is "
                "a key of [data] already: rename the reader's option",
                key=f"[data] {key}",
            )
    return (
        {key: value for key, value in data.items() if key not in options},
        {key: value for key, value in data.items() if key in options},
    )
