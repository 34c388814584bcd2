"""What a run file may contain, section by section. Values with units are text: "60 µg/√Hz"."""

from typing import Literal

from pydantic import BaseModel, ConfigDict, Field, model_validator


class _Section(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class ReadoutSection(_Section):
    """[sensor.accelerometer] and [sensor.gyro]: how the axes state readings, and their noise."""

    unit: str = Field(description="unit of the output: 'm/s²', 'g', '°/s', 'LSB', 'V', …")
    scale: str | None = Field(None, description="nominal scale factor, such as '2048 LSB/g'")
    offset: float = Field(0.0, description="output at zero, in output units")
    full_scale: str | None = Field(None, description="largest reading, such as '16 g'")
    white: str | None = Field(None, description="velocity or angle random walk, '60 µg/√Hz'")
    bias_instability: str | None = None
    random_walk: str | None = None
    quantisation: str | None = Field(None, description="step of the reading, such as '0.5 mg'")


class SensorSection(_Section):
    """[sensor]."""

    name: str = "sensor"
    form: Literal["reference", "tilted"] | None = Field(
        None, description="'reference', but 'tilted' on a dividing head"
    )
    frame: Literal["mount", "symmetric"] = "mount"
    accelerometer: ReadoutSection
    gyro: ReadoutSection | None = None
    truth: dict[str, str | float] = Field(default_factory=dict)


class _BenchSection(_Section):
    gravity: str | None = None
    latitude: str | None = None
    height: str = "0 m"

    @model_validator(mode="after")
    def _gravity_is_known(self) -> "_BenchSection":
        if self.gravity is None and self.latitude is None:
            raise ValueError('give gravity = "9.81 m/s² ± 0.1 mm/s²" or latitude (and height)')
        return self


class HandSection(_BenchSection):
    """[bench]: bare hands. Gravity is given, or computed from latitude and height."""

    kind: Literal["hand"] = "hand"
    tilt: str = "0.5 °"
    turn_angle: str = "1 °"
    turn_tilt: str = "0.5 °"
    timebase: str = "100 ppm"


class CentrifugeSection(_BenchSection):
    """[bench]: a precision centrifuge."""

    kind: Literal["centrifuge"]
    radius: str
    stretch: str = "0 ppm/g"
    rate_error: str = "1 ppm"
    tilt: str = "2 ″"
    lean: str = "2 ″"
    dwell_rate: str = "0 ppm"
    dwell_tilt: str = "0 ″"
    platform: Literal["locked", "counter-rotating"] = "locked"
    sense: Literal["counter-clockwise", "clockwise"] = "counter-clockwise"
    indexing: str | None = Field(None, description="of each attitude, where attitudes are known")
    mounting: str = "0.1 °"


class DividingHeadSection(_BenchSection):
    """[bench]: a dividing head with its spindle level."""

    kind: Literal["dividing_head"]
    harmonics: tuple[str, ...] = ("1 ″", "1 ″")
    division: str = "1 ″"
    autocollimation: Literal["pairs", "every", "none"] = "none"
    autocollimator: str = "0.1 ″"
    polygon: str | None = Field(None, description="certificate: one row a face")
    polygon_unit: str = "″"
    certificate: str = "0.1 ″"
    base: str = "10 ″"
    pier: str = "0.1 ″"
    creep: str = "0 ″"
    lean: str = "20 ″"
    drift: str = "0.5 µg"


class RateTableSection(_BenchSection):
    """[bench]: a plain rate table with a fixture, as for sensors of ship models."""

    kind: Literal["rate_table"]
    radius: str
    seat: str = "0.5 mm"
    pose: str = "0.2 °"
    rate_error: str = "0 %"
    speed: str = "0.05 %"
    lean: str = "0.05 °"


BENCHES: dict[str, type[_BenchSection]] = {
    "hand": HandSection,
    "centrifuge": CentrifugeSection,
    "dividing_head": DividingHeadSection,
    "rate_table": RateTableSection,
}
BenchSection = HandSection | CentrifugeSection | DividingHeadSection | RateTableSection


class DataSection(_Section):
    """[data]: the file and its columns, by header name or by number counted from 1."""

    file: str
    kind: Literal["recording", "means"] = "recording"
    accelerometer: tuple[str | int, ...] = ("acc_x", "acc_y", "acc_z")
    gyro: tuple[str | int, str | int, str | int] = ("gyr_x", "gyr_y", "gyr_z")
    gyro_file: str | None = Field(
        None, description="the gyros' columns, where they stand in a file of their own, same rows"
    )
    time: str | int | None = None
    time_unit: str = "s"
    rate: str | None = None
    label: str | int | None = None
    temperature: str | int | None = None
    temperature_unit: str = "°C"
    marks: str = Field("found", description="'found', 'labels', or a file of marks")
    nonfinite: Literal["refuse", "drop"] = "refuse"
    sd: dict[Literal["accelerometer", "gyro"], str] = Field(
        default_factory=dict[Literal["accelerometer", "gyro"], str],
        description="of means: the standard deviation of each",
    )
    seconds: str | int | None = Field(None, description="of means: column of durations, s")
    arm_rate: str | int | None = Field(
        None, description="column of the rate of a centrifuge's arm, or of a rate table"
    )
    arm_rate_unit: str = Field("rpm", description="its unit, or the size of one: '0.5 rev/s'")
    attitude: tuple[str | int, str | int] | None = Field(
        None, description="of means on a centrifuge: columns of ψ and θ"
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

    @model_validator(mode="after")
    def _means_are_one_table(self) -> "DataSection":
        if self.kind == "means" and self.gyro_file is not None:
            raise ValueError("gyro_file goes with a recording; means of all axes are one table")
        return self


class SearchSection(_Section):
    """[method.search]: of estimator global of ship_multi_angle."""

    seed: int = Field(0, ge=0)
    time_limit: str = "20 s"
    goal: str = Field("5 %", description="largest relative error of a norm")
    scale_error: str = Field("10 %", description="bound of each, about nominal")
    cross_axis: str = "10 %"
    bias: str = "0.2 g"


class MethodSection(_Section):
    """[method]."""

    name: str
    estimator: str = ""
    coefficients: tuple[str, ...] = Field((), description="in place of the method's own choice")
    also: tuple[str, ...] = Field((), description="beside the method's own choice")
    seconds: str | None = Field(None, description="length of each hold in a simulation")
    turn: str | None = Field(None, description="angle of a turn, positive counter-clockwise")
    turn_seconds: str | None = None
    positions: int | None = Field(
        None, description="rests of a multi_position simulation, or positions of a dividing head"
    )
    reverse: bool | None = Field(None, description="whether a dividing head goes back too")
    time_offset: bool = Field(False, description="find the gyros' delay too")
    attitudes: str | None = Field(None, description="plan of attitudes on a centrifuge")
    rates: tuple[str, ...] | None = Field(None, description="rates of the arm in the plan")
    turns: int | None = Field(None, description="whole turns that a dwell of the plan lasts")
    search: SearchSection | None = None
    prior_file: str | None = Field(None, description="calibration of bias and scale in rest")
    prior: dict[str, str] = Field(default_factory=dict)
    prior_from: dict[str, dict[str, str]] = Field(
        default_factory=dict, description="by calibration file: our coefficient = its coefficient"
    )


class RunSchema(_Section):
    """A whole run file."""

    sensor: SensorSection
    bench: BenchSection = Field(discriminator="kind")
    data: DataSection
    method: MethodSection
