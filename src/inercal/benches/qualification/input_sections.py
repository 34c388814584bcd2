"""The sections of the input file of a qualification, in the style of a run file."""

import datetime as dt
from typing import Literal

from pydantic import Field

from inercal.physics.section_settings import Section

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
    bench: str = Field("", description="kind of the bench", examples=["dividing_head"])
    name: str = Field("", description="name of the bench; empty means any bench of its kind")
    date: dt.date = Field(examples=[dt.date(2026, 3, 1)])
    valid_until: dt.date | None = Field(None, examples=[dt.date(2027, 3, 1)])
    method: str = Field(examples=["polygon of 36 faces and autocollimator"])
    instrument: str = Field("", examples=["autocollimator 4"])
    certificate: str = Field("", examples=["PTB 4711/25"])
    uses: tuple[str, ...] = Field(
        (), description="files of earlier qualifications", examples=[["gravity.qualification.json"]]
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
    harmonics: int = Field(2, ge=1, description="number of harmonics")
    division: str = Field("0 ″", examples=["0.3 ″"])
    polygon: str | None = Field(None, examples=["polygon.csv"])
    polygon_unit: str = "″"
    polygon_sd: str = Field(
        "0 ″", description="standard deviation of each certified deviation", examples=["0.05 ″"]
    )
    face: Column | None = Field(None, examples=["face"])
    series: Column | None = Field(None, examples=["series"])
    axis: str | None = Field(None, description="axis of a turntable", examples=["outer"])


class TableTiltSection(AngleReadingSection):
    """Section [measurement] for the lean of a table, measured with a level."""

    level_at: Literal["table", "base"] = "table"
    level: str = Field(description="standard deviation of one reading", examples=["0.2 ″"])
    level_scale: str = Field("0 %", examples=["1 %"])
    azimuth: str | None = Field(None, description="azimuth of the level", examples=["90 °"])
    wobble: int = Field(1, ge=1, le=6, description="highest harmonic of the wobble")


class RightAngleSection(AngleReadingSection):
    """Section [measurement] for a right angle, measured with a level, direct and reversed."""

    axes: str = Field(examples=["zxy"])
    right_angle: int = Field(1, description="1 is between the outermost axis and the next")
    sense: Column = "sense"
    level: str = Field(description="standard deviation of one reading", examples=["0.2 ″"])
    level_scale: str = Field("0 %", examples=["1 %"])


class RadiusSection(Section):
    """Section [measurement] for a radius, measured with a machine or an accelerometer."""

    by: Literal["machine", "sensor"]
    file: str = Field(examples=["radius.csv"])
    reading: Column = "reading"
    reading_unit: str = Field(examples=["mm"])
    reading_sd: str = Field(description="standard deviation of one reading", examples=["2 µm"])
    machine: str | None = Field(
        None, description="certified standard uncertainty of the machine", examples=["3 µm"]
    )
    rate: Column = "rate"
    rate_unit: str = "rpm"
    rate_error: str | None = Field(
        None, description="relative error that all rates share", examples=["1 ppm"]
    )
    scale: str | None = Field(
        None, description="scale factor uncertainty of the sensor", examples=["20 ppm"]
    )
    k2: str | None = Field(
        None, description="quadratic term of the sensor", examples=["0 µg/g² ± 1 µg/g²"]
    )
    stretch: bool = Field(False, description="whether the stretch is estimated")


class RateSection(Section):
    """Section [measurement] for rates, measured with a counter."""

    file: str = Field(examples=["counts.csv"])
    rate: Column = "rate"
    rate_unit: str = "rpm"
    turns: Column = "turns"
    seconds: Column = "seconds"
    timer: str = Field(description="standard deviation of one time stamp", examples=["10 µs"])
    timebase: str = Field("0 ppm", examples=["0.1 ppm"])


class GravitySection(Section):
    """Section [measurement] for gravity."""

    by: Literal["absolute", "network", "computed"]
    gravity: str | None = Field(
        None, description="gravity at the measured point", examples=["9.80123 m/s² ± 0.1 µm/s²"]
    )
    file: str | None = Field(None, examples=["gravimeter.csv"])
    site: Column = "site"
    hours: Column = "hours"
    reading: Column = "reading"
    reading_unit: str = "mGal"
    reading_sd: str | None = Field(None, examples=["5 µGal"])
    scale: str = Field("0 %", examples=["0.01 %"])
    latitude: str | None = Field(None, examples=["48.1 °"])
    height: str | None = Field(None, description="height above sea level", examples=["520 m"])
    above: str = Field(
        "0 m", description="height of the sensor above the point", examples=["1.2 m"]
    )
    gradient: str | None = Field(None, examples=["3.086 µm/s²/m ± 0.1 µm/s²/m"])
    tide: Literal["corrected", "in the uncertainty"] = "in the uncertainty"


class AzimuthSection(AngleReadingSection):
    """Section [measurement] for an azimuth, measured with a gyro whose input axis is level."""

    reading_unit: str = "°/h"
    reading_sd: str = Field(description="standard deviation of one reading", examples=["0.01 °/h"])
    latitude: str = Field(examples=["48.1 °"])
    offset: str = Field(
        description="angle of the input axis from the body's y axis", examples=["0 ° ± 0.01 °"]
    )
    scale: str = Field("1 %", examples=["0.1 %"])


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
