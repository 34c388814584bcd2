"""Define [bench] and [data] for a rate platform, and build the bench in SI."""

from pathlib import Path
from typing import Any, ClassVar, Literal

from pydantic import model_validator

from inercal.benches.rate_platform.bench import STATED, RatePlatform
from inercal.physics.section_settings import (
    SMALL_ANGLE,
    BenchSection,
    measured_constant,
    optional,
    positive_value,
    section_deviation,
    section_gravity,
)
from inercal.recordings.data import DataSection, unit_size


class RatePlatformSection(BenchSection):
    """Section [bench] for a table with constant rates and a platform with known angles.

    Errors have no defaults: a run is refused if an error acts but is not stated.
    """

    missing_gravity: ClassVar[str] = "give latitude; gravity replaces it if there are no gyros"

    kind: Literal["rate_platform"]
    rate_scale: str | None = optional("500 ppm")
    rate_asymmetry: str | None = optional("100 ppm")
    rate_stability: str | None = optional("100 ppm")
    angle_reading: str | None = optional("5 ″")
    rate_hysteresis: str | None = optional("1 °/h")
    settling: str | None = optional("1 ppm")
    turn_angle: str | None = optional("0.01 °")
    setting: str | None = optional("0.05 °")
    arm: str | None = optional("5 mm")
    turn_on: str | None = optional("60 °/h")
    attitude: str | None = optional("0.05 °")
    mounting: str | None = optional("0.1 °")


class RatePlatformData(DataSection):
    """Section [data] for a rate platform, in which each row is a rest, a rate or a pose.

    A table of means states them in columns. In a recording, the label of a section describes it.
    """

    accelerometer: tuple[str | int, ...] = optional(
        ["ax", "ay", "az"], default=(), about="columns; none if there are only gyros"
    )
    axis: str | int | None = optional("axis", about="for means: column of the case axis that is up")
    table_rate: str | int | None = optional("rate", about="for means: column of the table's rate")
    table_rate_unit: str = optional("rad/s", default="°/s")
    turn: str | int | None = optional("turn", about="for means: column of the angle of a turn")
    setting: str | int | None = optional(
        about="for means: column of settings; without it each axis is one setting"
    )
    roll: str | int | None = optional("roll", about="for means: column of a pose's roll")
    pitch: str | int | None = optional("pitch", about="for means: column of a pose's pitch")
    angle_unit: str = optional("rad", default="°", about="unit of roll, pitch and turn")

    sections: tuple[str, ...] | None = optional(
        ["x rest", "x +50", "x -50"],
        about="for a recording: its sections in order, in place of the plan",
    )
    settle: str | None = optional(
        "2 s", about="for a recording: time to skip at the beginning of each section"
    )

    @model_validator(mode="after")
    def _each_kind_has_its_keys(self) -> "RatePlatformData":
        for name in ("sections", "settle"):
            if self.kind == "means" and getattr(self, name) is not None:
                raise ValueError(f"{name} is for recordings only; remove it")
        # A recording may name the columns of a worksheet.
        for name, columns in (
            ("table_rate_unit", ("table_rate",)),
            ("angle_unit", ("turn", "roll", "pitch")),
        ):
            if name in self.model_fields_set and not any(getattr(self, one) for one in columns):
                raise ValueError(f"{name} is for the columns {', '.join(columns)}; remove it")
        return self

    @property
    def settling_seconds(self) -> float:
        """The time to leave out at the beginning of each section, s."""
        if self.settle is None:
            return 0.0
        return positive_value(self.settle, "s", "[data] settle")

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
