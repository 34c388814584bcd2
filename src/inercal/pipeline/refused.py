"""What can be shown of a recording that a calibration refused: rests and thresholds."""

from dataclasses import dataclass

from inercal.data.load import load_recording
from inercal.errors import InputError
from inercal.recording import Recording
from inercal.runfile import Run
from inercal.segments import FoundRests


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
    if run.data.kind == "means" or run.kind.rests is None:
        return None
    try:
        recording = load_recording(run)
        return Seen(recording, run.kind.rests(run, recording))
    except InputError:
        return None
