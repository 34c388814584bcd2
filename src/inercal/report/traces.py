"""Draw recorded signals with their sections, as envelopes to keep the files small.

In each stretch of samples, the smallest and the largest value are drawn, so every spike is visible.
"""
# matplotlib's stubs leave **kwargs untyped.
# pyright: reportUnknownMemberType=false

from collections.abc import Sequence

import numpy as np
from markupsafe import Markup
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from inercal.basics.arrays import Array
from inercal.physics.sensors import Sensor
from inercal.pipeline import Outcome
from inercal.recordings import Mark, Recording
from inercal.recordings.segments import RestDetection, scatter
from inercal.report import drawing
from inercal.report.drawing import AXES, BAND, FAINT, INK, MUTED, WARN, svg
from inercal.report.figures import SENSOR_KINDS

MAX_POINTS = 2400  # largest number of points in each channel


def envelope(recording: Recording, column: int) -> tuple[Array, Array]:
    """Return times since the first sample, s, and readings, both (k,), with NaN at gaps.

    If there are more than `MAX_POINTS` samples, the function divides them into about `MAX_POINTS`/2
    stretches and keeps only the extremes of each.
    """
    y = np.ascontiguousarray(recording.data[:, column])
    stretch = -(-y.size // (MAX_POINTS // 2))
    if stretch <= 2:
        kept = np.arange(y.size)
    else:
        whole = y.size // stretch * stretch
        blocks = y[:whole].reshape(-1, stretch)
        first = np.arange(0, whole, stretch)
        picks = [first + blocks.argmin(1), first + blocks.argmax(1)]
        if whole < y.size:
            tail = y[whole:]
            picks.append(whole + np.array([tail.argmin(), tail.argmax()]))
        kept = np.unique(np.concatenate([*picks, [0, y.size - 1]]))
    broken = np.unique(np.searchsorted(kept, recording.gaps[:, 1]))
    time = recording.time[kept] - recording.time[0]
    return np.insert(time, broken, time[broken]), np.insert(y[kept], broken, np.nan)


def stacked_axes(height: float, count: int, seconds: float) -> tuple[Figure, list[Axes]]:
    """Return a figure with axes that are stacked and share the same time axis."""
    figure, rows = drawing.panels(height, [*[0.0] * (count - 1), 0.45])
    for (axes,) in rows:
        axes.set_xlim(-0.01 * seconds, 1.01 * seconds)
        axes.tick_params(labelbottom=axes is rows[-1][0])
    rows[-1][0].set_xlabel("time from the first sample, s")
    return figure, [axes for (axes,) in rows]


@drawing.style
def section_figure(outcome: Outcome, recording: Recording) -> Markup:
    """Return the figure of the signals, with sections shaded and the audit's ranges marked."""
    figure, rows = _draw_signals(recording, outcome.calibration.sensor, _used_marks(outcome))
    for axes, names in rows:
        _mark_findings(axes, outcome, recording, names)
    _name_sections(rows[0][0], outcome, recording)
    return svg(figure, "traces", "Recorded signals with the marked sections")


@drawing.style
def signal_figure(recording: Recording, sensor: Sensor, marks: Sequence[Mark]) -> Markup:
    """Return the figure of the signals by kind of axis, with some sections shaded."""
    figure, _ = _draw_signals(recording, sensor, marks)
    return svg(figure, "signals", "Recorded signals with the detected rests shaded")


def _draw_signals(
    recording: Recording, sensor: Sensor, marks: Sequence[Mark]
) -> tuple[Figure, list[tuple[Axes, list[str]]]]:
    """Return a figure of the signals with shaded sections, and its axes with their channels."""
    shown = [axis for axis in sensor.axes if axis.name in recording.channels]
    kinds = [kind for kind in SENSOR_KINDS if any(axis.measures == kind for axis in shown)]
    figure, rows = stacked_axes(1.6, len(kinds), recording.duration)
    channels = [[axis.name for axis in shown if axis.measures == kind] for kind in kinds]
    for axes, kind, names in zip(rows, kinds, channels, strict=True):
        for k, name in enumerate(names):
            time, y = envelope(recording, recording.channels.index(name))
            axes.plot(time, y, color=AXES[k % 3], lw=0.7, label=name)
        title = SENSOR_KINDS[kind][0].lower()
        axes.set_ylabel(f"{title}, {recording.units[recording.channels.index(names[0])]}")
        drawing.add_legend(axes)
        _shade_sections(axes, marks, recording)
    return figure, list(zip(rows, channels, strict=True))


def time_spans(spans: list[tuple[int, int]], recording: Recording) -> list[tuple[float, float]]:
    """Return the start and the length of half-open ranges of samples, s."""
    last = recording.time.size - 1
    return [
        (
            float(recording.time[start] - recording.time[0]),
            float(recording.time[min(stop, last)] - recording.time[start]),
        )
        for start, stop in spans
    ]


def _used_marks(outcome: Outcome) -> list[Mark]:
    return [mark for mark in outcome.marks if mark.label in outcome.observations.labels]


def _shade_sections(axes: Axes, marks: Sequence[Mark], recording: Recording) -> None:
    spans = [(mark.start, mark.stop) for mark in marks]
    axes.broken_barh(time_spans(spans, recording), (0, 1), fc=BAND, ec=FAINT, lw=0.5, zorder=0,
                     transform=axes.get_xaxis_transform())  # fmt: skip


def _mark_findings(axes: Axes, outcome: Outcome, recording: Recording, names: list[str]) -> None:
    """Mark the audit's findings for these channels and for all channels."""
    spans = [
        (f.start, min(f.stop, recording.time.size))
        for one in outcome.findings
        for f in one.merged or (one,)
        if f.start is not None and f.stop is not None and f.channel in (None, *names)
    ]
    if spans:
        axes.broken_barh(time_spans(spans, recording), (0, 1), fc=(WARN, 0.25), ec=WARN, lw=0.8,
                         zorder=3, transform=axes.get_xaxis_transform())  # fmt: skip


def _name_sections(axes: Axes, outcome: Outcome, recording: Recording) -> None:
    """Write the names of the sections above the axes, vertically if they would overlap."""
    marks = _used_marks(outcome)
    if not marks:
        return
    marks = marks[:: -(-len(marks) // drawing.MAX_NAMES)]  # more names would overlap
    spans = time_spans([(mark.start, mark.stop) for mark in marks], recording)
    where = [start + length / 2 for start, length in spans]
    inches = 8.2 * np.diff(sorted(where)) / max(recording.duration, 1e-9)
    longest = max(len(mark.label) for mark in marks)
    upright = bool((inches < drawing.LETTER_WIDTH * (longest + 2)).any())
    for mark, x in zip(marks, where, strict=True):
        axes.text(x, 0.97, mark.label, transform=axes.get_xaxis_transform(), ha="center", va="top",
                  rotation=90 if upright else 0, fontsize=7, color=MUTED)  # fmt: skip
    low, high = axes.get_ylim()
    margin = 0.12 if not upright else 0.06 + 0.045 * longest
    axes.set_ylim(low, high + margin * (high - low))


@drawing.style
def scatter_figure(recording: Recording, sensor: Sensor, rests: RestDetection) -> Markup:
    """Return the figure of the scatter over time with the thresholds for rest."""
    figure, rows = stacked_axes(1.3, len(rests.levels), recording.duration)
    stretch = -(-recording.time.size // MAX_POINTS)
    starts = np.arange(0, recording.time.size, stretch)
    time = recording.time[starts] - recording.time[0]
    for axes, level in zip(rows, rests.levels, strict=True):
        values = scatter(recording, sensor, level.kind)
        axes.plot(time, np.maximum.reduceat(values, starts), color=INK, lw=0.7)
        if np.isfinite(level.threshold):
            axes.axhline(level.threshold, color=WARN, lw=0.8)
        axes.set_yscale("log")
        axes.yaxis.set_major_formatter("{x:g}")
        axes.minorticks_off()
        axes.set_ylabel(f"{SENSOR_KINDS[level.kind][0].lower()}, {level.unit}")
        _shade_sections(axes, rests.marks, recording)
    return svg(figure, "scatters", "Scatter over half a second, with the thresholds of rest")
