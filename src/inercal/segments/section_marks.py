"""Which samples belong to which step: marks from a label column, and their checks."""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from inercal.errors import InputError
from inercal.recording import Mark, Recording


def marks_from_labels(recording: Recording, *, again: bool = False) -> tuple[Mark, ...]:
    """Return one mark for each unbroken run of one label; empty labels mark nothing.

    Parameters
    ----------
    recording : Recording
    again : bool
        Whether a label may come in several runs, all of that label.

    Raises
    ------
    InputError
        The recording has no label column, or one label comes in several runs.
    """
    labels = recording.labels
    if labels is None:
        raise InputError(f"{recording.source or 'recording'}: no label column to take marks from")
    edges = np.flatnonzero(labels[1:] != labels[:-1]) + 1
    bounds = [0, *edges.tolist(), labels.size]
    marks = [Mark(str(labels[a]).strip(), a, b) for a, b in pairwise(bounds)]
    marks = [m for m in marks if m.label]
    seen: set[str] = set()
    for mark in marks:
        if mark.label in seen and not again:
            raise InputError(
                f"{recording.source}: label {mark.label!r} returns at "
                f"{recording.where(mark.start)}; each label marks one unbroken section; "
                "leave it empty between sections"
            )
        seen.add(mark.label)
    return tuple(marks)


def check_marks(marks: Sequence[Mark], recording: Recording, needed: Sequence[str]) -> None:
    """Refuse marks outside the recording, empty, overlapping, of unknown or of no step.

    Raises
    ------
    InputError
    """
    n = recording.time.size
    where = recording.source or "recording"
    if not any(mark.label in needed for mark in marks):
        found = ", ".join(mark.label for mark in marks) or "none"
        raise InputError(f"{where}: no section is marked {', '.join(needed)}; marks: {found}")
    used = sorted((m for m in marks if m.label in needed), key=lambda m: m.start)
    for mark in used:
        if not 0 <= mark.start < mark.stop <= n:
            raise InputError(
                f"{where}: mark {mark.label} is samples {mark.start} to {mark.stop}; "
                f"the recording has samples 0 to {n}"
            )
    for before, after in pairwise(used):
        if after.start < before.stop:
            raise InputError(
                f"{where}: marks {before.label} ({before.start} to {before.stop}) and "
                f"{after.label} ({after.start} to {after.stop}) overlap"
            )
    labels = [mark.label for mark in used]
    twice = {label for label in labels if labels.count(label) > 1}
    if twice:
        raise InputError(f"{where}: {', '.join(sorted(twice))} is marked twice")
