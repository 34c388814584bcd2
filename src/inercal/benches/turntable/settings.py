"""Define [bench] and [data] for a turntable, and build the bench in SI."""

from pathlib import Path
from typing import Literal

from pydantic import Field, model_validator

from inercal.basics.units import format_count
from inercal.benches.key_declarations import add_bench_keys, build_bench
from inercal.benches.motion_control import AxisMotionLimits
from inercal.benches.turntable.bench import StillTable, Turntable
from inercal.physics.section_settings import (
    PLANNING,
    BenchSection,
    BenchUsage,
    key_error,
    measured_constant,
    section_constant,
    section_harmonics,
    si_value,
)
from inercal.recordings.data import DataSection, ReadbackColumn, unit_size

_WIDEST_AZIMUTH = 0.0873  # rad
_LONGEST_LEVER = 1.0  # m
HOLD_COLUMN = "hold"  # name of the readback with the numbers of the holds
_ANGLE_KEYS = ("azimuth", "lean", "square", "harmonics", "noise", "latency", "clock")
_READBACK_KEYS = ("table", "table_unit", "table_file", "table_time", "table_time_unit", "hold")


@add_bench_keys(Turntable, after={"harmonics": "square", "lever": "clock"})
class TurntableSection(BenchSection):
    """Section [bench] for a turntable with one to three axes."""

    kind: Literal["turntable"]
    readback: bool = Field(
        True,
        description="whether the angles of the axes are read; recordings then contain them",
        json_schema_extra=PLANNING,
    )
    axes: str = Field("zxy", description="body axes that the axes turn about, outermost first")
    azimuth: str = "0 ° ± 0.1 °"
    harmonics: tuple[str, ...] = ("2 ″", "1 ″")
    lever: tuple[str, str, str] = Field(("0 mm", "0 mm", "0 mm"), json_schema_extra=PLANNING)
    rate: tuple[str, ...] = Field(
        ("30 °/s",), description="limit for all axes, or for each", json_schema_extra=PLANNING
    )
    acceleration: tuple[str, ...] = Field(("30 °/s²",), json_schema_extra=PLANNING)
    jerk: tuple[str, ...] = Field(
        (),
        description="limit; without it the rate has a trapezoidal profile",
        examples=[["100 °/s³"]],
        json_schema_extra=PLANNING,
    )

    def unused_keys(self, use: BenchUsage) -> dict[str, str]:
        """Return the keys that have no effect on the result in this use, each with the reason."""
        if not use.angles:
            angles = tuple(key for key in _ANGLE_KEYS if key in use.qualified)
            if angles and not self.readback:
                raise key_error(
                    "[bench] qualification",
                    f"it states {', '.join(angles)} in place of keys, but with readback = false "
                    "they have no effect; remove the file that states them",
                    names=angles,
                )
            return dict.fromkeys(_ANGLE_KEYS, f"{use.method} does not use the angles of the table")
        if not self.readback:
            raise key_error(
                "[bench] readback",
                f"method {use.method} uses the angles of the table, and readback = false states "
                "that there are none; record them and remove readback, or choose method "
                "systematic, which needs three gyros and three accelerometers",
                names=(use.method,),
            )
        if self.latitude is not None:
            si_value(self.latitude, "°", "[bench] latitude")  # refuses an uncertainty
        return {}


class TurntableData(DataSection):
    """Section [data] for a turntable: a recording, with the angles of the axes."""

    table: tuple[str | int, ...] | None = Field(
        None, description="columns of the axes' readback, outermost first"
    )
    table_unit: str = "°"
    table_file: str | None = Field(
        None,
        description="file of that readback, if it is a separate file with its own clock",
        examples=["table.csv"],
    )
    table_time: str | int | None = Field(None, description="time column in that file")
    table_time_unit: str = "s"
    sample: Literal["instant", "mean"] = Field(
        "instant",
        description="whether a sample is the reading at its time or the mean over one period, as "
        "from an IMU that integrates; for method systematic",
    )
    hold: str | int | None = Field(
        None,
        description="column with the number of each hold, negative elsewhere, as written by a "
        "bench host; holds are then not detected",
        examples=["hold"],
    )

    @model_validator(mode="after")
    def _files_have_a_clock(self) -> "TurntableData":
        if self.table_file is None and self.table_time is not None:
            raise ValueError("table_time is a column of table_file; add table_file or remove it")
        if self.table_file is not None and self.table_time is None:
            raise ValueError(
                "table_file also needs table_time, which names its time column; add table_time = "
                '"time"'
            )
        if self.table_file is not None and self.hold is not None:
            raise ValueError(
                "hold names a column of the recording, but table_file contains the angles; remove "
                "hold"
            )
        return self

    def readback(self, bench: Turntable | StillTable) -> tuple[ReadbackColumn, ...]:
        """Return the columns with the axes' angles: those in `table`, or else the axes' names.

        Raises
        ------
        InputError
            The number of columns differs from the number of axes, or the unit is not an angle unit.
        """
        if isinstance(bench, StillTable) or not bench.readback:
            return ()
        columns = self.table or bench.names
        if len(columns) != len(bench.names):
            raise key_error(
                "[data] table",
                f"{format_count(len(columns), 'column')} for the {len(bench.names)} axes "
                f"{', '.join(bench.names)}; name one column for each axis",
                names=tuple(map(str, columns)),
            )
        size = unit_size(self.table_unit, "°", "table_unit")
        found = [
            ReadbackColumn(name, text.removeprefix("-"), -size if text.startswith("-") else size)
            for name, text in zip(bench.names, map(str, columns), strict=True)
        ]
        if self.hold is not None:
            found.append(ReadbackColumn(HOLD_COLUMN, str(self.hold), 1.0))
        return tuple(found)

    def unused_keys(self, use: BenchUsage) -> dict[str, str]:
        """Return the keys of the readback if the method does not use angles."""
        if use.angles:
            return {}
        return dict.fromkeys(_READBACK_KEYS, f"{use.method} does not use the angles of the table")

    def further_files(self) -> dict[str, str]:
        """Return the file of the readback, if there is a separate one."""
        return {} if self.table_file is None else {"readback": self.table_file}


def build(section: TurntableSection, folder: Path) -> Turntable:
    """Build the bench in SI from its section; the files that it names are in `folder`."""
    if section.latitude is None:
        raise key_error(
            "[bench] latitude", "is missing; add it, because the gyros measure the earth's rate"
        )
    x, y, z = (
        measured_constant(arm, "m", "[bench] lever", last_digit=False) for arm in section.lever
    )
    if not all(abs(arm.value) + 2 * arm.sd <= _LONGEST_LEVER for arm in (x, y, z)):
        raise key_error(
            "[bench] lever",
            f"{', '.join(section.lever)}: each component must be at most 1 m, the distance from "
            "the intersection of the axes to the IMU",
        )
    azimuth, place = (section_constant(section, key, "°") for key in ("azimuth", "latitude"))
    if azimuth.sd > _WIDEST_AZIMUTH:
        raise key_error(
            "[bench] azimuth",
            f"the standard uncertainty of {section.azimuth!r} exceeds 5°, the limit of the linear "
            'model; measure the azimuth better, or use bench kind = "rate_platform" with method '
            "rates_and_poses, which needs no azimuth, if the table turns only about the vertical",
        )
    return build_bench(
        Turntable,
        section,
        latitude=place.value,
        place=place,
        azimuth=azimuth,
        axes=section.axes,
        readback=section.readback,
        harmonics=section_harmonics(section, "harmonics"),
        lever=(x, y, z),
        limits=_limits(section),
    )


def _limits(section: TurntableSection) -> tuple[AxisMotionLimits, ...]:
    """Return one limit for all axes, or one per axis if a key has several values."""
    likes = {"rate": "°/s", "acceleration": "°/s²", "jerk": "°/s³"}
    stated: dict[str, tuple[str, ...]] = {name: getattr(section, name) for name in likes}
    axes = max(map(len, stated.values()))
    each: dict[str, list[float | None]] = {}
    for name, texts in stated.items():
        values = [si_value(text, likes[name], f"[bench] {name}") for text in texts]
        if not values and name == "jerk":
            each[name] = [None] * axes
        elif len(values) in (1, axes):
            each[name] = [*values] * (axes // len(values))
        else:
            raise key_error(
                f"[bench] {name}",
                f"{format_count(len(values), 'limit')}; give one for all axes or one per axis",
            )
    result: list[AxisMotionLimits] = []
    for rate, acceleration, jerk in zip(*each.values(), strict=True):
        assert rate is not None  # only the jerk may be unlimited
        assert acceleration is not None
        result.append(AxisMotionLimits(rate, acceleration, jerk))
    return tuple(result)
