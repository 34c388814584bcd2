"""Marked and found rests: which may be used, and what a refused recording has of them."""

from collections.abc import Sequence

from inercal.data.data_section import DataSection, RestsSection
from inercal.data.source import Source
from inercal.errors import InputError
from inercal.io.mark_files import marks_after_audit, marks_from_file
from inercal.recording import Finding, Mark, Recording
from inercal.segments import (
    RestDetection,
    check_marks,
    find_rests,
    find_thresholds,
    marks_from_labels,
    require_still,
)
from inercal.segments.motion_thresholds import WINDOW


def check_marked_rests(
    run: Source[DataSection], recording: Recording, marks: Sequence[Mark]
) -> tuple[Finding, ...]:
    """Refuse marked rests that move; return warnings of those that the run file accepts.

    Raises
    ------
    InputError
        See `inercal.segments.stillness.require_still`.
    """
    return require_still(recording, run.sensor, marks, run.data.moving_sections)


def check_rests(
    run: Source[RestsSection], recording: Recording, marks: Sequence[Mark]
) -> tuple[Finding, ...]:
    """Return what `check_marked_rests` says of marked rests; those that are found are still.

    Raises
    ------
    InputError
        As `check_marked_rests`, or the run file accepts rests that move where they are found.
    """
    if run.data.marks != "found":
        return check_marked_rests(run, recording, marks)
    if run.data.accept_moving is not None:
        raise InputError(
            f"{run.path}: [data] accept_moving is for marks that you give: detected rests "
            "do not move"
        )
    return ()


def stated_marks(
    run: Source[DataSection], recording: Recording, *, again: bool = False
) -> tuple[Mark, ...]:
    """Return the marked sections, by the recording's labels or of the file of marks.

    Parameters
    ----------
    run : Run
    recording : Recording
    again : bool
        Whether a label may return.
    """
    if run.data.marks == "labels":
        return marks_from_labels(recording, again=again)
    return marks_after_audit(marks_from_file(run.file(run.data.marks)), recording)


def rests_without_plan(run: Source[DataSection], recording: Recording) -> RestDetection:
    """Return the rests that were found without a plan, or the marked sections."""
    if run.data.marks == "found":
        try:
            return find_rests(recording, run.sensor)
        except InputError as error:
            marks, text = (), str(error)
    else:
        marks = stated_marks(run, recording)
        if run.data.marks != "labels":
            check_marks(marks, recording, [mark.label for mark in marks])
        text = f"{len(marks)} sections are marked"
    levels = find_thresholds(recording, run.sensor)
    return RestDetection(marks, levels, WINDOW, Finding("note", "rests", text))
