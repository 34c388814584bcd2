"""Read the input file of a qualification, which has [qualification] and [measurement]."""

import datetime as dt
from collections.abc import Mapping, Sequence
from dataclasses import replace
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import Any, Literal, cast

import numpy as np
from pydantic import Field, ValidationError

from inercal.basics.documents import attributes
from inercal.basics.errors import InputError, error_location
from inercal.basics.small_files import is_file, read_toml
from inercal.benches.kind_definition import KINDS
from inercal.benches.qualification.linear_fit import MeasuredParameters
from inercal.benches.qualification.measure import MEASUREMENTS, MeasurementInput
from inercal.benches.qualification.result import (
    ANY_BENCH,
    Qualification,
    QualifiedParameter,
    determination_sha256,
    load,
    require_covariance,
)
from inercal.physics.section_settings import Section, key_error, optional
from inercal.recordings.io.column_table import file_sha256, shorten

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


def qualify(path: str | Path) -> Qualification:
    """Return the qualification that an input file describes.

    Parameters
    ----------
    path : path
        Path of the input file. Files that it names are relative to its folder.

    Raises
    ------
    InputError
        The input file or a file that it names cannot be used, or the measurement does not determine
        the parameters.
    """
    path = Path(path)
    content = read_toml(path, "input file of a qualification")
    with error_location(path):
        return _qualify(path, content)


def input_files(path: str | Path) -> list[Path]:
    """Return the input file and the existing files that it names."""
    path = Path(path)
    named = _texts(read_toml(path, "input file of a qualification"))
    return [path, *(path.parent / one for one in named if is_file(path.parent / one))]


def _texts(content: object) -> list[str]:
    if isinstance(content, str):
        return [content]
    if isinstance(content, dict):
        content = list(cast(dict[str, object], content).values())
    if isinstance(content, list):
        return [text for one in cast(list[object], content) for text in _texts(one)]
    return []


def _qualify(path: Path, content: Mapping[str, Any]) -> Qualification:
    if unknown := sorted(content.keys() - {"qualification", "measurement"}):
        raise key_error(
            f"[{unknown[0]}]", "is not known; there are [qualification] and [measurement]"
        )
    head = _validated("qualification", content.get("qualification"), QualificationSection)
    assert isinstance(head, QualificationSection)
    section = _validated("measurement", content.get("measurement"), SECTIONS[head.kind])
    bench = _bench_kind(head)
    if head.valid_until is not None and head.valid_until < head.date:
        raise key_error("[qualification] valid_until", "is before date; correct one of them")
    uses = [load(path.parent / one) for one in head.uses]
    given = MeasurementInput(section, path.parent, bench, uses)
    found = MEASUREMENTS[head.kind](given)
    for file, one in zip(head.uses, uses, strict=True):
        if not set(one.names) & set(found.names):
            raise key_error(
                "[qualification] uses", f"{file} has no effect on the result; remove it"
            )
    return _assembled(path, head, bench, uses, found)


def _bench_kind(head: QualificationSection) -> str:
    key = "[qualification] bench"
    if head.kind == "gravity":
        if head.bench or head.name:
            raise key_error(key, "gravity is the same for all benches at a place; remove bench")
        return ANY_BENCH
    if head.bench not in KINDS:
        raise key_error(
            key, f"{head.bench!r} is not a kind of bench; give one of {', '.join(KINDS)}"
        )
    return head.bench


def _validated(name: str, content: object, section: type[Section]) -> Section:
    if not isinstance(content, dict):
        raise key_error(f"[{name}]", "is missing")
    try:
        return section.model_validate(content)
    except ValidationError as error:
        first = error.errors()[0]
        key = f"[{name}] {'.'.join(map(str, first['loc']))}"
        known = ", ".join(section.model_fields)
        context = first.get("ctx", {})
        given = shorten(repr(first["input"]))
        text = {
            "missing": "is missing; state it",
            "extra_forbidden": f"is not known; the keys are {known}",
            "literal_error": f"{given} is not possible; give {context.get('expected')}",
        }.get(first["type"], f"{given}: {first['msg'][0].lower()}{first['msg'][1:]}")
        raise InputError(f"{key}: {text}", key=key) from None


def _assembled(
    path: Path,
    head: QualificationSection,
    bench: str,
    uses: Sequence[Qualification],
    found: MeasuredParameters,
) -> Qualification:
    """Assemble the qualification, with the parameters of earlier determinations first."""
    earlier = {one.name: one for other in uses for one in other.parameters}
    order = sorted(range(len(found.names)), key=lambda k: found.names[k] not in earlier)
    names = tuple(found.names[k] for k in order)
    covariance = found.covariance[np.ix_(order, order)]
    require_covariance(covariance, names, "the measurement")
    value = [float(found.value[k]) for k in order]
    place = ("", "") if bench == ANY_BENCH else (bench, head.name)
    numbers = [value, covariance.tolist()]
    own = determination_sha256(place, names, numbers, head.date, head.method)
    new = QualifiedParameter("", "", 0.0, own, head.date, head.valid_until)
    parameters = tuple(
        replace(earlier.get(name, new), name=name, unit=found.unit[k], value=value[i])
        for i, (k, name) in enumerate(zip(order, names, strict=True))
    )
    provenance = {
        "input file": path.name,
        **{f"{one.name} sha256": file_sha256(one) for one in input_files(path)},
        "created": datetime.now(UTC).isoformat(timespec="seconds"),
        "inercal": version("inercal"),
    }
    return Qualification(
        **attributes(head, "kind date valid_until method instrument certificate"),
        **attributes(found, "chi2 dof p_value suspects unseen remarks"),
        bench=bench,
        bench_name=head.name,
        determination=own,
        parameters=parameters,
        covariance=covariance,
        provenance=provenance,
    )
