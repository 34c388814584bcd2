"""The page of a recording that was refused: its signals, detected rests and thresholds."""

from inercal.physics.sensors import Sensor
from inercal.pipeline.refused_recording import InspectedRecording
from inercal.report.templates import render
from inercal.report.traces import scatter_figure, signal_figure


def page(seen: InspectedRecording, sensor: Sensor, message: str) -> str:
    """Return the whole page, HTML."""
    marks = sorted(seen.rests.marks, key=lambda mark: mark.start)
    time = seen.recording.time - seen.recording.time[0]
    return render(
        "refusal.html",
        sensor=sensor,
        source=seen.recording.source,
        message=message,
        found=seen.rests.finding.message,
        signals=signal_figure(seen.recording, sensor, marks),
        scatters=scatter_figure(seen.recording, sensor, seen.rests),
        marks=[
            (mark.label, f"{time[mark.start]:.2f}", f"{time[mark.stop - 1]:.2f}") for mark in marks
        ],
    )
