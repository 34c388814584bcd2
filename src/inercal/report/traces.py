"""Draw recorded signals with their sections, as envelopes to keep the files small.

Of each stretch of samples, the smallest and the largest value are drawn, so every spike is visible.

Figure of the measured attitudes on a sphere of body directions, seen from two sides.

Summary of residuals by step, for methods that use all samples of a recording.

A recording has tens of thousands of whitened residuals r with variance 1, too many to show one by
one. If the model is right, the n residuals of a step satisfy:

    √n mean(r)    differs from 0 by about 1; more means a bias or an angle that does not fit
    rms(r)        differs from 1 by about 1/√(2n); more means that the noise is not as stated
"""
# matplotlib's stubs leave **kwargs untyped.
# pyright: reportUnknownMemberType=false

from collections.abc import Sequence
from math import cos, degrees, pi, sin
from typing import NamedTuple

import numpy as np
from markupsafe import Markup
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle
from numpy.typing import NDArray

from inercal.basics.arrays import Array
from inercal.benches.report_data import MeasuredDirection
from inercal.benches.turntable import is_turntable
from inercal.physics.plan import Hold, Rotation, Turn, describe_direction
from inercal.physics.sensors import Sensor
from inercal.pipeline import Outcome
from inercal.recordings import Mark, Recording
from inercal.recordings.segments import RestDetection, scatter
from inercal.report import drawing
from inercal.report.drawing import AXES, BAND, FAINT, INK, MUTED, PAPER, WARN, Z, svg
from inercal.report.figures import BAND_LIMIT, SENSOR_KINDS, draw_dots, rows_beyond_band

_MOVES_LABEL = "moves"  # label for the time between steps


class StepResiduals(NamedTuple):
    """Whitened residuals by step for one kind of sensor."""

    title: str
    parts: tuple[str, ...]
    labels: tuple[str, ...]
    mean: Array  # (k, 3), times √n
    rms: Array  # (k, 3)
    counts: NDArray[np.int64]  # (k,) number of residuals in each component


def uses_whole_recording(outcome: Outcome) -> bool:
    """Return whether the residuals of an outcome belong to the whole recording."""
    if outcome.observations.track is None:
        return False
    from inercal.methods.turntable_trajectory import METHOD  # imported here because it loads Numba

    return outcome.calibration.method == METHOD.name


def residuals_by_step(outcome: Outcome) -> tuple[StepResiduals, ...]:
    """Return the whitened residuals by step, gyros before accelerometers."""
    from inercal.methods.turntable import model
    from inercal.methods.turntable_trajectory.rows import RotationRows, StaticRows

    track, sensor, bench = outcome.observations.track, outcome.calibration.sensor, outcome.bench
    assert track is not None
    assert is_turntable(bench)
    kinds = {axis.measures for axis in sensor.axes}
    whitened, found, at = outcome.estimate.whitened, list[StepResiduals](), 0
    if "w" in kinds:
        time = track.time[
            RotationRows.from_track(model.triad_model(sensor, "w"), bench, track).epochs[1:]
        ]
        rows = whitened[: 3 * time.size].reshape(-1, 3)
        found.append(_split_by_step("Gyros", ("east", "north", "up"), time, rows, outcome))
        at = 3 * time.size
    if "f" in kinds:
        resting = StaticRows.from_track(model.triad_model(sensor, "f"), bench, track)
        names = resting.triad.sensor.channels
        rows = whitened[at:].reshape(-1, 3)
        found.append(_split_by_step("Accelerometers", names, resting.time, rows, outcome))
    return tuple(found)


def _split_by_step(
    title: str, parts: Sequence[str], time: Array, rows: Array, outcome: Outcome
) -> StepResiduals:
    seen = outcome.observations
    within: dict[str, NDArray[np.bool_]] = {}
    left = np.ones(time.size, dtype=bool)  # an epoch shared by two steps belongs to the first
    for label, middle, seconds in zip(seen.labels, seen.time, seen.duration, strict=True):
        within[label] = left & (np.abs(time - middle) <= seconds / 2)
        left &= ~within[label]
    within[_MOVES_LABEL] = left
    chosen = {label: rows[at] for label, at in within.items() if at.any()}
    count = np.array([len(some) for some in chosen.values()])
    mean = np.array([some.mean(axis=0) for some in chosen.values()]).reshape(-1, 3)
    rms = np.sqrt([np.square(some).mean(axis=0) for some in chosen.values()]).reshape(-1, 3)
    return StepResiduals(
        title, tuple(parts), tuple(chosen), mean * np.sqrt(count)[:, None], rms, count
    )


@drawing.style
def step_residual_figure(found: Sequence[StepResiduals]) -> Markup:
    """Return the figure of the residuals' means (left) and sizes (right), by step."""
    figure, rows = drawing.panels(1.65, [drawing.label_room(one.labels) for one in found], 2)
    for (left, right), one in zip(rows, found, strict=True):
        draw_dots(left, one.mean, one.parts, band=True)
        draw_dots(right, one.rms - 1, one.parts, band=False)
        reach = BAND_LIMIT / np.sqrt(2 * one.counts)
        at = np.arange(one.counts.size)
        right.bar(at, 2 * reach, 1.0, -reach, color=BAND, lw=0, zorder=0)
        right.axhline(0, color=FAINT, lw=0.8, zorder=0)
        worst = rows_beyond_band(one.mean)
        for axes in (left, right):
            drawing.name_positions(axes, one.labels, worst=worst)
        left.set(title=one.title, ylabel="mean, in standard deviations")
        right.set_ylabel("rms minus 1")
        drawing.add_legend(right)
    return svg(figure, "residuals", "Means and sizes of whitened residuals by step")


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


FACES = tuple(tuple(sign * row) for row in np.eye(3) for sign in (1.0, -1.0))
_COVERED_COSINE = cos(25 * pi / 180)  # degrees; a hold within this angle of a face covers the face
_NOMINAL_COSINE = cos(
    10 * pi / 180
)  # a nominal attitude farther than this from every face is not a face position
_MAX_NAMED = 14  # largest number of attitudes whose names do not overlap
_RING_RADIUS = 17 * pi / 180  # angular radius of the arrow that represents a turn
_VIEW = np.array([1.0, 0.78, 0.66]) / np.linalg.norm([1.0, 0.78, 0.66])


def missing_faces(found: Sequence[MeasuredDirection]) -> list[str]:
    """Return the faces that never pointed up, such as "−z"; empty if attitudes were arbitrary."""
    holds = [(a, a.step) for a in found if isinstance(a.step, Hold)]
    if not holds or any(max(map(abs, step.up)) < _NOMINAL_COSINE for _, step in holds):
        return []
    return [
        describe_direction((float(x), float(y), float(z)))
        for x, y, z in FACES
        if not any(a.unit_vector @ np.array([x, y, z]) > _COVERED_COSINE for a, _ in holds)
    ]


@drawing.style
def sphere(found: Sequence[MeasuredDirection], side: int) -> Markup:
    """Return the sphere of body directions, seen from +x +y +z (side 1) or opposite (side −1)."""
    figure = Figure(figsize=(4.2, 4.4))
    axes = figure.add_axes((0, 0, 1, 4.2 / 4.4))
    view = side * _VIEW
    right = np.cross([0.0, 0.0, 1.0], view)
    right /= np.linalg.norm(right)
    screen = np.stack([right, np.cross(view, right), view])
    _draw_globe(axes, screen)
    missing = missing_faces(found)
    for face in FACES:
        x, y, depth = screen @ np.array(face)
        if depth < 0:
            continue
        name = describe_direction((face[0], face[1], face[2]))
        if name in missing:
            axes.plot(x, y, "o", ms=9, mfc="none", mec=WARN, mew=1.2)
            axes.annotate(f"{name}: no position", (x, y), (0, -13), textcoords="offset points",
                          ha="center", color=WARN)  # fmt: skip
        else:
            axes.annotate(name, (x, y), (0, -12), textcoords="offset points", ha="center",
                          color=MUTED)  # fmt: skip
    for attitude in found:
        x, y, depth = screen @ attitude.unit_vector
        if depth < 0:
            continue
        if not isinstance(attitude.step, Turn | Rotation):
            axes.plot(x, y, "o", ms=6, mfc=Z, mec=PAPER, mew=0.6)
            if len(found) <= _MAX_NAMED:
                axes.annotate(attitude.step.label, (x, y), (0, 7), textcoords="offset points",
                              ha="center", color=INK)  # fmt: skip
        else:
            _draw_turn(axes, attitude, attitude.step.angle, screen)
    axes.set(xlim=(-1.12, 1.12), ylim=(-1.12, 1.12))
    axes.axis("off")
    seen = "+x +y +z" if side > 0 else "−x −y −z"
    axes.set_title(f"seen from {seen}", loc="center")
    return svg(figure, f"sphere{'p' if side > 0 else 'm'}", f"Attitudes covered, seen from {seen}")


def _draw_globe(axes: Axes, screen: Array) -> None:
    axes.add_patch(Circle((0, 0), 1.0, fc=BAND, ec=MUTED, lw=0.8))
    along = np.linspace(0, 2 * pi, 181)
    for k in range(3):
        ring = np.zeros((along.size, 3))
        ring[:, (k + 1) % 3], ring[:, (k + 2) % 3] = np.cos(along), np.sin(along)
        x, y, depth = screen @ ring.T
        axes.plot(np.where(depth >= 0, x, np.nan), y, color=FAINT, lw=0.8)


def _draw_turn(axes: Axes, attitude: MeasuredDirection, angle: float, screen: Array) -> None:
    """Draw an arrow around the axis, in the direction of the turn."""
    n = attitude.unit_vector
    first = np.cross(screen[0], n)
    first /= np.linalg.norm(first)
    second = np.cross(n, first)
    start = np.sign(angle) * np.linspace(-0.78 * pi, 0.78 * pi, 61)
    ring = cos(_RING_RADIUS) * n[:, None] + sin(_RING_RADIUS) * (
        np.outer(first, np.cos(start)) + np.outer(second, np.sin(start))
    )
    x, y, _ = screen @ ring
    axes.plot(x[:-1], y[:-1], color=INK, lw=1.0)
    axes.annotate("", (x[-1], y[-1]), (x[-4], y[-4]),
                  arrowprops={"arrowstyle": "-|>", "fc": INK, "ec": INK, "lw": 0.8,
                              "shrinkA": 0, "shrinkB": 0})  # fmt: skip
    axes.annotate(f"{attitude.step.label} {degrees(angle):+.0f}°".replace("-", "−"),
                  (float(x.mean()), float(y.min())), (0, -10), textcoords="offset points",
                  ha="center", color=INK)  # fmt: skip
