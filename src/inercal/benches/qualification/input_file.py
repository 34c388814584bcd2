"""The input file of a qualification: TOML with the sections [qualification] and [measurement]."""

from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import Any, cast

import numpy as np
from pydantic import ValidationError

from inercal.basics.errors import InputError
from inercal.basics.small_files import read_toml
from inercal.benches.kinds import KINDS
from inercal.benches.qualification.input_sections import SECTIONS, QualificationSection
from inercal.benches.qualification.measure import MEASUREMENTS, MeasurementInput
from inercal.benches.qualification.measurements.measured_parameters import MeasuredParameters
from inercal.benches.qualification.qualification_file import determination_sha256, load
from inercal.benches.qualification.result import (
    ANY_BENCH,
    Qualification,
    QualifiedParameter,
    require_covariance,
)
from inercal.physics.section_settings import Section, key_error
from inercal.recordings.io.column_table import file_sha256, shorten


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
    try:
        return _qualify(path, content)
    except InputError as error:
        raise error.located(path) from None


def input_files(path: str | Path) -> list[Path]:
    """Return the input file and the existing files that it names."""
    path = Path(path)
    named = _texts(read_toml(path, "input file of a qualification"))
    return [path, *(path.parent / one for one in named if _is_file(path.parent / one))]


def _texts(content: object) -> list[str]:
    if isinstance(content, str):
        return [content]
    if isinstance(content, dict):
        content = list(cast(dict[str, object], content).values())
    if isinstance(content, list):
        return [text for one in cast(list[object], content) for text in _texts(one)]
    return []


def _is_file(path: Path) -> bool:
    try:
        return path.is_file()
    except (OSError, ValueError):
        return False


def _qualify(path: Path, content: Mapping[str, Any]) -> Qualification:
    if unknown := sorted(content.keys() - {"qualification", "measurement"}):
        raise InputError(
            f"[{unknown[0]}] is not known; there are [qualification] and [measurement]",
            key=f"[{unknown[0]}]",
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
        raise InputError(f"[{name}] is missing", key=f"[{name}]")
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
    parameters = tuple(
        QualifiedParameter(
            name,
            found.unit[k],
            value[i],
            earlier[name].determination if name in earlier else own,
            earlier[name].date if name in earlier else head.date,
            earlier[name].valid_until if name in earlier else head.valid_until,
        )
        for i, (k, name) in enumerate(zip(order, names, strict=True))
    )
    provenance = {
        "input file": path.name,
        **{f"{one.name} sha256": file_sha256(one) for one in input_files(path)},
        "created": datetime.now(UTC).isoformat(timespec="seconds"),
        "inercal": version("inercal"),
    }
    return Qualification(
        head.kind,
        bench,
        head.name,
        own,
        head.date,
        head.valid_until,
        head.method,
        head.instrument,
        head.certificate,
        parameters,
        covariance,
        found.chi2,
        found.dof,
        found.p_value,
        found.suspects,
        found.unseen,
        found.remarks,
        provenance,
    )
