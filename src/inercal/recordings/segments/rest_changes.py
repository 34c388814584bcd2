"""Decide from the changes of readings within sections at rest whether the sensor was still.

A section is cut into ten blocks. The sensor moved if, in some channel, the block means cover a
larger range than noise, quantisation and slow changes of a sensor at rest can explain:

    ptp(means) > max(20 s, 10 s₁/√n, min(10 s₁, 100 s), 3 r, 2.5 q, floor)

Here s₁ is the median scatter within the section's blocks of n samples, and s is the median of s₁
over all sections. r is the median range over all sections, because a drift common to all sections
is not motion. q is the channel's smallest step. With white noise of any size the range stays below
5 s₁/√n, and with noise correlated over a block below 5 s₁.

For a hand-held sensor, a change perpendicular to gravity may be a tilt, which the gyros measure.
The difference between the mean attitudes of the two halves is the rate, integrated with a weight w
that rises from 0 to 1 during the first half and falls back to 0 during the second. To first order
in the rotation,

    mean₂ θ − mean₁ θ = ∫ w ω dt

For two parts of unequal length with a gap between them, the weight stays 1 between the parts.

If a bias steps during a rest, the rest detection cuts the rest there and uses the longer part. The
result is then correct, but the sensor has a fault. Such parts of one still run are compared in the
same way.
"""

from collections.abc import Collection, Sequence

import numpy as np

from inercal.basics.arrays import Array, median_of_rows
from inercal.basics.errors import InputError
from inercal.basics.units import format_quantity
from inercal.estimation import ModelTest
from inercal.estimation.section_statistics import largest_change_test
from inercal.physics.quantities import QUANTITIES
from inercal.physics.sensors import G0, Sensor, nominal_inverse
from inercal.recordings import Finding, Mark, Recording, sample_count
from inercal.recordings.io.column_table import row_blocks
from inercal.recordings.observations import HalfSectionChanges

_BLOCK_COUNT = 10
_USUAL = 20.0  # scatters; a half-way step of this size adds ten times the noise variance squared
_OWN_SCATTER_FACTOR = 10.0
_LARGE = 100.0  # usual scatters; the noise in one position does not exceed the others by this much
_COMMON, _MIN_SECTIONS = 3.0, 4  # times the usual range; sections that define it
_QUANTA = 2.5
_SINGLE = 5.0  # times as far from the median as any other sample: a wrong digit, not a motion
# Smaller changes are not motion, however quiet the sensor: 0.1 mrad of tilt, 2 °/h.
_FLOOR = {"f": 1e-4 * G0, "w": 1e-5}


def require_still(
    recording: Recording,
    sensor: Sensor,
    marks: Sequence[Mark],
    accepted: Collection[str] = (),
) -> tuple[Finding, ...]:
    """Refuse any section at rest in which the sensor moves.

    Parameters
    ----------
    recording : Recording
        Recording, with or without trial axes.
    sensor : Sensor
        Sensor whose readout converts to SI units.
    marks : sequence of Mark
        Marks of rests; rests with fewer than 20 samples are not checked.
    accepted : collection of str
        Labels of sections that the user accepts although they move.

    Returns
    -------
    tuple of Finding
        A warning for each accepted section in which the sensor moves.

    Raises
    ------
    InputError
        The sensor moves in a section, or an accepted label does not mark any section or marks a
        still one.
    """
    if unknown := [label for label in accepted if label not in {mark.label for mark in marks}]:
        raise InputError(
            f"{recording.source}: [data] accept_moving names {unknown[0]!r}, which is not a "
            f"rest; the rests are {', '.join(mark.label for mark in marks)}",
            key="[data] accept_moving",
            names=tuple(unknown),
        )
    marks = [mark for mark in marks if mark.stop - mark.start >= 2 * _BLOCK_COUNT]
    if not marks:
        return ()
    columns = [recording.channels.index(name) for name in sensor.channels]
    size = [(mark.stop - mark.start) // _BLOCK_COUNT for mark in marks]
    judged = [
        _block_statistics(recording, sensor, columns, mark, n)
        for mark, n in zip(marks, size, strict=True)
    ]
    means, scatters = (np.stack(one) for one in zip(*judged, strict=True))
    # (sections, trials, axes)
    reach, own = np.ptp(means, axis=2), median_of_rows(np.moveaxis(scatters, 2, 0))
    usual = median_of_rows(own)
    of_means = own / np.sqrt(np.array(size))[:, None, None]
    fixed = [
        max(_FLOOR[axis.measures], _QUANTA * _step(recording, column) / abs(axis.readout.scale))
        for axis, column in zip(sensor.axes, columns, strict=True)
    ]
    limit = np.maximum(np.maximum(_USUAL * usual, fixed), _OWN_SCATTER_FACTOR * of_means)
    limit = np.maximum(limit, np.minimum(_OWN_SCATTER_FACTOR * own, _LARGE * usual))
    if len(marks) >= _MIN_SECTIONS:
        limit = np.maximum(limit, _COMMON * median_of_rows(reach))
    findings: list[Finding] = []
    refused: list[tuple[float, str, str]] = []
    for mark, changes, most in zip(marks, reach, limit, strict=True):
        trial, k = np.unravel_index(int(np.argmax(changes / most)), changes.shape)
        change, allowed = float(changes[trial, k]), float(most[trial, k])
        if change <= allowed:
            if mark.label in accepted:
                raise InputError(
                    f"{recording.source}: [data] accept_moving names {mark.label!r}, which does "
                    "not move: remove it",
                    key="[data] accept_moving",
                    names=(mark.label,),
                )
            continue
        axis = sensor.axes[int(k)]
        shown, explained = (
            format_quantity(size, 0.0, QUANTITIES[axis.measures].reading_unit, 3)
            for size in (change, allowed)
        )
        text = (
            f"section {mark.label} moves: its mean changes by {shown} ({axis.name}), but noise "
            f"and quantisation explain at most {explained}"
        )
        if mark.label in accepted:
            message = f"{text}; [data] accept_moving accepts it"
            findings.append(Finding("warning", "moving", message, None, mark.start, mark.stop))
        else:
            advice = "mark only the time at rest, or name the section in [data] accept_moving"
            text = _single_sample(recording, columns[int(k)], mark) or f"{text}; {advice}"
            refused.append((change / allowed, text, mark.label))
    if refused:
        _, text, label = max(refused)
        raise InputError(f"{recording.source}: {text}", names=(label,))
    return tuple(findings)


def _single_sample(recording: Recording, column: int, mark: Mark) -> str:
    """Describe the sample that is far from all others of a section; empty if there is none."""
    values = recording.data[..., mark.start : mark.stop, column]
    away = np.abs(values - np.median(values)).ravel()
    near, most = np.partition(away, -2)[-2:]
    if values.ndim > 1 or most < _SINGLE * near:
        return ""
    at = int(np.argmax(away))
    return (
        f"section {mark.label}: the reading of {recording.channels[column]} at "
        f"{recording.time[mark.start + at]:.6g} s, {values[at]:.6g}, is far from all others of "
        "this section; correct it, or remove its row"
    )


def _block_statistics(
    recording: Recording, sensor: Sensor, columns: Sequence[int], mark: Mark, n: int
) -> tuple[Array, Array]:
    """Return the means of a section's blocks, and their scatters, (trials, blocks, m) each, SI.

    If there is no trial axis, there is one trial.
    """
    data = recording.data[..., mark.start : mark.start + _BLOCK_COUNT * n, columns]
    parts = sensor.to_si(data).reshape(-1, _BLOCK_COUNT, n, len(columns))
    means = np.asarray(parts.mean(axis=2))
    return means, np.sqrt(np.mean((parts - means[:, :, None]) ** 2, axis=2))


def _step(recording: Recording, column: int) -> float:
    """Return a channel's smallest change between samples, output units; 0 if it is constant."""
    least = np.inf
    for k in row_blocks(recording.time.size - 1):
        steps = np.abs(np.diff(recording.data[..., k.start : k.stop + 1, column], axis=-1))
        least = min(least, float(np.min(steps, initial=np.inf, where=steps > 0)))
    return least if np.isfinite(least) else 0.0


_BLOCK = 0.25  # s
_KNOWN = 0.1  # relative error of a rotation measured by nominal gyros


def changes_within_rests(
    recording: Recording, sensor: Sensor, marks: Sequence[Mark]
) -> HalfSectionChanges:
    """Return the change of the readings from the first to the second half of each rest.

    Parameters
    ----------
    recording : Recording
        Recording without a trial axis.
    sensor : Sensor
        Sensor whose axes name the channels.
    marks : sequence of r Mark
        Marks of the rests, each with at least two samples.
    """
    parts = [(m.start, (m.start + m.stop) // 2, (m.start + m.stop) // 2, m.stop) for m in marks]
    return changes_between_parts(recording, sensor, parts)


def changes_between_parts(
    recording: Recording, sensor: Sensor, parts: Sequence[tuple[int, int, int, int]]
) -> HalfSectionChanges:
    """Return the change of the readings from each part to a later part.

    Parameters
    ----------
    recording : Recording
        Recording without a trial axis.
    sensor : Sensor
    parts : sequence of r (start, stop, start, stop)
        Half-open sample ranges of both parts.
    """
    columns = [recording.channels.index(name) for name in sensor.channels]
    change, integral = np.empty((2, len(parts), len(columns)))
    seconds, square = np.empty((2, len(parts)))
    for k, (a, b, c, d) in enumerate(parts):
        y = recording.data[a:d, columns]
        change[k] = y[c - a :].mean(axis=0) - y[: b - a].mean(axis=0)
        step = recording.span(a, d) / (d - a)
        up, down = (np.arange(n) + 0.5 for n in (b - a, d - c))
        weight = np.concatenate([up / (b - a), np.ones(c - b), 1 - down / (d - c)]) * step
        integral[k], seconds[k], square[k] = weight @ y, weight.sum(), weight @ weight
    t, warming = recording.temperature, None
    if t is not None:
        warming = np.array([t[c:d].mean() - t[a:b].mean() for a, b, c, d in parts])
    return HalfSectionChanges(change, integral, seconds, square, warming)


def bias_jump_test(
    recording: Recording,
    sensor: Sensor,
    marks: Sequence[Mark],
    other_parts: Sequence[tuple[int, tuple[int, int]]],
) -> tuple[ModelTest, ...]:
    """Test rests that were cut because the readings changed without a rotation.

    Parameters
    ----------
    recording : Recording
        Recording without a trial axis.
    sensor : Sensor
        Sensor with at least three accelerometers, and gyros, in the nominal model.
    marks : sequence of Mark
        Marks of all rests.
    other_parts : sequence of (rest, (start, stop))
        Numbers of the rests that are part of a longer still run, each with the samples of the other
        part.
    """
    force, rate = sensor.select_axes("f"), sensor.select_axes("w")
    if not (other_parts and rate.axes):
        return ()
    m = len(force.axes)
    back, of_rate = nominal_inverse(force.axes)[:, :3], nominal_inverse(rate.axes)[:, 3:6]
    columns = [recording.channels.index(name) for name in sensor.channels]
    whole = [sensor.to_si(recording.data[mark.start : mark.stop, columns]) for mark in marks]
    bias = np.mean([section[:, m:].mean(axis=0) for section in whole], axis=0)
    block = max(sample_count(_BLOCK, recording.median_step), 1)
    scatter = [_block_mean_variance(section[:, :m] @ back, block) for section in whole]
    usual = float(np.median([one for one in scatter if one > 0] or [0.0]))
    wander = np.std([(section[:, m:].mean(axis=0) - bias) @ of_rate for section in whole], axis=0)

    parts, variance = list[tuple[int, int, int, int]](), np.empty(len(other_parts))
    for k, (at, (start, stop)) in enumerate(other_parts):
        own = (marks[at].start, marks[at].stop)
        parts.append((*own, start, stop) if own[0] < start else (start, stop, *own))
        variance[k] = usual * block * (1 / (stop - start) + 1 / (own[1] - own[0]))
    halves = changes_between_parts(recording, sensor, parts)
    # The only offset in differences and integrals is the readout's, which the bias also contains.
    scale = np.array([axis.readout.scale for axis in sensor.axes])
    zero = np.array([axis.readout.offset for axis in sensor.axes])
    integral = (halves.integral - halves.seconds[:, None] * zero) / scale
    turn = (integral[:, m:] - halves.seconds[:, None] * bias) @ of_rate
    specific_force = np.stack([whole[at][:, :m].mean(axis=0) @ back for at, _ in other_parts])
    change = (halves.change / scale)[:, :m] @ back - np.cross(specific_force, turn)
    size = np.linalg.norm(specific_force, axis=1)
    open_ = _KNOWN * np.linalg.norm(turn, axis=1) + halves.seconds * float(np.linalg.norm(wander))
    variance += (size * open_) ** 2
    by_channel = change @ np.linalg.pinv(back)
    worst: list[int] = np.argmax(np.abs(by_channel), axis=1).tolist()
    labels = [marks[at].label for at, _ in other_parts]
    names = [force.axes[k].name for k in worst]
    return (largest_change_test(change, variance, labels, names),)


def _block_mean_variance(f: Array, block: int) -> float:
    """Return the mean variance of the means of complete blocks; 0 for fewer than two blocks."""
    count = len(f) // block
    if count < 2:
        return 0.0
    means = f[: count * block].reshape(count, block, -1).mean(axis=1)
    return float(means.var(axis=0, ddof=1).mean())
