"""[data] of a run file: what every kind of bench has. Values with units are text: "100 Hz"."""

from typing import Any, Literal, NamedTuple

from pydantic import Field, model_validator

from inercal.errors import InputError
from inercal.section_settings import Section
from inercal.units import parse_quantity, si_factor


class ReadbackColumn(NamedTuple):
    """A column in which a bench states something of itself: its name, and the SI size of a unit."""

    name: str
    column: str
    size: float


class DataSection(Section):
    """[data]: the file and its columns, by header name or by number counted from 1.

    Keys that every kind of bench has; a kind adds its own.
    """

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
    nonfinite: Literal["refuse", "drop"] = "refuse"
    sd: dict[Literal["accelerometer", "gyro"], str] = Field(
        default_factory=dict[Literal["accelerometer", "gyro"], str],
        description="of means: the standard deviation of each",
        examples=[{"accelerometer": "30 µg", "gyro": "5 °/h"}],
    )
    seconds: str | int | None = Field(None, description="of means: column of durations, s")

    @model_validator(mode="after")
    def _counters_have_a_column(self) -> "DataSection":
        counts = self.time is not None and self.time_unit == "sample"
        if self.counter_modulus is not None and not counts:
            raise ValueError(
                "counter_modulus goes with a counter: name its column, time, and state "
                'time_unit = "sample"'
            )
        return self

    @model_validator(mode="after")
    def _means_are_one_table(self) -> "DataSection":
        if self.kind == "means" and self.gyro_file is not None:
            raise ValueError("gyro_file goes with a recording; means of all axes are one table")
        signed = [c for c in (*self.accelerometer, *self.gyro) if str(c).startswith("-")]
        if self.kind == "means" and signed:
            raise ValueError(
                f'"{signed[0]}" reverses a column of a recording; in a table of means write the '
                "readings with their signs"
            )
        return self

    @property
    def row(self) -> str | int | None:
        """The column that names the rows, or the sections of a recording."""
        return self.label

    @property
    def moving_sections(self) -> tuple[str, ...]:
        """The marked sections that count as rests though they move."""
        return ()

    def readback(self, bench: Any) -> tuple[ReadbackColumn, ...]:
        """Return the columns in which a bench states its rates, angles and levels.

        Raises
        ------
        InputError
            A unit that is none of such a quantity.
        """
        return ()

    def further_files(self) -> dict[str, str]:
        """Return the further files that are named, by what they are, such as "readback"."""
        return {}


class RestsSection(DataSection):
    """[data] of a bench that rests in marked sections."""

    accept_moving: tuple[str, ...] | None = Field(
        None,
        description="marked sections that count as rests though their mean changes within them",
        examples=[["p11"]],
    )

    @model_validator(mode="after")
    def _means_do_not_move(self) -> "RestsSection":
        if self.kind == "means" and self.accept_moving is not None:
            raise ValueError("accept_moving goes with a recording; leave it out")
        return self

    @property
    def moving_sections(self) -> tuple[str, ...]:
        """The marked sections that count as rests though they move."""
        return self.accept_moving or ()


def unit_size(unit: str, like: str, key: str) -> float:
    """Return the SI size of a unit, or of a size such as "0.5 rev/s"; a complaint names `key`.

    Raises
    ------
    InputError
        Another unit, or a size that is not positive.
    """
    try:
        size = parse_quantity(unit, like).value if unit[:1].isdigit() else si_factor(unit, like)
    except InputError as error:
        raise InputError(f"[data] {key}: {error}") from None
    if size <= 0:
        raise InputError(f"[data] {key}: {unit!r} must be positive")
    return size
