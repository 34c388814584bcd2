"""Join files with the same columns, one for each pose or temperature, into one recording.

A name with a star stands for the files, as in a run file. The temperature of each file may be part
of its name or of the name of its folder, in place of the star.
"""

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from inercal.basics.errors import InputError
from inercal.pipeline.drafts.column_names import role_of_name
from inercal.pipeline.drafts.column_roles import ColumnRoles, recognise_columns
from inercal.pipeline.drafts.stated_keys import stated_columns
from inercal.recordings.io.column_table import Table
from inercal.recordings.io.file_patterns import matching_files
from inercal.recordings.io.section_files import NAMED

_BEFORE_NUMBER = re.compile(r"[-+−]?[\d.,]*$")
_NUMBER = re.compile(r"[-+−]?\d+(\.\d+)?")
_CELSIUS = re.compile(r"[ _]?(°|deg)?[ _]?(C|c|Celsius|celsius)(?![A-Za-z])")
_PAUSE_STEPS = 50.0  # between the parts in a draft
_STILL = 0.02  # scatter of a part at rest, relative to the range of all parts
_FEWEST_POSES = 6


def recording_name(logs: Sequence[Path]) -> str:
    """Return a name for a recording: its file, its folder, or what the names of its files share."""
    stem = logs[0].resolve().stem.partition("*")[0]
    if len(logs) > 1:
        stem = _shared_begin([log.stem for log in logs]) or logs[0].stem
    return stem.strip(" _-.+") or "recording"


def join_parts(
    files: Sequence[Path], tables: Sequence[Table], values: Mapping[str, Any]
) -> tuple[Path, Table, ColumnRoles]:
    """Return several files with the same columns as one recording.

    The result is the name with a star for the files, their rows, and the roles of the columns.

    Raises
    ------
    InputError
        No name with a star stands for exactly these files.
    """
    heated = None
    if not any(role_of_name(name) == "temperature" for name in tables[0].names):
        heated = _temperature_pattern(files)
    pattern = heated or _pattern(files)
    by_path = dict(zip(files, tables, strict=True))
    labelled = matching_files(pattern)
    ordered = [by_path[file] for file in labelled.values()]
    names = [n for n in ordered[0].names if all(n in one.columns for one in ordered)]
    columns = {name: np.concatenate([one.columns[name] for one in ordered]) for name in names}
    if heated is not None:
        lengths = [one.rows for one in ordered]
        columns[NAMED] = np.repeat([float(one.replace("−", "-")) for one in labelled], lengths)
    table = replace(ordered[0], names=(*columns,), columns=columns, block=None)
    ends = np.cumsum([one.rows for one in ordered])
    edges, spans = ends[:-1], tuple(pairwise([0, *ends.tolist()]))
    stated = stated_columns(values, table, second_file=False)
    first = recognise_columns(ordered[0], stated=stated).single.get("time")
    if first is not None and columns[first].dtype.kind != "U":
        columns[first] = _one_after_the_other(np.split(table.numbers(first), edges))
    roles = recognise_columns(table, stated=stated)
    single = {role: name for role, name in roles.single.items() if role != "label"}
    if heated is not None:
        single["temperature"] = NAMED
        roles = roles.because({"temperature": "it stands in the names, at the star"})
    marks = "found"
    if triad := roles.triads.get("accelerometer"):
        force = table.stack(triad)
        scatter = [part.std(axis=0).max() for part in np.split(force, edges)]
        still = max(scatter) <= _STILL * np.ptp(force, axis=0).max()
        marks = "labels" if still and len(files) >= _FEWEST_POSES else "found"
    rates = _stated_rates(labelled) if "gyro" in roles.triads else ()
    marks = "labels" if rates else marks
    roles = replace(roles, single=single, marks=marks, parts=spans, rates=rates)
    return pattern, table, roles


def _stated_rates(labels: Iterable[str]) -> tuple[float, ...]:
    """Return the rates that labels such as "x_+30" and "x_rest" state; empty if none does."""
    from inercal.benches.rate_platform.sections import Pose, step_of_label

    try:
        steps = [step_of_label(label, 1.0) for label in labels]
    except InputError:
        return ()
    rates = tuple(0.0 if isinstance(step, Pose) else step.rate for step in steps)
    return rates if any(rates) else ()


def _one_after_the_other(times: Sequence[np.ndarray]) -> np.ndarray:
    """Return the times of all parts, with a gap between them as the loader leaves one."""
    moved: list[np.ndarray] = []
    for time in times:
        step = float(np.median(np.diff(time))) if time.size > 1 else 1.0
        start = float(moved[-1][-1]) + _PAUSE_STEPS * step if moved else 0.0
        moved.append(time - time[0] + start)
    return np.concatenate(moved)


def _shared_begin(names: Sequence[str]) -> str:
    same = [len(set(letters)) == 1 for letters in zip(*names, strict=False)]
    return names[0][: [*same, False].index(False)]


def _pattern(files: Sequence[Path]) -> Path:
    """Return the name with a star that stands for exactly these files."""
    folder, names = files[0].parent, [file.name for file in files]
    before = _BEFORE_NUMBER.sub("", _shared_begin(names))
    pattern = folder / f"{before}*{files[0].suffix}"
    same = all(file.parent == folder and file.suffix == files[0].suffix for file in files)
    others = sorted(set(matching_files(pattern).values()) - set(files)) if same else []
    if not same or others:
        why = f"{pattern} also stands for {others[0].name}" if others else "their names differ"
        raise InputError(
            f"{files[0]} and {files[-1]}: {why}; put the files of the recording in a folder of "
            "their own, with names of the same kind",
            file=files[0],
            names=tuple(map(str, files)),
        )
    return pattern


def _temperature_pattern(files: Sequence[Path]) -> Path | None:
    """Return the name with a star in place of each file's temperature; None if there is none.

    The temperature with its unit stands in the names of the files, or in those of their folders.
    """
    in_folder = len({file.name for file in files}) == 1
    varied = [file.parent if in_folder else file for file in files]
    names = [one.name for one in varied]
    if len({one.parent for one in varied}) > 1 or len(set(names)) < len(names):
        return None
    before = _BEFORE_NUMBER.sub("", _shared_begin(names))
    after = _shared_begin([name[::-1] for name in names])[::-1].lstrip("0123456789.,")
    stars = [name[len(before) : len(name) - len(after)] for name in names]
    if not (_CELSIUS.match(after) and all(map(_NUMBER.fullmatch, stars))):
        return None
    pattern = varied[0].with_name(f"{before}*{after}")
    pattern = pattern / files[0].name if in_folder else pattern
    return pattern if set(matching_files(pattern).values()) == set(files) else None
