"""The keys of a run file, section by section. Values with units are text: "60 µg/√Hz".

A key whose default shows no value has an example, which error messages print.
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
    """[sensor.accelerometer] and [sensor.gyro]: how the axes state readings, and their noise."""

    unit: str = Field(description="unit of the output: 'LSB', 'V', …", examples=["m/s²"])
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
        None, description="step of the reading", examples=["0.5 mg", "0.02 °/s"]
    )

    def unused_keys(self, use: BenchUsage) -> dict[str, str]:
        """Return the keys that change no result of this use, with the reason and what to do."""
        if not use.means:
            return {}
        reason = "means have no samples; state their noise and instability in [data.sd] instead"
        return dict.fromkeys(("white", "bias_instability", "random_walk", "quantisation"), reason)


class SensorSection(Section):
    """[sensor]."""

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
    """[method.search]: of estimator global of ship_multi_angle."""

    seed: int = Field(0, ge=0)
    time_limit: str = "20 s"
    goal: str = Field("5 %", description="largest relative error of a norm")
    scale_error: str = Field("10 %", description="bound of each, about nominal")
    cross_axis: str = "10 %"
    bias: str = "0.2 g"


class FilterInitialSection(Section):
    """[method.filter.initial]: standard deviations of the filters' states before the data."""

    gyro_bias: str | None = Field(None, description="of the gyros' biases", examples=["1000 °/h"])
    gyro_scale: str | None = Field(
        None, description="of the gyros' scale factors", examples=["5000 ppm"]
    )
    gyro_misalignment: str | None = Field(
        None, description="of the gyros' misalignments", examples=["20 ′"]
    )
    accelerometer_bias: str | None = Field(
        None, description="of the accelerometers' biases", examples=["5 mg"]
    )
    accelerometer_scale: str | None = Field(
        None, description="of the accelerometers' scale factors", examples=["5000 ppm"]
    )
    accelerometer_misalignment: str | None = Field(
        None, description="of the accelerometers' misalignments", examples=["20 ′"]
    )
    attitude: str | None = Field(
        None, description="of the attitude in both filters", examples=["30 ″"]
    )


class FilterSection(Section):
    """[method.filter]: of turntable_kalman, in place of an estimator's own values."""

    readback_sd: str | None = Field(None, description="R of the attitude", examples=["4 ″"])
    velocity_sd: str | None = Field(
        None, description="R of the velocity at rest", examples=["0.1 mm/s"]
    )
    epoch: str | None = Field(
        None, description="time between updates of the covariance", examples=["0.2 s"]
    )
    bias_drift: bool | None = Field(None, description="whether biases drift", examples=[False])
    table_states: Literal["whole", "lean", "exact"] | None = Field(
        None, description="which of the table's errors are states", examples=["lean"]
    )
    initial: FilterInitialSection | None = None


class MethodSection(Section):
    """[method]."""

    name: str = Field(examples=["six_position"])
    estimator: str = Field("", examples=["ml"])
    coefficients: tuple[str, ...] = Field(
        (), description="instead of the method's own choice", examples=[["bias", "scale"]]
    )
    also: Literal["auto"] | tuple[str, ...] = Field(
        (),
        description="in addition to the method's own choice; 'auto': what the score tests ask for",
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
        description="of a turntable: 'paper', 'fast', 'discrete', or a file of its steps",
        examples=["fast"],
    )
    turn: str | tuple[str, ...] | None = Field(
        None,
        description="angle of the turns, positive counter-clockwise, or those about x, y, z",
        examples=["-360 °"],
    )
    turn_seconds: str | None = Field(None, examples=["6 s"])
    positions: int | None = Field(
        None, description="rests of a multi_position simulation, or positions of a dividing head"
    )
    reverse: bool | None = Field(
        None, description="whether a dividing head also runs the plan backwards"
    )
    time_offset: bool = Field(False, description="whether the gyros' delay is estimated too")
    attitudes: str | None = Field(
        None, description="plan of attitudes on a centrifuge", examples=["half-circle"]
    )
    rates: tuple[str, ...] | None = Field(
        None, description="rates of the arm in the plan", examples=[["60 rpm", "120 rpm"]]
    )
    turns: int | None = Field(
        None, description="complete turns of the arm in each dwell of the plan"
    )
    search: SearchSection | None = None
    filter: FilterSection | None = None
    prior_file: str | None = Field(
        None,
        description="calibration file of bias and scale factor at rest",
        examples=["static.calibration.json"],
    )
    prior: dict[str, str] = Field(default_factory=dict, examples=[{"az.k0": "40 mg ± 5 mg"}])
    prior_from: dict[str, dict[str, str]] = Field(
        default_factory=dict,
        description="per calibration file: coefficient of this run = coefficient of the file",
        examples=[{"static.calibration.json": {"a.k3": "ax.k3"}}],
    )


class EnvironmentSection(Section):
    """[environment]: the temperatures around the bench."""

    kind: Literal["soaks", "ramp"] = Field(
        "soaks",
        description="'soaks': the plan at one temperature after the other; 'ramp': it moves",
    )
    temperature_sd: str | None = Field(
        None,
        description="of the error that the temperatures of a soak have in common",
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
        description="time by which the recorded temperature is behind the sensing element",
        examples=["20 s ± 5 s"],
    )
    warm_up: str | None = Field(
        None,
        description="time constant of a warm-up of the biases, in a ramp up and down",
        examples=["300 s"],
    )
    temperatures: tuple[str, ...] = Field(
        (),
        description="of a simulation: of the soaks, or turning points of a ramp",
        examples=[["-40 °C", "25 °C", "85 °C"]],
        json_schema_extra=PLANNING,
    )
    ramp_rate: str | None = Field(
        None,
        description="of a simulation: of the chamber between them",
        examples=["2 K/min"],
        json_schema_extra=PLANNING,
    )
    wait: str | None = Field(
        None,
        description="of a simulation: at rest at each temperature",
        examples=["30 min"],
        json_schema_extra=PLANNING,
    )
    case_time: str | None = Field(
        None,
        description="of a simulation: time constant of the case",
        examples=["4 min"],
        json_schema_extra=PLANNING,
    )


class SpecificationSection(Section):
    """[specification]: limits of coefficients, and the rule by which they are judged."""

    rule: Literal["guarded", "simple"] = Field(
        "guarded", description="'guarded': a pass keeps the guard band; 'simple': there is none"
    )
    factor: float = Field(1.0, description="guard band in U, of rule 'guarded'")
    uncertainty: Literal["session", "next_use"] = Field(
        "session", description="which U: that of this session, or of the sensor's next use"
    )
    repeatability: str | None = Field(
        None,
        description="file of inercal repeat, of uncertainty = 'next_use'",
        examples=["ACC-1.repeatability.json"],
    )
    limits: dict[str, str | tuple[str, str]] = Field(
        description="of a coefficient, or of a group of them",
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
    """Return the schema of a run file whose [bench] is of this kind.

    Parameters
    ----------
    kind : str
        Of `KINDS`.
    """
    chosen = KINDS[kind]
    return create_model(
        "RunSchema", __base__=RunSchema, bench=(chosen.section, ...), data=(chosen.data, ...)
    )


def reader_options(
    data: Mapping[str, Any], section: type[DataSection]
) -> tuple[dict[str, Any], dict[str, Any]]:
    """Split the keys of [data] into those of the section and those of readers of formats.

    The reader of a file is chosen when the file is read, and refuses there the options that it
    does not know.

    Raises
    ------
    InputError
        A reader has an option with the name of a key of [data].
    """
    own = section.model_fields
    if all(key in own for key in data):
        return dict(data), {}  # without a look at the installed packages
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
