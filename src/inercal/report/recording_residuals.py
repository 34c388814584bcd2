"""Summarise residuals by step, for methods that use all samples of a recording.

A recording has tens of thousands of whitened residuals r with variance 1, too many to show one by
one. If the model is right, the n residuals of a step satisfy:

    √n mean(r)    differs from 0 by about 1; more means a bias or an angle that does not fit
    rms(r)        differs from 1 by about 1/√(2n); more means that the noise is not as stated
"""
# matplotlib's stubs leave **kwargs untyped.
# pyright: reportUnknownMemberType=false

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from markupsafe import Markup
from numpy.typing import NDArray

from inercal.basics.arrays import Array
from inercal.benches.turntable import is_turntable
from inercal.pipeline import Outcome
from inercal.report import drawing
from inercal.report.drawing import BAND, FAINT, svg
from inercal.report.figures import BAND_LIMIT, draw_dots, rows_beyond_band

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
