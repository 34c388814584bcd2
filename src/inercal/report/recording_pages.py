"""HTML pages about recordings that have no calibration: a drafted run file, or a refusal."""

import numpy as np
from markupsafe import Markup

from inercal.physics.sensors import Sensor, imu, triad
from inercal.pipeline.drafts import UNKNOWN, Draft
from inercal.pipeline.outcome import InspectedRecording
from inercal.recordings import Mark, Recording
from inercal.report.templates import render
from inercal.report.traces import scatter_figure, signal_figure


def draft_page(draft: Draft) -> str:
    """Return the whole page as HTML."""
    return render(
        "draft.html",
        name=draft.path.name,
        facts=draft.facts,
        entries=[(one.name, one.value, one.reason or one.ask) for one in draft.entries],
        unknown=UNKNOWN,
        questions=draft.questions,
        trials=draft.trials,
        text=draft.text,
        signals=None if draft.rests is None else _signals(draft),
    )


def _signals(draft: Draft) -> Markup:
    """Return the figure of the signals, with the rests shaded."""
    assert draft.rests is not None
    kinds = {"accelerometer": "a", "gyro": "g"}
    data = np.hstack([draft.readings[kind] for kind in draft.readings])
    names = tuple(kinds[kind] + axis for kind in draft.readings for axis in "xyz")
    time = np.arange(len(data), dtype=np.float64) if draft.time is None else draft.time
    stated = {one.section: one.value for one in draft.entries if one.key == "unit"}
    units = tuple(str(stated[f"sensor.{kind}"]) for kind in draft.readings for _ in "xyz")
    recording = Recording(time - time[0], data, names, units)
    marks = [Mark(f"r{k + 1:02d}", int(a), int(b)) for k, (a, b) in enumerate(draft.rests.spans)]
    return signal_figure(recording, imu("") if "gyro" in draft.readings else triad(""), marks)


def refusal_page(seen: InspectedRecording, sensor: Sensor, message: str) -> str:
    """Return the whole page as HTML."""
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
