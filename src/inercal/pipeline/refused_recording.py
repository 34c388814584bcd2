"""Detect the rests in a recording that could not be calibrated, for a report."""

from dataclasses import dataclass

from inercal.basics.errors import InputError
from inercal.recordings import Recording
from inercal.recordings.data.recording_loader import load_recording
from inercal.recordings.segments import RestDetection
from inercal.runfile import Run


@dataclass(frozen=True, eq=False)
class InspectedRecording:
    """A recording, with the rests that were detected in it.

    Parameters
    ----------
    recording : Recording
    rests : RestDetection
        Detected rests; there are no marks if no rest was detected.
    """

    recording: Recording
    rests: RestDetection


def inspect_refused_recording(run: Run) -> InspectedRecording | None:
    """Return the recording and the rests of a run that could not be calibrated.

    Return None if there is no recording, if it cannot be read, or if the bench has no rests.
    """
    if run.data.kind == "means" or run.kind.rests is None:
        return None
    try:
        recording = load_recording(run)
        return InspectedRecording(recording, run.kind.rests(run, recording))
    except InputError:
        return None
