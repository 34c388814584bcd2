"""Schema of a run file, with the keys of each section.

Values with units are text, such as "60 µg/√Hz". If the default of a key is not a typical value, the
key has an example, which error messages show.
"""

from collections.abc import Mapping
from functools import cache
from typing import Any, Literal

from pydantic import Field, create_model

from inercal.basics.errors import InputError
from inercal.benches.kinds import KINDS
from inercal.physics.section_settings import (
    DESCRIPTION,
    PLANNING,
    BenchSection,
    BenchUsage,
    Section,
)
from inercal.recordings.data import DataSection
from inercal.recordings.io.readers import known_options, readers_with_option
from inercal.runfile.job import JobSection


class ReadoutSection(Section):
    """Keys of [sensor.accelerometer] and [sensor.gyro]: output and noise of the axes."""

    unit: str = Field(description="output unit, such as 'LSB' or 'V'", examples=["m/s²"])
    unit_assumed: bool = Field(
        False, description="whether the unit is a guess that neither the user nor the data confirm"
    )
    scale: str | None = Field(None, description="nominal scale factor", examples=["2048 LSB/g"])
    offset: float = Field(0.0, description="output at zero, in output units")
    full_scale: str | None = Field(
        None, description="largest reading", examples=["16 g", "2000 °/s"]
    )
    white: str | None = Field(
        None, description="velocity or angle random walk", examples=["60 µg/√Hz", "0.1 °/√h"]
    )
    bias_instability: str | None = Field(None, examples=["20 µg", "5 °/h"])
    random_walk: str | None = Field(None, examples=["1 µg/√s", "1 °/h/√s"])
    quantisation: str | None = Field(
        None, description="resolution of the reading", examples=["0.5 mg", "0.02 °/s"]
    )

    def unused_keys(self, use: BenchUsage) -> dict[str, str]:
        """Return the keys that have no effect with this method, with the reason and the remedy."""
        if not use.means:
            return {}
        reason = "averaged readings contain no samples; state noise and instability in [data.sd]"
        return dict.fromkeys(("white", "bias_instability", "random_walk", "quantisation"), reason)


class SensorSection(Section):
    """Keys of [sensor]."""

    name: str = Field("sensor", json_schema_extra=DESCRIPTION)
    form: Literal["reference", "tilted"] | None = Field(
        None, description="'reference', but 'tilted' on a dividing head"
    )
    frame: Literal["mount", "symmetric"] = "mount"
    accelerometer: ReadoutSection | None = None
    gyro: ReadoutSection | None = None
    truth: dict[str, str | float] = Field(
        default_factory=dict, examples=[{"ax.k0": "32 mg"}], json_schema_extra=DESCRIPTION
    )


class SearchSection(Section):
    """Keys of [method.search]: options for the estimator `global` of `ship_multi_angle`."""

    seed: int = Field(0, ge=0)
    time_limit: str = "20 s"
    goal: str = Field("5 %", description="largest relative error of a norm")
    scale_error: str = Field(
        "10 %", description="largest deviation of each scale factor from nominal"
    )
    cross_axis: str = "10 %"
    bias: str = "0.2 g"


class FilterInitialSection(Section):
    """Keys of [method.filter.initial]: initial standard deviations of the filter states."""

    gyro_bias: str | None = Field(
        None, description="standard deviation of the gyros' biases", examples=["1000 °/h"]
    )
    gyro_scale: str | None = Field(
        None, description="standard deviation of the gyros' scale factors", examples=["5000 ppm"]
    )
    gyro_misalignment: str | None = Field(
        None, description="standard deviation of the gyros' misalignments", examples=["20 ′"]
    )
    accelerometer_bias: str | None = Field(
        None, description="standard deviation of the accelerometers' biases", examples=["5 mg"]
    )
    accelerometer_scale: str | None = Field(
        None,
        description="standard deviation of the accelerometers' scale factors",
        examples=["5000 ppm"],
    )
    accelerometer_misalignment: str | None = Field(
        None,
        description="standard deviation of the accelerometers' misalignments",
        examples=["20 ′"],
    )
    attitude: str | None = Field(
        None, description="standard deviation of the attitude in both filters", examples=["30 ″"]
    )


class FilterSection(Section):
    """Keys of [method.filter]: filter parameters of turntable_kalman that replace the defaults."""

    readback_sd: str | None = Field(
        None, description="measurement noise R of the attitude", examples=["4 ″"]
    )
    velocity_sd: str | None = Field(
        None, description="measurement noise R of the velocity at rest", examples=["0.1 mm/s"]
    )
    epoch: str | None = Field(
        None, description="time between covariance updates", examples=["0.2 s"]
    )
    bias_drift: bool | None = Field(None, description="whether biases drift", examples=[False])
    table_states: Literal["whole", "lean", "exact"] | None = Field(
        None, description="table errors that are filter states", examples=["lean"]
    )
    initial: FilterInitialSection | None = None


class MethodSection(Section):
    """Keys of [method]."""

    name: str = Field(examples=["six_position"])
    estimator: str = Field("", examples=["ml"])
    coefficients: tuple[str, ...] = Field(
        (),
        description="coefficients to estimate instead of the method's default",
        examples=[["bias", "scale"]],
    )
    also: Literal["auto"] | tuple[str, ...] = Field(
        (),
        description="additional coefficients; 'auto': those that score tests ask for",
        examples=[["g", "k2"], "auto"],
    )
    temperature_order: Literal["auto"] | tuple[int, int, int] | None = Field(
        None,
        description="orders of bias, scale factor and misalignment in temperature, or 'auto'",
        examples=["auto", [3, 2, 1]],
    )
    seconds: str | None = Field(
        None, description="length of each hold in a simulation", examples=["20 s"]
    )
    path: str | None = Field(
        None,
        description="plan for a turntable: 'paper', 'fast', 'discrete', or a file with its steps",
        examples=["fast"],
    )
    turn: str | tuple[str, ...] | None = Field(
        None,
        description="angle of the turns, positive counter-clockwise, or angles about x, y and z",
        examples=["-360 °"],
    )
    turn_seconds: str | None = Field(None, examples=["6 s"])
    positions: int | None = Field(
        None,
        description="rests in a multi_position simulation, or positions on a dividing head",
    )
    reverse: bool | None = Field(
        None, description="whether a dividing head also runs the plan in reverse"
    )
    time_offset: bool = Field(
        False, description="whether the time delay of the gyros is also estimated"
    )
    attitudes: str | None = Field(
        None, description="plan of attitudes on a centrifuge", examples=["half-circle"]
    )
    rates: tuple[str, ...] | None = Field(
        None, description="arm rates in the plan", examples=[["60 rpm", "120 rpm"]]
    )
    small_rates: tuple[str, ...] | None = Field(
        None,
        description="rates about zero and about the slowest rate, for threshold and resolution",
        examples=[["0.01 °/s", "0.02 °/s"]],
    )
    small_tilts: tuple[str, ...] | None = Field(
        None,
        description="tilts about two positions of a dividing head, for threshold and resolution",
        examples=[["1 ″", "2 ″"]],
    )
    turns: int | None = Field(
        None, description="complete turns of the arm during each dwell of the plan"
    )
    search: SearchSection | None = None
    filter: FilterSection | None = None
    prior_file: str | None = Field(
        None,
        description="calibration file with bias and scale factor from a static test",
        examples=["static.calibration.json"],
    )
    prior: dict[str, str] = Field(default_factory=dict, examples=[{"az.k0": "40 mg ± 5 mg"}])
    prior_from: dict[str, dict[str, str]] = Field(
        default_factory=dict,
        description="per calibration file: coefficient of this run = coefficient of the file",
        examples=[{"static.calibration.json": {"a.k3": "ax.k3"}}],
    )


class EnvironmentSection(Section):
    """Keys of [environment]: the temperatures around the bench."""

    kind: Literal["soaks", "ramp"] = Field(
        "soaks",
        description="'soaks': run the plan at each temperature; 'ramp': vary the temperature",
    )
    temperature_sd: str | None = Field(
        None,
        description="standard uncertainty of the temperature, common to all readings of a soak",
        examples=["0.1 K"],
    )
    accelerometer_repeatability: str | None = Field(
        None, description="scatter of the biases from soak to soak", examples=["50 µg"]
    )
    gyro_repeatability: str | None = Field(
        None, description="scatter of the biases from soak to soak", examples=["5 °/h"]
    )
    lag: str | None = Field(
        None,
        description="delay of the recorded temperature behind the sensing element",
        examples=["20 s ± 5 s"],
    )
    warm_up: str | None = Field(
        None,
        description="warm-up time constant of the biases, for a ramp up and down",
        examples=["300 s"],
    )
    temperatures: tuple[str, ...] = Field(
        (),
        description="for a simulation: soak temperatures, or turning points of a ramp",
        examples=[["-40 °C", "25 °C", "85 °C"]],
        json_schema_extra=PLANNING,
    )
    ramp_rate: str | None = Field(
        None,
        description="for a simulation: rate of the chamber between the temperatures",
        examples=["2 K/min"],
        json_schema_extra=PLANNING,
    )
    wait: str | None = Field(
        None,
        description="for a simulation: rest time at each temperature",
        examples=["30 min"],
        json_schema_extra=PLANNING,
    )
    case_time: str | None = Field(
        None,
        description="for a simulation: thermal time constant of the case",
        examples=["4 min"],
        json_schema_extra=PLANNING,
    )


class SpecificationSection(Section):
    """Keys of [specification]: limits for coefficients, and the decision rule."""

    rule: Literal["guarded", "simple"] = Field(
        "guarded",
        description="'guarded': pass only outside the guard band; 'simple': no guard band",
    )
    factor: float = Field(
        1.0, description="width of the guard band as a multiple of U, for rule 'guarded'"
    )
    uncertainty: Literal["session", "next_use"] = Field(
        "session",
        description="uncertainty used: that of this session, or that of the sensor's next use",
    )
    repeatability: str | None = Field(
        None,
        description="file from inercal repeat, for uncertainty = 'next_use'",
        examples=["ACC-1.repeatability.json"],
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
    job: JobSection | None = Field(None, json_schema_extra=DESCRIPTION)
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
