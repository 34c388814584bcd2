"""Read the rests of a recording from labels or marks, or detect them, and check them.

Labels may use the names that people give to the faces of a case, such as "+Z", "z up", "x_up", "-y"
or "x_a".
"""

import json
import re
from collections.abc import Sequence
from functools import lru_cache, partial
from pathlib import Path
from typing import Any, cast

import numpy as np

from inercal.basics.errors import InputError
from inercal.basics.small_files import read_small_file
from inercal.basics.units import format_count
from inercal.physics.section_settings import key_error
from inercal.recordings import Finding, Mark, Recording, segments
from inercal.recordings.data import DataSection, RestsSection, RunBase
from inercal.recordings.io.read import read_table
from inercal.recordings.segments import RestDetection
from inercal.recordings.segments.motion_thresholds import WINDOW

_SIGNS = {"+": 1, "-": -1, "up": 1, "down": -1, "p": 1, "a": -1, "n": -1, "m": -1}
_WORD = r"\+|-|up|down|pos|neg|plus|minus"
_FACE = re.compile(
    rf"(?P<before>{_WORD})?(?P<axis>[xyz])(axis|face)?(?P<after>{_WORD})?(?P<end>up|down|p|a|n|m)?"
)
_TURN = re.compile(r"(rot|rotation|turn)?([xyz])(rot|rotation|turn)?")


def _letters(text: str) -> str:
    words = re.sub(r"[−–]", "-", text.strip().lower())
    words = re.sub(r"\b(positive|negative)", lambda found: found[0][:3], words)
    return re.sub(r"(?<=up)wards?|(?<=down)wards?|[\s_]+", "", words)


def parse_face(text: str) -> str | None:
    """Return the case axis that is up according to a face's name, or None if it names no face.

    >>> [parse_face(one) for one in ("+Z", "z up", "x_down", "-y", "-y up", "x_a", "p1", "z_")]
    ['z', 'z', '-x', '-y', '-y', '-x', None, None]
    """
    found = _FACE.fullmatch(_letters(text))
    if found is None or text.endswith("_"):  # the sign of a cut label is unknown
        return None
    sign = 1
    for word in (found["before"], found["after"], found["end"]):
        if word is not None:
            sign *= _SIGNS.get(word) or (1 if word in ("pos", "plus") else -1)
    return "-" * (sign < 0) + found["axis"]


@lru_cache
def planned_name(text: str) -> str | None:
    """Return the step of a plan by hand to which a label refers; None if there is none.

    >>> planned_name("z down"), planned_name("turn x"), planned_name("face 3")
    ('z_a', 'x_rot', None)
    """
    if (face := parse_face(text)) is not None:
        return f"{face[-1]}_{'a' if face.startswith('-') else 'p'}"
    found = _TURN.fullmatch(_letters(text))
    return None if found is None else f"{found[2]}_rot"


def check_marked_rests(
    run: RunBase[DataSection], recording: Recording, marks: Sequence[Mark]
) -> tuple[Finding, ...]:
    """Refuse marked rests that move; return warnings for those that the run file accepts.

    Raises
    ------
    InputError
        A marked rest moves; see `inercal.recordings.segments.rest_changes.require_still`.
    """
    return segments.require_still(recording, run.sensor, marks, run.data.moving_sections)


def check_rests(
    run: RunBase[RestsSection], recording: Recording, marks: Sequence[Mark]
) -> tuple[Finding, ...]:
    """Return the findings of `check_marked_rests`; none if the rests were detected.

    Raises
    ------
    InputError
        A rest moves, as in `check_marked_rests`, or the run file accepts moving rests without
        marking them.
    """
    if run.data.marks != "found":
        return check_marked_rests(run, recording, marks)
    if run.data.accept_moving is not None:
        raise key_error(
            "[data] accept_moving",
            "is only for marks that you give, because detected rests do not move; remove "
            "accept_moving",
            run.path,
        )
    return ()


def stated_marks(
    run: RunBase[DataSection], recording: Recording, *, again: bool = False
) -> tuple[Mark, ...]:
    """Return the marked sections, from the recording's labels or from the file of marks.

    Parameters
    ----------
    run : RunBase
    recording : Recording
    again : bool
        Whether the same label may mark several sections.
    """
    if run.data.marks == "labels":
        return segments.marks_from_labels(recording, again=again)
    return marks_after_audit(marks_from_file(run.file(run.data.marks)), recording)


def rests_without_plan(run: RunBase[DataSection], recording: Recording) -> RestDetection:
    """Return the rests that were detected without a plan, or the marked sections."""
    if run.data.marks == "found":
        try:
            return segments.find_rests(recording, run.sensor)
        except InputError as error:
            marks, text = (), str(error)
    else:
        marks = stated_marks(run, recording)
        if run.data.marks != "labels":
            segments.check_marks(marks, recording, [mark.label for mark in marks])
        text = format_count(len(marks), "section is marked", "sections are marked")
    levels = segments.find_thresholds(recording, run.sensor)
    return RestDetection(marks, levels, WINDOW, Finding("note", "rests", text))


def marks_from_file(path: Path) -> tuple[Mark, ...]:
    """Read marks from JSON, {"x_p": {"start": 540, "end": 1271}}, or a table label, start, end.

    Raises
    ------
    InputError
        The file has neither format, or an entry is not a pair of sample numbers.
    """
    if path.suffix.lower() == ".json":
        entries: Any
        try:
            raw = read_small_file(path, "file of marks")
            entries = json.loads(raw.decode("utf-8"), object_pairs_hook=_unique_keys)
        except (ValueError, RecursionError) as error:
            raise InputError(f"{path}: not a JSON file of marks: {error}", file=path) from None
        if not isinstance(entries, dict):
            raise InputError(
                f'{path}: marks must be an object such as {{"x_p": {{"start": 540, "end": 1271}}}}',
                file=path,
            )
        labelled = cast(dict[str, object], entries)
        return tuple(_mark(path, label, entry) for label, entry in labelled.items())
    table = read_table(path, text=("label",))
    missing = [name for name in ("label", "start", "end") if name not in table.columns]
    if missing:
        raise InputError(
            f"{path}: column {missing[0]!r} is missing; the columns of a table of marks are label, "
            "start, end (sample numbers, the end not included)",
            file=path,
            names=tuple(missing),
        )
    rows = zip(*(table.columns[name] for name in ("label", "start", "end")), strict=True)
    return tuple(_mark(path, str(a), {"start": b, "end": c}) for a, b, c in rows)


def _unique_keys(pairs: list[tuple[str, object]]) -> dict[str, object]:
    """Return the object; refuse a name that appears twice, which JSON itself allows."""
    names = [name for name, _ in pairs]
    for name in names:
        if names.count(name) > 1:
            raise ValueError(f"{name!r} appears twice; give each mark its own name")
    return dict(pairs)


def _number(given: Any) -> float:
    if isinstance(given, bool):
        raise TypeError(given)
    return float(given)


def _mark(path: Path, label: str, entry: object) -> Mark:
    refusal = partial(InputError, file=path, names=(label,))
    try:
        start, end = (_number(entry[key]) for key in ("start", "end"))  # type: ignore[index]
    except (TypeError, KeyError, ValueError):
        raise refusal(
            f"{path}: mark {label!r} does not state the numbers 'start' and 'end'; add them"
        ) from None
    if not (start.is_integer() and end.is_integer()):
        raise refusal(
            f"{path}: mark {label!r}: start and end must be whole sample numbers, not {start:g} "
            f"and {end:g}"
        )
    return Mark(label, int(start), int(end))


def marks_after_audit(marks: tuple[Mark, ...], recording: Recording) -> tuple[Mark, ...]:
    """Convert marks from sample numbers in the file to sample numbers after the audit.

    Raises
    ------
    InputError
        The audit sorted the samples, so a range of samples in the file is no longer a range.
    """
    original = recording.original
    if original is None:
        return marks
    if (np.diff(original) <= 0).any():
        raise InputError(
            f"{recording.source}: the samples were sorted by time, so sample numbers in a file "
            'of marks are no longer valid; use a label column and [data] marks = "labels"',
            file=recording.source,
            key="[data] marks",
        )
    limits = np.array([(mark.start, mark.stop) for mark in marks])
    # The numbers continue beyond both ends, so a mark outside the file stays outside.
    beyond = np.maximum(limits - (int(original[-1]) + 1), 0) + np.minimum(limits, 0)
    moved = (np.searchsorted(original, limits) + beyond).tolist()
    return tuple(Mark(m.label, a, b) for m, (a, b) in zip(marks, moved, strict=True))
