"""What can be shown of a recording that a calibration refused: rests and thresholds."""

from dataclasses import dataclass, replace

from inercal.benches import DividingHead, Hand
from inercal.errors import InputError
from inercal.io.marks import as_read, marks_from_file
from inercal.io.read import read_recording
from inercal.pipeline.inputs import columns, gyro_file, limits, turned_round
from inercal.plan import Hold, Turn
from inercal.recording import Finding, Mark, Recording
from inercal.runfile import Run
from inercal.segments import (
    FoundRests,
    check_marks,
    find_rests,
    judged_levels,
    marks_from_labels,
    search_sections,
)
from inercal.segments.levels import WINDOW


@dataclass(frozen=True, eq=False)
class Seen:
    """A recording and the rests that were found in it.

    Parameters
    ----------
    recording : Recording
    rests : FoundRests
        Without marks where none was found.
    """

    recording: Recording
    rests: FoundRests


def seen(run: Run) -> Seen | None:
    """Return what was found in the recording of a run that was refused.

    None where there is no recording, where it cannot be read, or where its bench has no rests.
    """
    if run.data.kind == "means" or not isinstance(run.bench, Hand | DividingHead):
        return None
    try:
        recording = read_recording(
            run.file(run.data.file), columns(run), limits(run.sensor), gyro_file(run)
        )
        recording = turned_round(run, recording)
        return Seen(recording, _rests(run, recording))
    except InputError:
        return None


def _from_file(run: Run, recording: Recording) -> tuple[Mark, ...]:
    marks = as_read(marks_from_file(run.file(run.data.marks)), recording)
    check_marks(marks, recording, [mark.label for mark in marks])
    return marks


def _rests(run: Run, recording: Recording) -> FoundRests:
    if run.data.marks == "found" and isinstance(run.bench, Hand) and not run.method.free:
        steps = [step for step in run.steps if isinstance(step, Hold | Turn)]
        found = search_sections(recording, run.sensor, steps)
        note = Finding("note", "rests", found.words)
        named = {(mark.start, mark.stop): mark.label for mark in found.marks}
        marks = tuple(
            replace(rest, label=named.get((rest.start, rest.stop), rest.label))
            for rest in found.rests
        )
        return FoundRests(marks, found.levels, WINDOW, note)
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
