"""What a run file may contain, section by section. Values with units are text: "60 µg/√Hz".

An example stands beside a key where its default is none, or says nothing: complaints show it.
"""

from functools import cache
from typing import Literal

from pydantic import Field, create_model, model_validator

from inercal.benches.kinds import KINDS
from inercal.settings import DESCRIPTION, BenchSection, Section, Use


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

    def idle(self, use: Use) -> dict[str, str]:
        """Return the keys that change no result of such a use, with the reason and what to do."""
        if not use.means:
            return {}
        words = "means hold no samples; state their noise and instability in [data.sd] instead"
        return dict.fromkeys(("white", "bias_instability", "random_walk", "quantisation"), words)


class SensorSection(Section):
    """[sensor]."""

    name: str = Field("sensor", json_schema_extra=DESCRIPTION)
    form: Literal["reference", "tilted"] | None = Field(
        None, description="'reference', but 'tilted' on a dividing head"
    )
    frame: Literal["mount", "symmetric"] = "mount"
    accelerometer: ReadoutSection
    gyro: ReadoutSection | None = None
    truth: dict[str, str | float] = Field(
        default_factory=dict, examples=[{"ax.k0": "32 mg"}], json_schema_extra=DESCRIPTION
    )


class DataSection(Section):
    """[data]: the file and its columns, by header name or by number counted from 1."""

    file: str = Field(examples=["session.csv"])
    kind: Literal["recording", "means"] = "recording"
    accelerometer: tuple[str | int, ...] = ("acc_x", "acc_y", "acc_z")
    gyro: tuple[str | int, str | int, str | int] = ("gyr_x", "gyr_y", "gyr_z")
    gyro_file: str | None = Field(
        None,
        description="the gyros' columns, where they stand in a file of their own, same rows",
        examples=["gyro.mat"],
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
    marks: str = Field("found", description="'found', 'labels', or a file of marks")
    accept_moving: tuple[str, ...] | None = Field(
        None,
        description="marked sections that count as rests though their mean changes within them",
        examples=[["p11"]],
    )
    nonfinite: Literal["refuse", "drop"] = "refuse"
    sd: dict[Literal["accelerometer", "gyro"], str] = Field(
        default_factory=dict[Literal["accelerometer", "gyro"], str],
        description="of means: the standard deviation of each",
        examples=[{"accelerometer": "30 µg", "gyro": "5 °/h"}],
    )
    seconds: str | int | None = Field(None, description="of means: column of durations, s")
    arm_rate: str | int | None = Field(
        None, description="column of the rate of a centrifuge's arm, or of a rate table"
    )
    arm_rate_unit: str = Field("rpm", description="its unit, or the size of one: '0.5 rev/s'")
    attitude: tuple[str | int, str | int] | None = Field(
        None,
        description="of means on a centrifuge: columns of ψ and θ",
        examples=[["psi", "theta"]],
    )
    attitude_unit: str = "°"
    mounting: str | int | None = Field(
        None, description="on a rate table: column of mountings, 'XY' or 'ZY 30'"
    )
    angle: str | int | None = Field(None, description="column of a dividing head's angle")
    angle_unit: str = "°"
    autocollimator: str | int | None = Field(
        None, description="column of what it read beyond the angle"
    )
    autocollimator_unit: str = "″"
    level: str | int | None = Field(None, description="column of a level on the head's base")
    level_unit: str = "″"
    table: tuple[str | int, ...] | None = Field(
        None, description="on a turntable: columns of the axes' readback, outermost first"
    )
    table_unit: str = "°"
    table_file: str | None = Field(
        None,
        description="the file of that readback, where it has one of its own and its own clock",
        examples=["table.csv"],
    )
    table_time: str | int | None = Field(None, description="in that file: column of time")
    table_time_unit: str = "s"
    hold: str | int | None = Field(
        None,
        description="on a turntable: column of the number of each hold, negative elsewhere, that "
        "a bench host wrote; holds are then not sought",
        examples=["hold"],
    )

    @model_validator(mode="after")
    def _clocks_have_a_column(self) -> "DataSection":
        counts = self.time is not None and self.time_unit == "sample"
        if self.counter_modulus is not None and not counts:
            raise ValueError(
                "counter_modulus goes with a counter: name its column, time, and state "
                'time_unit = "sample"'
            )
        if self.table_file is None and self.table_time is not None:
            raise ValueError("table_time is a column of table_file, which is missing")
        if self.table_file is not None and self.table_time is None:
            raise ValueError(
                'table_file goes with table_time, its column of time, such as table_time = "time"'
            )
        if self.table_file is not None and self.hold is not None:
            raise ValueError(
                "hold is a column that a bench host writes beside the readback; with table_file "
                "leave it out"
            )
        return self

    @model_validator(mode="after")
    def _means_are_one_table(self) -> "DataSection":
        if self.kind == "means" and self.gyro_file is not None:
            raise ValueError("gyro_file goes with a recording; means of all axes are one table")
        if self.kind == "means" and self.accept_moving is not None:
            raise ValueError("accept_moving goes with a recording; leave it out")
        signed = [c for c in (*self.accelerometer, *self.gyro) if str(c).startswith("-")]
        if self.kind == "means" and signed:
            raise ValueError(
                f'"{signed[0]}" reverses a column of a recording; in a table of means write the '
                "readings with their signs"
            )
        return self


class SearchSection(Section):
    """[method.search]: of estimator global of ship_multi_angle."""

    seed: int = Field(0, ge=0)
    time_limit: str = "20 s"
    goal: str = Field("5 %", description="largest relative error of a norm")
    scale_error: str = Field("10 %", description="bound of each, about nominal")
    cross_axis: str = "10 %"
    bias: str = "0.2 g"


class MethodSection(Section):
    """[method]."""

    name: str = Field(examples=["six_position"])
    estimator: str = Field("", examples=["ml"])
    coefficients: tuple[str, ...] = Field(
        (), description="in place of the method's own choice", examples=[["bias", "scale"]]
    )
    also: tuple[str, ...] = Field(
        (), description="beside the method's own choice", examples=[["g", "k2"]]
    )
    seconds: str | None = Field(
        None, description="length of each hold in a simulation", examples=["20 s"]
    )
    path: str | None = Field(
        None,
        description="of a turntable: 'paper', 'fast', 'discrete', or a file of its steps",
        examples=["fast"],
    )
    turn: str | None = Field(
        None, description="angle of a turn, positive counter-clockwise", examples=["-360 °"]
    )
    turn_seconds: str | None = Field(None, examples=["6 s"])
    positions: int | None = Field(
        None, description="rests of a multi_position simulation, or positions of a dividing head"
    )
    reverse: bool | None = Field(None, description="whether a dividing head goes back too")
    time_offset: bool = Field(False, description="find the gyros' delay too")
    attitudes: str | None = Field(
        None, description="plan of attitudes on a centrifuge", examples=["half-circle"]
    )
    rates: tuple[str, ...] | None = Field(
        None, description="rates of the arm in the plan", examples=[["60 rpm", "120 rpm"]]
    )
    turns: int | None = Field(None, description="whole turns that a dwell of the plan lasts")
    search: SearchSection | None = None
    prior_file: str | None = Field(
        None,
        description="calibration of bias and scale in rest",
        examples=["static.calibration.json"],
    )
    prior: dict[str, str] = Field(default_factory=dict, examples=[{"az.k0": "40 mg ± 5 mg"}])
    prior_from: dict[str, dict[str, str]] = Field(
        default_factory=dict,
        description="by calibration file: our coefficient = its coefficient",
        examples=[{"static.calibration.json": {"a.k3": "ax.k3"}}],
    )


class RunSchema(Section):
    """A whole run file."""

    sensor: SensorSection
    bench: BenchSection
    data: DataSection
    method: MethodSection


@cache
def schema_of(kind: str) -> type[RunSchema]:
    """Return what a run file may contain whose [bench] is of this kind.

    Parameters
    ----------
    kind : str
        Of `KINDS`.
    """
    return create_model("RunSchema", __base__=RunSchema, bench=(KINDS[kind].section, ...))
