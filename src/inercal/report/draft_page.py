"""The page of a drafted run file: what the columns hold, the signals with their rests, methods."""

import numpy as np
from markupsafe import Markup

from inercal.physics.sensors import imu, triad
from inercal.pipeline.drafts import UNKNOWN, Draft
from inercal.recordings import Mark, Recording
from inercal.report.templates import render
from inercal.report.traces import signal_figure


def page(draft: Draft) -> str:
    """Return the whole page, HTML."""
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
    """Return the signals with the rests shaded."""
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
