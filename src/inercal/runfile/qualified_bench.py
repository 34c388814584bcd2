"""Reader for [bench] qualification, which takes values of keys from qualification files."""

from collections.abc import Mapping
from dataclasses import fields, replace
from datetime import UTC, date, datetime
from pathlib import Path
from typing import Any, cast

from inercal.basics.errors import InputError
from inercal.benches import Bench
from inercal.benches.kind_definition import Kind
from inercal.benches.qualification import KEY, NO_QUALIFICATIONS, UsedQualifications
from inercal.benches.qualification.bench_keys import (
    read_qualifications,
    require_parameters,
    with_qualified_keys,
)
from inercal.recordings import Finding
from inercal.runfile.job import JobSection


def with_qualifications(
    content: Mapping[str, Any], kind: Kind[Any, Any], folder: Path
) -> tuple[dict[str, Any], UsedQualifications]:
    """Return the sections with [bench] keys filled in from the qualifications.

    Parameters
    ----------
    content : mapping
        The sections of a run file.
    kind : Kind
        Kind of bench.
    folder : Path
        Folder of the run file.

    Raises
    ------
    InputError
        A file cannot be used for this bench, or a key is also typed in the run file.
    """
    section = content.get("bench")
    if not isinstance(section, dict) or "qualification" not in section:
        return dict(content), NO_QUALIFICATIONS
    stated = cast(dict[str, Any], section)
    used = read_qualifications(stated["qualification"], folder)
    completed, keys = with_qualified_keys(stated, kind, used)
    return {**content, "bench": completed}, replace(used, keys=keys)


def qualified_bench(bench: Bench, used: UsedQualifications) -> Bench:
    """Return the bench with the results of its qualifications.

    Raises
    ------
    InputError
        The bench has no such parameter, or its kind cannot use a qualification.
    """
    if not used.each:
        return bench
    if "qualified" not in {one.name for one in fields(bench)}:
        raise InputError(
            f"{KEY}: this kind of bench cannot use a qualification; remove the key", key=KEY
        )
    result: Any = replace(cast(Any, bench), qualified=used.parameters)
    require_parameters(result, used)
    return result


def check_validity(used: UsedQualifications, job: JobSection | None) -> tuple[Finding, ...]:
    """Return a warning for each qualification that had expired before the measurement.

    If [job] states no date of measurement, today's date is used. An inconsistent qualification also
    causes a warning.

    Parameters
    ----------
    used : UsedQualifications
    job : JobSection or None
    """
    stated = None if job is None else job.last_day
    day = stated or datetime.now(UTC).date()
    found: list[Finding] = []
    for file, one in zip(used.files, used.each, strict=True):
        days = {p.valid_until for p in one.expired_parameters(day)}
        ends = [end for end in days if end is not None]
        if ends:
            found.append(
                Finding("warning", "qualification", _expired(file, min(ends), day, stated))
            )
        if not one.consistent:
            text = f"the qualification {file} is inconsistent with its model: {one.suspects[0]}"
            found.append(Finding("warning", "qualification", text))
    return tuple(found)


def _expired(file: str, end: date, day: date, stated: date | None) -> str:
    when = f"the measurement on {day}" if stated else f"today, {day}"
    return (
        f"the qualification {file} expired on {end}, before {when}: qualify the bench again, or "
        "state a valid qualification"
    )
