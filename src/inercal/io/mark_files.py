"""Marks of sections from a file: JSON or a table."""

import json
from pathlib import Path
from typing import Any, cast

import numpy as np

from inercal.errors import InputError
from inercal.io.read import read_table
from inercal.recording import Mark, Recording


def marks_from_file(path: Path) -> tuple[Mark, ...]:
    """Read marks from JSON, {"x_p": {"start": 540, "end": 1271}, …}, or a table label, start, end.

    Raises
    ------
    InputError
        The file is neither, or an entry is not a pair of sample numbers.
    """
    if path.suffix.lower() == ".json":
        entries: Any
        try:
            text = path.read_text(encoding="utf-8")
            entries = json.loads(text, object_pairs_hook=_unique_keys)
        except FileNotFoundError:
            raise InputError(f"{path}: no such file of marks") from None
        except (OSError, ValueError, RecursionError) as error:
            raise InputError(f"{path}: not a JSON file of marks: {error}") from None
        if not isinstance(entries, dict):
            raise InputError(f'{path}: expected an object {{"label": {{"start": …, "end": …}}}}')
        labelled = cast(dict[str, object], entries)
        return tuple(_mark(path, label, entry) for label, entry in labelled.items())
    table = read_table(path, text=("label",))
    missing = [name for name in ("label", "start", "end") if name not in table.columns]
    if missing:
        raise InputError(
            f"{path}: no column {missing[0]!r}; a table of marks has label, start, end "
            "(sample numbers, the end not included)"
        )
    rows = zip(*(table.columns[name] for name in ("label", "start", "end")), strict=True)
    return tuple(_mark(path, str(a), {"start": b, "end": c}) for a, b, c in rows)


def _unique_keys(pairs: list[tuple[str, object]]) -> dict[str, object]:
    """Return the object, refusing a name that comes twice, which JSON would let pass."""
    names = [name for name, _ in pairs]
    for name in names:
        if names.count(name) > 1:
            raise ValueError(f"{name!r} comes twice")
    return dict(pairs)


def _mark(path: Path, label: str, entry: object) -> Mark:
    try:
        start, end = (float(entry[key]) for key in ("start", "end"))  # type: ignore[index]
    except (TypeError, KeyError, ValueError):
        raise InputError(f"{path}: mark {label!r} needs numbers 'start' and 'end'") from None
    if not (start.is_integer() and end.is_integer()):
        raise InputError(f"{path}: mark {label!r}: start and end are sample numbers, not {entry}")
    return Mark(label, int(start), int(end))


def marks_after_audit(marks: tuple[Mark, ...], recording: Recording) -> tuple[Mark, ...]:
    """Return marks of the file's samples as marks of the recording's, where the audit dropped some.

    Raises
    ------
    InputError
        The audit has put samples in another order: numbers in the file then mark nothing.
    """
    original = recording.original
    if original is None:
        return marks
    if (np.diff(original) <= 0).any():
        raise InputError(
            f"{recording.source}: samples were put in the order of time, so that sample numbers "
            'in a file of marks no longer fit; use a label column, marks = "labels"'
        )
    limits = np.array([(mark.start, mark.stop) for mark in marks])
    # Beyond both ends numbers run on, so that a mark outside the file stays outside.
    beyond = np.maximum(limits - (int(original[-1]) + 1), 0) + np.minimum(limits, 0)
    moved = (np.searchsorted(original, limits) + beyond).tolist()
    return tuple(Mark(m.label, a, b) for m, (a, b) in zip(marks, moved, strict=True))
