"""Detect the rests of a hand-held sensor from the signal only: no plan, unit or setting is needed.

A sample is at rest if the scatter of each kind of axis is below that kind's threshold
(`inercal.recordings.segments.motion_thresholds`).

Runs of such samples are trimmed at both ends, where the hand grips and lets go. A slow steady turn
is also quiet. Each run is therefore reduced to the longest part in which the quarter-second means
are stable. The means of the accelerometers must be within five deviations of the run's median. The
deviation is the median over all runs; it is at least the scatter at rest and at most the threshold.
The means of the gyros must be within their threshold of their usual mean. A run is discarded if
less than half of it remains. Rests are not accepted if they make up less than 5 % of the quiet
samples.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from inercal.basics.arrays import Array, Indices, true_ranges
from inercal.basics.errors import InputError
from inercal.basics.units import format_count, format_duration, format_number
from inercal.physics.quantities import QUANTITIES
from inercal.physics.sensors import Sensor
from inercal.recordings import Finding, Mark, Recording
from inercal.recordings.segments.motion_thresholds import (
    WINDOW,
    MotionThreshold,
    WeightedAxes,
    axis_kinds,
    gapless_segments,
    motion_threshold,
    summed_variance,
    window_samples,
)
from inercal.recordings.segments.section_means import MIN_SAMPLES

MARGIN = (0.25, 0.4)  # s cut off at both ends of a run: 10 % of it, within these limits
SHORTEST = 0.5  # s that must remain; this is what remains of a rest of 1.5 s
_HELD = 0.05  # of the quiet time; in steady motion, single still moments are not rests
_SETTLED = 5.0  # deviations of the means; white noise and the sway of a hand stay within 3.5


@dataclass(frozen=True)
class RestDetection:
    """Detected rests, with the thresholds that were used.

    Parameters
    ----------
    marks : tuple of Mark
        Rests "r01", "r02", …, sorted by time.
    levels : tuple of MotionThreshold
        Scatter and threshold for each kind of axis.
    window : float
        Length of the scatter window, s.
    finding : Finding
        A note with the number, lengths and scatter of the rests.
    other_parts : tuple of (rest, (start, stop))
        For rests that are only part of a still run: their number, from 0, and the samples of the
        other part of the run, in which the sensor is also still.
    """

    marks: tuple[Mark, ...]
    levels: tuple[MotionThreshold, ...]
    window: float
    finding: Finding
    other_parts: tuple[tuple[int, tuple[int, int]], ...] = ()


def find_rests(recording: Recording, sensor: Sensor) -> RestDetection:
    """Detect the rests in a recording.

    Parameters
    ----------
    recording : Recording
        Recording without a trial axis.
    sensor : Sensor
        Sensor whose axes name the channels; its scales weight the axes of each kind.

    Raises
    ------
    InputError
        The recording has a trial axis or is too short, the sensor has no axis, rest and motion
        cannot be distinguished, or there is no rest.
    """
    kinds = axis_kinds(recording, sensor)
    window, segments = window_samples(recording), gapless_segments(recording)
    rate = recording.rate_hz
    longest = int((segments[:, 1] - segments[:, 0]).max())
    if longest < 4 * window:
        raise InputError(
            f"{recording.source}: {format_duration(longest / rate)} without a gap is too short "
            f"to detect rests; record at least {format_duration(4 * window / rate)}"
        )
    judged = [motion_threshold(recording, kind, segments, window) for kind in kinds]
    levels = tuple(level for level, _ in judged)
    if not any(np.isfinite(level.threshold) for level in levels):
        scatters = " and ".join(
            f"{format_number(level.quiet, 2)} {level.unit} ({QUANTITIES[level.kind].sensors})"
            for level in levels
        )
        raise InputError(
            f"{recording.source}: rest and motion cannot be distinguished, because all samples "
            f"have the same scatter, {scatters}; record rests in several positions"
        )
    margin, most = (max(round(limit * rate), 1) for limit in MARGIN)
    shortest = max(round(SHORTEST * rate), MIN_SAMPLES)
    limits = [
        summed_variance(level.threshold, kind) for level, kind in zip(levels, kinds, strict=True)
    ]
    from inercal.recordings.segments import _kernels  # loads Numba

    found = _kernels.rest_runs(
        recording.data,
        np.concatenate([kind.columns for kind in kinds]),
        np.concatenate([kind.weight for kind in kinds]),
        np.cumsum([kind.columns.size for kind in kinds]),
        np.array(limits),
        segments,
        window,
        shortest + 2 * margin,
    )
    trimmed = np.clip((found[:, 1] - found[:, 0]) // 10, margin, most)
    found[:, 0] += trimmed
    found[:, 1] -= trimmed
    settled = (
        _stationary_parts(recording.data, found, kinds, levels, window // 2)
        if len(found)
        else found
    )
    long_enough = settled[:, 1] - settled[:, 0] >= shortest
    kept = settled[long_enough]
    crept = len(found) - len(kept)
    held = float((kept[:, 1] - kept[:, 0]).sum()) / recording.time.size
    if held <= _HELD * min(share for _, share in judged):
        raise InputError(
            f"{recording.source}: no rest of "
            f"{format_duration((shortest + 2 * margin) / rate + WINDOW)} was found: there are "
            "only short quiet moments between moves"
            + (f", and in {crept} quiet sections the sensor turned slowly" if crept else "")
            + "".join(f"; {level.words}" for level in levels)
            + "; hold each position longer"
        )
    width = max(len(str(len(kept))), 2)
    marks = tuple(
        Mark(f"r{k:0{width}d}", start, stop) for k, (start, stop) in enumerate(kept.tolist(), 1)
    )
    shortened = int((settled != found).any(axis=1).sum()) - crept
    finding = Finding("note", "rests", _detection_text(recording, marks, levels, crept, shortened))
    others = _other_parts(
        recording.data, found[long_enough], kept, kinds, levels, window // 2, shortest
    )
    return RestDetection(marks, levels, window / rate, finding, others)


def _other_parts(
    data: Array,
    found: Indices,
    kept: Indices,
    kinds: Sequence[WeightedAxes],
    levels: Sequence[MotionThreshold],
    block: int,
    shortest: int,
) -> tuple[tuple[int, tuple[int, int]], ...]:
    """Return the longer remaining part of each run that was cut, if the sensor is still in it."""
    rests: dict[int, tuple[int, int]] = {}
    for k, ((start, stop), (first, last)) in enumerate(
        zip(found.tolist(), kept.tolist(), strict=True)
    ):
        part = max((start, first), (last, stop), key=lambda one: one[1] - one[0])
        if part[1] - part[0] >= shortest:
            rests[k] = part
    if not rests:
        return ()
    runs = np.concatenate([kept, [*rests.values()]])
    parts = _stationary_parts(data, runs, kinds, levels, block)[len(kept) :].tolist()
    return tuple(
        (k, (start, stop))
        for k, (start, stop) in zip(rests, parts, strict=True)
        if stop - start >= shortest
    )


def _stationary_parts(
    data: Array,
    found: Indices,
    kinds: Sequence[WeightedAxes],
    levels: Sequence[MotionThreshold],
    block: int,
) -> Indices:
    """Return the longest part of each run without a slow turn, (r, 2).

    The part is empty if it is shorter than half of the run.
    """
    good = [np.ones((stop - start) // block, np.bool_) for start, stop in found.tolist()]
    for kind, level in zip(kinds, levels, strict=True):
        if not np.isfinite(level.threshold):
            continue
        means = [_block_means(data, run, kind, block) for run in found.tolist()]
        middles = [np.median(mean, axis=0) for mean in means]
        if kind.kind == "f":
            off = [
                float(np.mean((mean - middle) ** 2 @ kind.weight))
                for mean, middle in zip(means, middles, strict=True)
            ]
            limit = max(_SETTLED**2 * float(np.median(off)), summed_variance(level.quiet, kind))
            limit = min(limit, summed_variance(level.threshold, kind))
        else:
            limit = summed_variance(level.threshold, kind)
            middles = [np.median(middles, axis=0)] * len(middles)
        for near, mean, middle in zip(good, means, middles, strict=True):
            near &= (mean - middle) ** 2 @ kind.weight < limit
    settled = found.copy()
    for k, near in enumerate(good):
        if not near.all():
            parts = true_ranges(near)
            longest = parts[np.argmax(parts[:, 1] - parts[:, 0])] if len(parts) else (0, 0)
            enough = 2 * (longest[1] - longest[0]) >= near.size
            settled[k] = found[k, 0] + block * np.array(longest if enough else (0, 0))
    return settled


def _block_means(data: Array, run: Sequence[int], kind: WeightedAxes, block: int) -> Array:
    """Return the means of the complete blocks of a run, (blocks, axes), without copying data."""
    start, stop = run
    end = start + (stop - start) // block * block
    parts = [data[start:end, column].reshape(-1, block) for column in kind.columns.tolist()]
    return np.stack([part.mean(axis=1) for part in parts], axis=1)


def _detection_text(
    recording: Recording,
    marks: Sequence[Mark],
    levels: Sequence[MotionThreshold],
    crept: int,
    shortened: int,
) -> str:
    seconds = [recording.span(mark.start, mark.stop) for mark in marks]
    ends = dict.fromkeys(map(format_duration, (min(seconds), max(seconds))))
    share = 100 * sum(seconds) / recording.duration
    parts = [
        f"{format_count(len(marks), 'rest')} of {' to '.join(ends)} detected, {share:.0f} % of time"
    ]
    parts += [level.words for level in levels]
    if crept:
        parts.append(f"{crept} left out because the sensor turned slowly")
    if shortened:
        parts.append(f"{shortened} shortened because the sensor turned slowly at an end")
    return "; ".join(parts)


def find_thresholds(recording: Recording, sensor: Sensor) -> tuple[MotionThreshold, ...]:
    """Return each kind's scatter, with the threshold that is used to detect rests."""
    window, segments = window_samples(recording), gapless_segments(recording)
    kinds = axis_kinds(recording, sensor)
    return tuple(motion_threshold(recording, kind, segments, window)[0] for kind in kinds)
