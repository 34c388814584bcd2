"""Read recordings with one file per section: "rest_*.csv" means rest_x_p.csv, rest_x_a.csv, ….

The text in place of the star is the label of all samples in a file. If the times of the files do
not overlap, the files are assumed to have the same clock. Otherwise each file has its own times,
and the files are placed one after the other, because the true time between them is unknown.
"""

from collections.abc import Mapping, Sequence
from contextlib import closing
from dataclasses import replace
from hashlib import sha256
from itertools import pairwise
from pathlib import Path

import numpy as np

from inercal.basics.arrays import Array
from inercal.basics.errors import InputError
from inercal.recordings import Finding, Recording
from inercal.recordings.io.audit import audit, audit_rows, require_accepted
from inercal.recordings.io.file_patterns import matching_files
from inercal.recordings.io.read import read_each
from inercal.recordings.io.table_recording import Columns

NAMED = "*"
"""Value of [data] temperature if the temperature stands in place of the star."""
_PAUSE_S = 1.0  # between files that have their own times


def read_sections(
    pattern: Path, columns: Columns, limits: Mapping[str, tuple[float, float]] | None = None
) -> Recording:
    """Read the files that match a pattern as one audited recording, with their labels.

    Parameters
    ----------
    pattern : Path
    columns : Columns
        Contents of the columns in each file, without `label` and `second`.
    limits : mapping of channel to (lowest, highest), optional
        See `inercal.recordings.io.audit.audit`.

    Raises
    ------
    InputError
        There is no file, a file cannot be read, or the audit refuses the recording.
    """
    for key, stated in (("label", columns.label), ("gyro_file", columns.second or None)):
        if stated is not None:
            raise InputError(
                f"{pattern}: with one file per section, [data] {key} has no effect; remove {key}",
                file=pattern,
                key=f"[data] {key}",
            )
    parts: dict[str, Recording] = {}
    named = columns.temperature == NAMED
    columns = replace(columns, temperature=None) if named else columns
    files = matching_files(pattern)
    with closing(read_each(files.values(), columns)) as recordings:
        for (label, path), read in zip(files.items(), recordings, strict=True):
            if named:
                read = replace(read, temperature=_named_temperature(label, path, read, columns))
            # Channels may be constant in a short rest, so audit them only after joining the files.
            parts[label] = require_accepted(audit_rows(read, columns.nonfinite, in_place=True))
    joined = _join(pattern.name, parts)
    return require_accepted(audit(joined, columns.nonfinite, limits, in_place=True))


def _named_temperature(label: str, path: Path, read: Recording, columns: Columns) -> Array:
    """Return the temperature that stands in a name in place of the star, for each sample, K."""
    try:
        value = float(label.replace("−", "-"))
    except ValueError:
        raise InputError(
            f'{path}: [data] temperature = "{NAMED}", but the star stands for {label!r}, which is '
            "no number: put only the temperature in place of the star",
            file=path,
            key="[data] temperature",
            names=(label,),
        ) from None
    kelvin = columns.thermometer.possible_kelvin(
        np.array([value]), NAMED, lambda _: "its name", str(path)
    )
    return np.repeat(kelvin, read.time.size)


def _join(source: str, parts: Mapping[str, Recording]) -> Recording:
    """Join the samples of all files, in time order if their times do not overlap."""
    ordered = sorted(parts.items(), key=lambda one: float(one[1].time[0]))
    some = [part for _, part in ordered]
    findings = [
        replace(finding, message=f"{part.source}: {finding.message}", start=None, stop=None)
        for part in some
        for finding in part.findings
        if finding.severity == "warning" and finding.what == "nonfinite"
    ]
    start = float(some[0].time[0])  # negative if a file with later times was read first
    times = [part.time - start for part in some]
    first_stamp = some[0].first_stamp + start
    if any(one[-1] >= two[0] for one, two in pairwise(times)):
        ordered = list(parts.items())
        some = [part for _, part in ordered]
        times, first_stamp = _one_after_the_other(times), 0.0
        text = (
            f"the {len(some)} files of {source} each have their own times, so they are placed "
            f"one after the other, {_PAUSE_S:g} s apart: the true time between them is unknown"
        )
        findings.append(Finding("note", "sections", text))
    digest = sha256("".join(f"{label} {part.sha256}\n" for label, part in ordered).encode())
    temperatures = [part.temperature for part in some if part.temperature is not None]
    texts = dict.fromkeys(part.kept_corrections for part in some if part.kept_corrections)
    return replace(
        some[0],
        time=np.concatenate(times),
        data=np.concatenate([part.data for part in some]),
        labels=np.repeat([label for label, _ in ordered], [t.size for t in times]),
        temperature=np.concatenate(temperatures) if temperatures else None,
        readback={
            name: np.concatenate([part.readback[name] for part in some])
            for name in some[0].readback
        },
        findings=tuple(findings),
        source=source,
        sha256=digest.hexdigest(),
        first_row=0,
        line_breaks=(),
        original=None,
        origin=None,
        first_stamp=first_stamp,
        kept_corrections="; ".join(texts),
        simulation=next((part.simulation for part in some if part.simulation), ""),
    )


def _one_after_the_other(times: Sequence[Array]) -> list[Array]:
    """Return the times of the files, shifted so that each file starts after the preceding one."""
    moved: list[Array] = []
    start = 0.0
    for time in times:
        moved.append(time - time[0] + start)
        start = float(moved[-1][-1]) + _PAUSE_S
    return moved
