"""Draw figures of the filters over time, and of the progress of a genetic search."""
# matplotlib's stubs leave **kwargs untyped.
# pyright: reportUnknownMemberType=false

from collections.abc import Mapping, Sequence
from itertools import pairwise
from math import radians
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from markupsafe import Markup
from matplotlib.axes import Axes
from matplotlib.ticker import LogLocator, NullFormatter, NullLocator
from numpy.typing import NDArray

from inercal.basics.arrays import Array
from inercal.basics.keys import CoefficientName
from inercal.benches import Turntable
from inercal.estimation import FilterHistory, SmoothedStates
from inercal.estimation.uncertainty import COVERAGE
from inercal.physics.sensors import G0, Sensor
from inercal.pipeline import Outcome
from inercal.recordings import Track
from inercal.report import drawing
from inercal.report.drawing import AXES, BAND, FAINT, INK, MUTED, PAPER, WARN, Y, svg

if TYPE_CHECKING:
    from inercal.methods.ship_multi_angle.norm_equations import SearchHistory

MAX_POINTS = 290
"""Largest number of points in a line."""
_STYLES = ("-", "--", ":")
_PAUSE_STEPS = 4.0  # in median time steps
_LEGEND_SHARE = 0.13  # fraction of the figure's width
_MEAN_FRACTION = 40  # the running mean covers this fraction of the epochs


class _CoefficientGroup(NamedTuple):
    """Coefficients of one filter that have the same group and unit."""

    course: FilterHistory
    title: str
    names: tuple[str, ...]
    unit: str
    size: float


@drawing.style
def convergence_figure(outcome: Outcome, truth: Mapping[str, float] | None) -> Markup:
    """Return a figure of estimates over time, minus the truth or the final result, with ±2σ."""
    sensor, courses = outcome.calibration.sensor, outcome.estimate.courses
    kinds = [kind for course in courses for kind in _coefficient_groups(course, sensor)]
    figure, panels = drawing.panels(2.1, [0.45] * len(kinds))
    for (axes,), kind in zip(panels, kinds, strict=True):
        box = axes.get_position()
        axes.set_position((box.x0, box.y0, (1 - _LEGEND_SHARE) * box.width, box.height))
        _draw_convergence(axes, kind, truth)
        axes.set_xlabel("time, s")
    beyond = "the truth" if truth is not None else "the result"
    return svg(figure, "courses", f"Estimates minus {beyond} with two standard deviations")


def _coefficient_groups(course: FilterHistory, sensor: Sensor) -> list[_CoefficientGroup]:
    """Return the coefficients that a filter estimates, by group and unit."""
    groups: dict[tuple[str, str], list[str]] = {}
    for name in course.names:
        if name in sensor.coefficients:
            line = sensor.coefficient(name)
            groups.setdefault((line.group, line.unit), []).append(name)
    return [
        _CoefficientGroup(course, f"{course.name}: {group}, {unit}", tuple(names), unit,
              sensor.coefficient(names[0]).si)
        for (group, unit), names in groups.items()
    ]  # fmt: skip


def _draw_convergence(
    axes: Axes, kind: _CoefficientGroup, truth: Mapping[str, float] | None
) -> None:
    course = kind.course
    picks = thin_indices(course.shown_time.size)
    time = course.shown_time[picks]
    channels = list(dict.fromkeys(CoefficientName(name).axis for name in kind.names))
    shorts = list(dict.fromkeys(CoefficientName(name).term for name in kind.names))
    final: list[float] = []
    for name in kind.names:
        column = course.names.index(name)
        value, reach = course.value[:, column], COVERAGE * course.std[:, column] / kind.size
        final.append(float(reach[-1]))
        centre = value[-1] if truth is None else truth.get(name, 0.0)
        colour = AXES[channels.index(CoefficientName(name).axis) % 3]
        style = _STYLES[shorts.index(CoefficientName(name).term) % 3]
        axes.plot(time, (value[picks] - centre) / kind.size, style, color=colour, lw=1.0,
                  label=name)  # fmt: skip
        for side in (-1, 1):
            axes.plot(time, side * reach[picks], style, color=colour, lw=0.5, alpha=0.55)
    axes.axhline(0, color=FAINT, lw=0.8, zorder=0)
    _set_symmetric_scale(axes, min(final))
    axes.set(ylabel=kind.unit, title=kind.title)
    axes.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), borderpad=0, handlelength=2.0)


def _set_symmetric_scale(axes: Axes, last: float) -> None:
    """Scale an axis linearly within the final uncertainty and logarithmically outside it."""
    base = 10.0 ** np.floor(np.log10(last))
    axes.set_yscale("symlog", linthresh=base)
    reach = max(map(abs, axes.get_ylim()))
    axes.set_ylim(-2 * reach, 2 * reach)
    top = int(np.ceil(np.log10(reach / base)))
    decades = [base * 10.0**k for k in range(0, top + 1, max(1, top // 3))]
    axes.set_yticks([-d for d in reversed(decades)] + [0.0] + decades)
    axes.yaxis.set_minor_locator(NullLocator())
    axes.yaxis.set_major_formatter("{x:g}")


class _StateGroup(NamedTuple):
    """Filter states that are drawn together."""

    title: str
    states: tuple[str, ...]
    size: float


@drawing.style
def smoothed_figure(courses: Sequence[FilterHistory], sensor: Sensor) -> Markup | None:
    """Return a figure of the smoothed states with ±2σ, or None if there are none."""
    found = [(one, one.smoothed) for one in courses if one.smoothed is not None]
    if not found:
        return None
    figure, panels = drawing.panels(1.6, [*[0.3] * (len(found) - 1), 0.45], 2)
    for row, (course, result) in zip(panels, found, strict=True):
        for axes, line in zip(row, _state_groups(course, result, sensor), strict=True):
            if line.states:
                _draw_states(axes, course.shown_time, result, line)
            else:
                axes.set_axis_off()
    for axes in panels[-1]:
        axes.set_xlabel("time, s")
    return svg(figure, "smoothed", "Attitude and drift over time, smoothed, with two sd")


def _state_groups(
    course: FilterHistory, made: SmoothedStates, sensor: Sensor
) -> tuple[_StateGroup, _StateGroup]:
    """Return the attitude states and the drift states of a filter."""
    tilt, drift = (
        tuple(name for name in made.names if name.startswith(first)) for first in ("phi_", "drift[")
    )
    kinds = {axis.name: axis.measures for axis in sensor.axes}
    turning = any(kinds[CoefficientName(name).axis] == "w" for name in course.names if "." in name)
    unit, size = ("°/h", radians(1) / 3600) if turning else ("µg", 1e-6 * G0)
    return (
        _StateGroup(f"{course.name}: attitude error, ″", tilt, radians(1 / 3600)),
        _StateGroup(f"{course.name}: drift, {unit}", drift, size),
    )


def _draw_states(axes: Axes, time: Array, made: SmoothedStates, line: _StateGroup) -> None:
    picks = thin_indices(time.size, MAX_POINTS // 2)  # half as wide
    for colour, state in zip(AXES, line.states, strict=False):
        column = made.names.index(state)
        value, reach = (one[picks, column] / line.size for one in (made.value, COVERAGE * made.std))
        at, middle = _break_at_pauses(time[picks], value)
        _, reach = _break_at_pauses(time[picks], reach)
        axes.plot(at, middle, color=colour, lw=1.0, label=_state_label(state))
        axes.fill_between(at, middle - reach, middle + reach, color=colour, alpha=0.14, lw=0)
    axes.axhline(0, color=FAINT, lw=0.8, zorder=0)
    axes.set_title(line.title)
    drawing.add_legend(axes)


def _state_label(state: str) -> str:
    """Return the name of a state for the legend."""
    level = {"phi_e": "east", "phi_n": "north", "phi_u": "up"}
    return level.get(state, state.removeprefix("drift[").removesuffix("]"))


@drawing.style
def innovation_figure(courses: Sequence[FilterHistory]) -> Markup:
    """Return a figure of each filter's NIS per component over time, as a running mean."""
    figure, ((axes,),) = drawing.panels(1.7, [0.45])
    axes.axhline(1, color=WARN, lw=0.9, ls="--", label="as stated")
    for k, course in enumerate(courses):
        time, mean = running_nis(course)
        picks = thin_indices(time.size)
        time, mean = _break_at_pauses(time[picks], mean[picks])
        axes.plot(time, mean, color=AXES[k % 3], lw=1.0, label=course.name)
    axes.set_ylim(bottom=0)
    axes.set(ylabel="NIS per component", xlabel="time, s")
    drawing.add_legend(axes)
    return svg(figure, "nis", "Normalised innovations squared of each filter over time")


def _break_at_pauses(time: Array, values: Array) -> tuple[Array, Array]:
    """Insert NaN into a line at each pause of the filter, which interrupts the drawn line."""
    steps = np.diff(time)
    if not steps.size:
        return time, values
    after = np.flatnonzero(steps > _PAUSE_STEPS * np.median(steps)) + 1
    return np.insert(time, after, np.nan), np.insert(values, after, np.nan)


def running_nis(course: FilterHistory) -> tuple[Array, Array]:
    """Return times and the running mean of NIS per component; a mean covers 1/40 of the epochs.

    Epochs at which the attitude was reset have no innovation, so they are omitted.
    """
    taken = course.nis > 0
    time, nis = course.time[taken], course.nis[taken] / max(course.innovation.shape[1], 1)
    width = max(nis.size // _MEAN_FRACTION, 1)
    if nis.size < width + 1:
        return time, nis
    total = np.cumsum(np.append(0.0, nis))
    middle = time[width // 2 : width // 2 + nis.size - width + 1]
    return middle, (total[width:] - total[:-width]) / width


@drawing.style
def path_figure(track: Track, bench: Turntable) -> Markup:
    """Return the figure of the axis angles over time, with the holds shaded."""
    figure, ((axes,),) = drawing.panels(1.9, [0.45])
    picks = thin_indices(track.time.size, 2 * MAX_POINTS)
    for k, name in enumerate(bench.names):
        axes.plot(track.time[picks], np.degrees(track.angles[picks, k]), color=AXES[k], lw=1.0,
                  label=name)  # fmt: skip
    edges = np.flatnonzero(np.diff(track.hold)) + 1
    bounds = [0, *edges.tolist(), track.time.size]
    held = [
        (float(track.time[a]), float(track.time[b - 1] - track.time[a]))
        for a, b in pairwise(bounds)
        if track.hold[a] >= 0
    ]
    axes.broken_barh(held, (0, 1), fc=BAND, ec=FAINT, lw=0.5, zorder=0,
                     transform=axes.get_xaxis_transform())  # fmt: skip
    axes.set(ylabel="angle by readback, °", xlabel="time, s")
    drawing.add_legend(axes)
    return svg(figure, "path", "Angles of the table's axes over time, holds shaded")


def thin_indices(count: int, most: int = MAX_POINTS) -> NDArray[np.int64]:
    """Return at most `most` evenly spaced indices below `count`, including both ends."""
    return np.unique(np.linspace(0, count - 1, min(count, most)).round().astype(np.int64))


@drawing.style
def search_figure(search: "SearchHistory") -> Markup:
    """Return the figure of the best member after each generation, as in Fig. 6 of the source."""
    number = np.array([g.number for g in search.generations])
    cost = np.array([g.cost for g in search.generations])
    worst = 100 * np.array([g.worst for g in search.generations])
    figure, rows = drawing.panels(1.9, [0.45], 2)
    left, right = rows[0]
    mark = "." if number.size == 1 else ""  # the time limit may end a search immediately
    left.plot(number, cost, marker=mark, color=INK, lw=1.1)
    left.set_ylabel("sum of squares, g⁴")
    right.plot(number, worst, marker=mark, color=INK, lw=1.1)
    right.set_ylabel("largest error of a norm, %")
    right.axhline(100 * search.goal, color=WARN, lw=0.9, ls="--",
                  label=f"goal {100 * search.goal:.3g} %")  # fmt: skip
    if search.goal_generation is not None:
        right.plot(search.goal_generation, worst[search.goal_generation - 1], "o", ms=6,
                   mfc=Y, mec=PAPER, mew=0.6, ls="none",
                   label=f"met at generation {search.goal_generation}")  # fmt: skip
    for axes in (left, right):
        _set_logarithmic_axis(axes)
        axes.set_xlabel("generation")
    drawing.add_legend(right)
    return svg(figure, "history", "Sum of squares and largest error of a norm by generation")


def _set_logarithmic_axis(axes: Axes) -> None:
    axes.set_yscale("log")
    axes.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0), numticks=8))
    axes.yaxis.set_major_formatter("{x:g}")
    axes.yaxis.set_minor_formatter(NullFormatter())
    axes.grid(axis="y", color=MUTED, lw=0.2)
    axes.set_axisbelow(True)
