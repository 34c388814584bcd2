"""The sections of the input file of a qualification, in the style of a run file."""

import datetime as dt
from typing import Literal

from pydantic import Field

from inercal.physics.section_settings import Section, optional

Column = str


class QualificationSection(Section):
    """Section [qualification]: the bench, the dates, the method and the instruments."""

    kind: Literal[
        "head_map",
        "table_tilt",
        "right_angle",
        "radius",
        "rate",
        "rate_stability",
        "gravity",
        "azimuth",
    ]
    bench: str = optional("dividing_head", default="", about="kind of the bench")
    name: str = optional(default="", about="name of the bench; empty means any bench of its kind")
    date: dt.date = Field(examples=[dt.date(2026, 3, 1)])
    valid_until: dt.date | None = optional(dt.date(2027, 3, 1))
    method: str = Field(examples=["polygon of 36 faces and autocollimator"])
    instrument: str = optional("autocollimator 4", default="")
    certificate: str = optional("PTB 4711/25", default="")
    uses: tuple[str, ...] = optional(
        ["gravity.qualification.json"], default=(), about="files of earlier qualifications"
    )


class AngleReadingSection(Section):
    """Section [measurement] for an instrument that is read at angles of the bench."""

    file: str = Field(examples=["readings.csv"])
    angle: Column = "angle"
    angle_unit: str = "°"
    reading: Column = "reading"
    reading_unit: str = "″"


class HeadMapSection(AngleReadingSection):
    """Section [measurement] for a head map, measured with a polygon and an autocollimator."""

    autocollimator: str = Field(description="standard deviation of one reading", examples=["0.1 ″"])
    harmonics: int = optional(default=2, about="number of harmonics", ge=1)
    division: str = optional("0.3 ″", default="0 ″")
    polygon: str | None = optional("polygon.csv")
    polygon_unit: str = "″"
    polygon_sd: str = optional(
        "0.05 ″", default="0 ″", about="standard deviation of each certified deviation"
    )
    face: Column | None = optional("face")
    series: Column | None = optional("series")
    axis: str | None = optional("outer", about="axis of a turntable")


class TableTiltSection(AngleReadingSection):
    """Section [measurement] for the lean of a table, measured with a level."""

    level_at: Literal["table", "base"] = "table"
    level: str = Field(description="standard deviation of one reading", examples=["0.2 ″"])
    level_scale: str = optional("1 %", default="0 %")
    azimuth: str | None = optional("90 °", about="azimuth of the level")
    wobble: int = optional(default=1, about="highest harmonic of the wobble", ge=1, le=6)


class RightAngleSection(AngleReadingSection):
    """Section [measurement] for a right angle, measured with a level, direct and reversed."""

    axes: str = Field(examples=["zxy"])
    right_angle: int = optional(default=1, about="1 is between the outermost axis and the next")
    sense: Column = "sense"
    level: str = Field(description="standard deviation of one reading", examples=["0.2 ″"])
    level_scale: str = optional("1 %", default="0 %")


class RadiusSection(Section):
    """Section [measurement] for a radius, measured with a machine or an accelerometer."""

    by: Literal["machine", "sensor"]
    file: str = Field(examples=["radius.csv"])
    reading: Column = "reading"
    reading_unit: str = Field(examples=["mm"])
    reading_sd: str = Field(description="standard deviation of one reading", examples=["2 µm"])
    machine: str | None = optional("3 µm", about="certified standard uncertainty of the machine")
    rate: Column = "rate"
    rate_unit: str = "rpm"
    rate_error: str | None = optional("1 ppm", about="relative error that all rates share")
    scale: str | None = optional("20 ppm", about="scale factor uncertainty of the sensor")
    k2: str | None = optional("0 µg/g² ± 1 µg/g²", about="quadratic term of the sensor")
    stretch: bool = optional(default=False, about="whether the stretch is estimated")


class RateSection(Section):
    """Section [measurement] for rates, measured with a counter."""

    file: str = Field(examples=["counts.csv"])
    rate: Column = "rate"
    rate_unit: str = "rpm"
    turns: Column = "turns"
    seconds: Column = "seconds"
    timer: str = Field(description="standard deviation of one time stamp", examples=["10 µs"])
    timebase: str = optional("0.1 ppm", default="0 ppm")


class GravitySection(Section):
    """Section [measurement] for gravity."""

    by: Literal["absolute", "network", "computed"]
    gravity: str | None = optional(
        "9.80123 m/s² ± 0.1 µm/s²", about="gravity at the measured point"
    )
    file: str | None = optional("gravimeter.csv")
    site: Column = "site"
    hours: Column = "hours"
    reading: Column = "reading"
    reading_unit: str = "mGal"
    reading_sd: str | None = optional("5 µGal")
    scale: str = optional("0.01 %", default="0 %")
    latitude: str | None = optional("48.1 °")
    height: str | None = optional("520 m", about="height above sea level")
    above: str = optional("1.2 m", default="0 m", about="height of the sensor above the point")
    gradient: str | None = optional("3.086 µm/s²/m ± 0.1 µm/s²/m")
    tide: Literal["corrected", "in the uncertainty"] = "in the uncertainty"


class AzimuthSection(AngleReadingSection):
    """Section [measurement] for an azimuth, measured with a gyro whose input axis is level."""

    reading_unit: str = "°/h"
    reading_sd: str = Field(description="standard deviation of one reading", examples=["0.01 °/h"])
    latitude: str = Field(examples=["48.1 °"])
    offset: str = Field(
        description="angle of the input axis from the body's y axis", examples=["0 ° ± 0.01 °"]
    )
    scale: str = optional("0.1 %", default="1 %")


SECTIONS: dict[str, type[Section]] = {
    "head_map": HeadMapSection,
    "table_tilt": TableTiltSection,
    "right_angle": RightAngleSection,
    "radius": RadiusSection,
    "rate": RateSection,
    "rate_stability": RateSection,
    "gravity": GravitySection,
    "azimuth": AzimuthSection,
}
