"""The page of a recording that was refused: what was found in it."""

from inercal.pipeline.refused import Seen
from inercal.report.templates import render
from inercal.report.traces import scatters, signals
from inercal.sensors import Sensor


def page(seen: Seen, sensor: Sensor, message: str) -> str:
    """Return the whole page, HTML."""
    marks = sorted(seen.rests.marks, key=lambda mark: mark.start)
    time = seen.recording.time - seen.recording.time[0]
    return render(
        "refusal.html",
        sensor=sensor,
        source=seen.recording.source,
        message=message,
        found=seen.rests.finding.message,
        signals=signals(seen.recording, sensor, marks),
        scatters=scatters(seen.recording, sensor, seen.rests),
        marks=[
            (mark.label, f"{time[mark.start]:.2f}", f"{time[mark.stop - 1]:.2f}") for mark in marks
        ],
    )
