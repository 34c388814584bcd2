"""Residuals of a method that takes a whole recording at once: step by step, as means and sizes.

Tens of thousands of whitened residuals r, each of variance 1, are no picture. Of the n in a step

    √n mean(r)    is off from 0 by about 1: a bias, or an angle, that does not fit there
    rms(r)        is off from 1 by about 1/√(2n): noise that is not as stated
"""
# matplotlib's stubs leave **kwargs untyped.
# pyright: reportUnknownMemberType=false

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from markupsafe import Markup
from numpy.typing import NDArray

from inercal.arrays import Array
from inercal.benches.turntable import is_turntable
from inercal.methods.turntable import model
from inercal.methods.turntable_trajectory import METHOD
from inercal.methods.turntable_trajectory.rows import RotationRows, StaticRows
from inercal.pipeline import Outcome
from inercal.report import drawing
from inercal.report.drawing import BAND, FAINT, svg
from inercal.report.figures import BEYOND, beyond, dots

_MOVES = "moves"  # what is between the steps


class ByStep(NamedTuple):
    """Whitened residuals of one kind of sensors by step."""

    title: str
    parts: tuple[str, ...]
    labels: tuple[str, ...]
    mean: Array  # (k, 3), times √n
    rms: Array  # (k, 3)
    members: NDArray[np.int64]  # (k,) of each component


def is_whole(outcome: Outcome) -> bool:
    """Whether an outcome's residuals are those of a whole recording."""
    return outcome.calibration.method == METHOD.name and outcome.observations.track is not None


def by_step(outcome: Outcome) -> tuple[ByStep, ...]:
    """Return the whitened residuals by step, gyros before accelerometers."""
    track, sensor, bench = outcome.observations.track, outcome.calibration.sensor, outcome.bench
    assert track is not None
    assert is_turntable(bench)
    kinds = {axis.measures for axis in sensor.axes}
    whitened, found, at = outcome.estimate.whitened, list[ByStep](), 0
    if "w" in kinds:
        time = track.time[RotationRows.of(model.triad(sensor, "w"), bench, track).epochs[1:]]
        rows = whitened[: 3 * time.size].reshape(-1, 3)
        found.append(_split("Gyros", ("east", "north", "up"), time, rows, outcome))
        at = 3 * time.size
    if "f" in kinds:
        resting = StaticRows.of(model.triad(sensor, "f"), bench, track)
        names = resting.part.sensor.channels
        rows = whitened[at:].reshape(-1, 3)
        found.append(_split("Accelerometers", names, resting.time, rows, outcome))
    return tuple(found)


def _split(title: str, parts: Sequence[str], time: Array, rows: Array, outcome: Outcome) -> ByStep:
    seen = outcome.observations
    within: dict[str, NDArray[np.bool_]] = {}
    left = np.ones(time.size, dtype=bool)  # steps may touch: an epoch is of the first of them
    for label, middle, seconds in zip(seen.labels, seen.time, seen.duration, strict=True):
        within[label] = left & (np.abs(time - middle) <= seconds / 2)
        left &= ~within[label]
    within[_MOVES] = left
    chosen = {label: rows[at] for label, at in within.items() if at.any()}
    count = np.array([len(some) for some in chosen.values()])
    mean = np.array([some.mean(axis=0) for some in chosen.values()]).reshape(-1, 3)
    rms = np.sqrt([np.square(some).mean(axis=0) for some in chosen.values()]).reshape(-1, 3)
    return ByStep(title, tuple(parts), tuple(chosen), mean * np.sqrt(count)[:, None], rms, count)


@drawing.style
def by_steps(found: Sequence[ByStep]) -> Markup:
    """Return means (left) and sizes (right) of whitened residuals by step."""
    figure, rows = drawing.panels(1.65, [drawing.room_for(one.labels) for one in found], 2)
    for (left, right), one in zip(rows, found, strict=True):
        dots(left, one.mean, one.parts, band=True)
        dots(right, one.rms - 1, one.parts, band=False)
        reach = BEYOND / np.sqrt(2 * one.members)
        at = np.arange(one.members.size)
        right.bar(at, 2 * reach, 1.0, -reach, color=BAND, lw=0, zorder=0)
        right.axhline(0, color=FAINT, lw=0.8, zorder=0)
        worst = beyond(one.mean)
        for axes in (left, right):
            drawing.name_positions(axes, one.labels, worst=worst)
        left.set_title(one.title)
        left.set_ylabel("mean, its standard deviations")
        right.set_ylabel("rms beyond 1")
        drawing.key(right)
    return svg(figure, "residuals", "Means and sizes of whitened residuals by step")
