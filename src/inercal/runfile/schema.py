"""What a run file may contain, section by section. Values with units are text: "60 µg/√Hz".

An example stands beside a key where its default is none, or says nothing: complaints show it.
"""

from dataclasses import dataclass
from typing import Literal

from pydantic import BaseModel, ConfigDict, Field, JsonValue, model_validator

# What enters no result: names, and the truth of a simulation.
_DESCRIPTION: dict[str, JsonValue] = {"role": "description"}
# What shapes the plan or its simulation alone: limits of a table's motion, and where the IMU is on
# it: accelerometers count at rest.
_PLANNING: dict[str, JsonValue] = {"role": "plan"}


@dataclass(frozen=True)
class Use:
    """What a run makes of its bench, as far as keys of the bench depend on it.

    Parameters
    ----------
    method : str
    turns : bool
        Whether its plan has turns of a known angle.
    attitudes : bool
        Whether it knows the attitudes, and does not find them itself.
    gyros : bool
        Whether there are gyros.
    means : bool
        Whether the data are means.
    """

    method: str
    turns: bool
    attitudes: bool
    gyros: bool
    means: bool


class _Section(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class ReadoutSection(_Section):
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


class SensorSection(_Section):
    """[sensor]."""

    name: str = Field("sensor", json_schema_extra=_DESCRIPTION)
    form: Literal["reference", "tilted"] | None = Field(
        None, description="'reference', but 'tilted' on a dividing head"
    )
    frame: Literal["mount", "symmetric"] = "mount"
    accelerometer: ReadoutSection
    gyro: ReadoutSection | None = None
    truth: dict[str, str | float] = Field(
        default_factory=dict, examples=[{"ax.k0": "32 mg"}], json_schema_extra=_DESCRIPTION
    )


class _BenchSection(_Section):
    gravity: str | None = Field(None, examples=["9.8073 m/s² ± 0.2 mm/s²"])
    latitude: str | None = Field(None, examples=["48.1 °"])
    height: str | None = Field(None, examples=["520 m"])
    name: str = Field(
        "",
        description="what the laboratory calls it",
        examples=["table 2"],
        json_schema_extra=_DESCRIPTION,
    )

    @model_validator(mode="after")
    def _gravity_is_known(self) -> "_BenchSection":
        if self.gravity is None and self.latitude is None:
            raise ValueError('give gravity = "9.81 m/s² ± 0.1 mm/s²" or latitude (and height)')
        if self.height is not None and self.latitude is None:
            raise ValueError("height goes with latitude: gravity is computed from both, or checked")
        return self

    def idle(self, use: Use) -> dict[str, str]:
        """Return the keys that change no result of such a use, each with the reason."""
        return {}


class HandSection(_BenchSection):
    """[bench]: bare hands. Gravity is given, or computed from latitude and height."""

    kind: Literal["hand"] = "hand"
    tilt: str = "0.5 °"
    turn_angle: str = "1 °"
    turn_tilt: str = "0.5 °"
    timebase: str = "100 ppm"

    def idle(self, use: Use) -> dict[str, str]:
        """Return the keys that change no result of such a use, each with the reason."""
        found: dict[str, str] = {}
        if not use.attitudes:
            found["tilt"] = f"{use.method} finds the attitudes itself"
        if not use.turns:
            words = f"{use.method} makes no turns of a known angle"
            found |= {"turn_angle": words, "turn_tilt": words}
            if not use.gyros or use.attitudes:
                found["timebase"] = f"without turns nothing of {use.method} depends on time"
        return found


class CentrifugeSection(_BenchSection):
    """[bench]: a precision centrifuge."""

    kind: Literal["centrifuge"]
    radius: str = Field(examples=["1 m ± 10 µm"])
    stretch: str = Field("0 ppm/g ± 0", examples=["0.2 ppm/g ± 0.05 ppm/g"])
    rate_error: str = "1 ppm"
    tilt: str = "2 ″"
    lean: str = "2 ″"
    dwell_rate: str = Field("0 ppm", examples=["0.2 ppm"])
    dwell_tilt: str = Field("0 ″", examples=["1 ″"])
    platform: Literal["locked", "counter-rotating"] = "locked"
    sense: Literal["counter-clockwise", "clockwise"] = "counter-clockwise"
    indexing: str | None = Field(
        None, description="of each attitude, where attitudes are known", examples=["0.02 °"]
    )
    mounting: str = "0.1 °"

    def idle(self, use: Use) -> dict[str, str]:
        """Return the keys that change no result of such a use, each with the reason."""
        found: dict[str, str] = {}
        if self.platform == "locked":
            found["lean"] = (
                "over whole turns of a locked platform a lean of the spindle is not felt"
            )
        if self.indexing is None:
            found["mounting"] = "norms depend on no mounting; it goes with indexing"
        if self.latitude is None and self.platform == "locked" and self.indexing is None:
            found["sense"] = "the sense counts for the earth's rate; it goes with latitude"
        return found


class DividingHeadSection(_BenchSection):
    """[bench]: a dividing head with its spindle level."""

    kind: Literal["dividing_head"]
    harmonics: tuple[str, ...] = ("1 ″", "1 ″")
    division: str = "1 ″"
    autocollimation: Literal["pairs", "every", "none"] = "none"
    autocollimator: str = "0.1 ″"
    polygon: str | None = Field(
        None, description="certificate: one row a face", examples=["polygon.csv"]
    )
    polygon_unit: str = Field("″", examples=["µrad"])
    certificate: str = "0.1 ″"
    base: str = "10 ″"
    pier: str = "0.1 ″"
    creep: str = Field("0 ″", examples=["0.2 ″"])
    lean: str = "20 ″"
    drift: str = "0.5 µg"

    def idle(self, use: Use) -> dict[str, str]:
        """Return the keys that change no result of such a use, each with the reason."""
        found: dict[str, str] = {}
        if self.polygon is None:
            found["polygon_unit"] = "there is no polygon"
        if self.autocollimation == "none":
            words = 'autocollimation is "none"'
            found |= {"autocollimator": words, "certificate": words}
        elif self.autocollimation == "every":
            words = 'with autocollimation = "every" the head\'s own angle is nowhere used'
            found |= {"harmonics": words, "division": words}
        return found


class RateTableSection(_BenchSection):
    """[bench]: a plain rate table with a fixture, as for sensors of ship models."""

    kind: Literal["rate_table"]
    radius: str = Field(examples=["250 mm ± 0.3 mm"])
    seat: str = "0.5 mm"
    pose: str = "0.2 °"
    rate_error: str = Field("0 %", examples=["0.01 %"])
    speed: str = "0.05 %"
    lean: str = "0.05 °"


class TurntableSection(_BenchSection):
    """[bench]: a turntable of one to three axes."""

    kind: Literal["turntable"]
    axes: str = Field("zxy", description="body axes that the axes turn about, outermost first")
    azimuth: str = "0 ° ± 0.1 °"
    lean: str = "5 ″"
    square: str = "2 ″"
    harmonics: tuple[str, ...] = ("2 ″", "1 ″")
    noise: str = "0.5 ″"
    latency: str = "0 ms ± 5 ms"
    clock: str = "0 ppm"
    lever: tuple[str, str, str] = Field(("0 mm", "0 mm", "0 mm"), json_schema_extra=_PLANNING)
    rate: tuple[str, ...] = Field(
        ("30 °/s",), description="limit of all axes, or of each", json_schema_extra=_PLANNING
    )
    acceleration: tuple[str, ...] = Field(("30 °/s²",), json_schema_extra=_PLANNING)
    jerk: tuple[str, ...] = Field(
        (),
        description="limit; without one the rate is a trapezoid",
        examples=[["100 °/s³"]],
        json_schema_extra=_PLANNING,
    )


BENCHES: dict[str, type[_BenchSection]] = {
    "hand": HandSection,
    "centrifuge": CentrifugeSection,
    "dividing_head": DividingHeadSection,
    "rate_table": RateTableSection,
    "turntable": TurntableSection,
}
BenchSection = (
    HandSection | CentrifugeSection | DividingHeadSection | RateTableSection | TurntableSection
)


class DataSection(_Section):
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


class RunSchema(_Section):
    """A whole run file."""

    sensor: SensorSection
    bench: BenchSection = Field(discriminator="kind")
    data: DataSection
    method: MethodSection
