"""Marked and found rests: which may be used, and what a refused recording has of them."""

from collections.abc import Sequence

from inercal.data.section import DataSection
from inercal.data.source import Source
from inercal.errors import InputError
from inercal.io.marks import as_read, marks_from_file
from inercal.recording import Finding, Mark, Recording
from inercal.segments import (
    FoundRests,
    check_marks,
    find_rests,
    judged_levels,
    marks_from_labels,
    require_still,
)
from inercal.segments.levels import WINDOW


def still_but_accepted(
    run: Source[DataSection], recording: Recording, marks: Sequence[Mark]
) -> tuple[Finding, ...]:
    """Refuse marked rests that move; return warnings of those that the run file accepts.

    Raises
    ------
    InputError
        See `inercal.segments.stillness.require_still`.
    """
    return require_still(recording, run.sensor, marks, run.data.moving)


def seen_rests(run: Source[DataSection], recording: Recording) -> FoundRests:
    """Return the rests that were found without a plan, or the marked sections."""
    if run.data.marks == "found":
        try:
            return find_rests(recording, run.sensor)
        except InputError as error:
            marks, text = (), str(error)
    else:
        labelled = run.data.marks == "labels"
        marks = marks_from_labels(recording) if labelled else _from_file(run, recording)
        text = f"{len(marks)} sections are marked"
    levels = judged_levels(recording, run.sensor)
    return FoundRests(marks, levels, WINDOW, Finding("note", "rests", text))


def _from_file(run: Source[DataSection], recording: Recording) -> tuple[Mark, ...]:
    marks = as_read(marks_from_file(run.file(run.data.marks)), recording)
    check_marks(marks, recording, [mark.label for mark in marks])
    return marks
