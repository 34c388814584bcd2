"""The sections [bench] and [data] for a rate platform, and the bench in SI."""

from pathlib import Path
from typing import Any, Literal

from pydantic import Field, model_validator

from inercal.benches.rate_platform.bench import STATED, RatePlatform
from inercal.physics.section_settings import (
    SMALL_ANGLE,
    BenchSection,
    key_error,
    measured_constant,
    section_deviation,
    section_gravity,
    si_value,
)
from inercal.recordings.data import DataSection, unit_size


class RatePlatformSection(BenchSection):
    """Section [bench] for a table with constant rates and a platform with known angles.

    Errors have no defaults: a run is refused if an error acts but is not stated.
    """

    kind: Literal["rate_platform"]
    rate_scale: str | None = Field(None, examples=["500 ppm"])
    rate_asymmetry: str | None = Field(None, examples=["100 ppm"])
    rate_stability: str | None = Field(None, examples=["100 ppm"])
    angle_reading: str | None = Field(None, examples=["5 ″"])
    rate_hysteresis: str | None = Field(None, examples=["1 °/h"])
    settling: str | None = Field(None, examples=["1 ppm"])
    turn_angle: str | None = Field(None, examples=["0.01 °"])
    setting: str | None = Field(None, examples=["0.05 °"])
    arm: str | None = Field(None, examples=["5 mm"])
    turn_on: str | None = Field(None, examples=["60 °/h"])
    attitude: str | None = Field(None, examples=["0.05 °"])
    mounting: str | None = Field(None, examples=["0.1 °"])


class RatePlatformData(DataSection):
    """Section [data] for a rate platform, in which each row is a rest, a rate or a pose.

    A table of means states them in columns. In a recording, the label of a section describes it.
    """

    accelerometer: tuple[str | int, ...] = Field(
        (), description="columns; none if there are only gyros", examples=[["ax", "ay", "az"]]
    )
    axis: str | int | None = Field(
        None, description="for means: column of the case axis that is up", examples=["axis"]
    )
    table_rate: str | int | None = Field(
        None, description="for means: column of the table's rate", examples=["rate"]
    )
    table_rate_unit: str = Field("°/s", examples=["rad/s"])
    turn: str | int | None = Field(
        None, description="for means: column of the angle of a turn", examples=["turn"]
    )
    setting: str | int | None = Field(
        None, description="for means: column of settings; without it each axis is one setting"
    )
    roll: str | int | None = Field(
        None, description="for means: column of a pose's roll", examples=["roll"]
    )
    pitch: str | int | None = Field(
        None, description="for means: column of a pose's pitch", examples=["pitch"]
    )
    angle_unit: str = Field("°", description="unit of roll, pitch and turn", examples=["rad"])

    sections: tuple[str, ...] | None = Field(
        None,
        description="for a recording: its sections in order, in place of the plan",
        examples=[["x rest", "x +50", "x -50"]],
    )
    settle: str | None = Field(
        None,
        description="for a recording: time to skip at the beginning of each section",
        examples=["2 s"],
    )

    @model_validator(mode="after")
    def _sections_are_of_recordings(self) -> "RatePlatformData":
        for name in ("sections", "settle"):
            if self.kind == "means" and getattr(self, name) is not None:
                raise ValueError(f"{name} is for recordings only; remove it")
        return self

    @property
    def settling_seconds(self) -> float:
        """The time to leave out at the beginning of each section, s."""
        if self.settle is None:
            return 0.0
        seconds = si_value(self.settle, "s", "[data] settle")
        if seconds <= 0:
            raise key_error("[data] settle", f"{self.settle!r} must be positive")
        return seconds

    @property
    def rate_size(self) -> float:
        """The size of the unit of the table's rate in SI."""
        return unit_size(self.table_rate_unit, "rad/s", "table_rate_unit")

    @property
    def angle_size(self) -> float:
        """The size of the unit of roll, pitch and turn in SI."""
        return unit_size(self.angle_unit, "°", "angle_unit")


def build(section: RatePlatformSection, folder: Path) -> RatePlatform:
    """Build the bench in SI from its section; the files that it names are in `folder`."""
    latitude = None
    if section.latitude is not None:
        latitude = measured_constant(section.latitude, "°", "[bench] latitude", last_digit=False)
    stated: dict[str, Any] = {
        name: section_deviation(section, name, one.like, SMALL_ANGLE if one.like == "°" else None)
        for name, one in STATED.items()
        if getattr(section, name) is not None
    }
    return RatePlatform(section_gravity(section), latitude, **stated)
