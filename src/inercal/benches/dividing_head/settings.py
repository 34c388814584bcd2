"""Define [bench] and [data] for a dividing head, and build the bench in SI."""

from pathlib import Path
from typing import Literal

import numpy as np
from pydantic import Field

from inercal.basics.errors import InputError, error_location
from inercal.benches.dividing_head.bench import DividingHead
from inercal.benches.key_declarations import add_bench_keys, build_bench
from inercal.physics.section_settings import (
    BenchSection,
    BenchUsage,
    key_error,
    section_harmonics,
    si_value,
)
from inercal.recordings.data import ReadbackColumn, RestsSection, unit_size
from inercal.recordings.io.read import read_table

_FEWEST_FACES = 3  # a polygon has at least this many faces


@add_bench_keys(DividingHead, after={"autocollimation": "division", "polygon": "autocollimator"})
class DividingHeadSection(BenchSection):
    """Section [bench] for a dividing head with a level spindle."""

    kind: Literal["dividing_head"]
    harmonics: tuple[str, ...] = ("1 ″", "1 ″")
    autocollimation: Literal["pairs", "every", "none"] = "none"
    polygon: str | None = Field(
        None, description="file of the certificate, with one row per face", examples=["polygon.csv"]
    )
    polygon_unit: str = Field("″", examples=["µrad"])

    def unused_keys(self, use: BenchUsage) -> dict[str, str]:
        """Return the keys that have no effect on the result in this use, each with the reason."""
        found: dict[str, str] = {}
        if self.polygon is None:
            found["polygon_unit"] = "there is no polygon"
        if self.autocollimation == "none":
            words = 'autocollimation is "none"'
            found |= {"autocollimator": words, "certificate": words}
        elif self.autocollimation == "every":
            words = 'autocollimation = "every" does not use the head\'s angle'
            found |= {"harmonics": words, "division": words}
        return found


class DividingHeadData(RestsSection):
    """Section [data] for a dividing head, in which each row is a position."""

    accelerometer: tuple[str | int, ...] = Field(examples=[["a", "b"]])
    angle: str | int = Field(description="column of the head's angle", examples=["angle"])
    angle_unit: str = "°"
    autocollimator: str | int | None = Field(
        None, description="column of the autocollimator's reading beyond the angle"
    )
    autocollimator_unit: str = "″"
    level: str | int | None = Field(None, description="column of a level on the head's base")
    level_unit: str = "″"
    warm_up_band: str | None = Field(
        None, description="largest difference from the last reading after the warm-up time"
    )

    def readback(self, bench: DividingHead) -> tuple[ReadbackColumn, ...]:
        """Return the columns with the head's angle, the autocollimator and the level."""
        return tuple(
            ReadbackColumn(
                name,
                str(getattr(self, name)),
                unit_size(getattr(self, f"{name}_unit"), "°", f"{name}_unit"),
            )
            for name in ("angle", "autocollimator", "level")
            if getattr(self, name) is not None
        )


def build(section: DividingHeadSection, folder: Path) -> DividingHead:
    """Build the bench in SI from its section; the files that it names are in `folder`."""
    polygon: tuple[float, ...] = ()
    if section.polygon is not None:
        if section.autocollimation == "none":
            raise key_error(
                "[bench] polygon",
                'autocollimation is "none", which reads no face; state "pairs" or "every"',
            )
        polygon = _read_polygon(folder / section.polygon, section.polygon_unit)
    return build_bench(
        DividingHead,
        section,
        harmonics=section_harmonics(section, "harmonics"),
        collimated=section.autocollimation,
        polygon=polygon,
    )


def _read_polygon(path: Path, unit: str) -> tuple[float, ...]:
    """Read the certified deviation of each face, rad.

    Raises
    ------
    InputError
        The table has no columns `face` and `deviation`, or its faces are not 1 to n in order.
    """
    key = "[bench] polygon"
    with error_location(key, file=path, key=key):
        table = read_table(path)
    for name in ("face", "deviation"):
        if name not in table.columns:
            raise InputError(
                f"{key}: {path.name} has no column {name!r}; its columns are "
                f"{', '.join(table.columns)}; name the two columns face and deviation",
                file=path,
                key=key,
                names=(name,),
            )
    face, deviation = table.numbers("face"), table.numbers("deviation")
    bad = np.flatnonzero((face != np.arange(1, len(face) + 1)) | ~np.isfinite(deviation))
    if bad.size or len(face) < _FEWEST_FACES:
        line = table.line(int(bad[0])) if bad.size else None
        where = table.place(int(bad[0])) if bad.size else f"{len(face)} faces"
        raise InputError(
            f"{key}: {path.name}, {where}: the faces are not numbered 1, 2, 3, …, or a deviation "
            f"is missing; give each of {_FEWEST_FACES} or more faces one line, in the order of "
            "reading",
            file=path,
            line=line,
            key=key,
        )
    size = si_value(f"1 {unit}", "°", "[bench] polygon_unit")
    return tuple((size * deviation).tolist())
