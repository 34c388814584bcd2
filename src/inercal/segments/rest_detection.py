"""Rests of a sensor that is moved by hand, found in the signal alone: no plan, no unit, no setting.

A sample is at rest where the scatter of each kind of axis is below the kind's threshold
(`inercal.segments.motion_thresholds`).

The runs at rest are cut at both ends, for the hand lets go. A slow steady turn is quiet too, hence
runs are kept only as far as the means of quarter seconds stay near: the accelerometers' around the
run's median within five of their deviations from it, pooled over the runs by their median (at least
the scatter of rest, at most the threshold), the gyros' around their usual mean within their
threshold. A run that keeps less than half is left out. Rests that hold less than a twentieth of
what is quiet are none.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from inercal.arrays import Array
from inercal.errors import InputError
from inercal.recording import Finding, Mark, Recording
from inercal.segments import _kernels
from inercal.segments.motion_thresholds import (
    KIND_NAMES,
    WINDOW,
    MotionThreshold,
    WeightedAxes,
    axis_kinds,
    gapless_segments,
    motion_threshold,
    summed_variance,
    window_samples,
)
from inercal.segments.section_means import MIN_SAMPLES
from inercal.sensors import Sensor

Indices = NDArray[np.int64]

MARGIN = (0.25, 0.4)  # s cut off both ends of a run: a tenth of it, within these limits
SHORTEST = 0.5  # s that are left at least; a rest of 1.5 s leaves that much
_HELD = 0.05  # of the quiet time: in steady motion a still moment here and there is no rest
_SETTLED = 5.0  # deviations of the means; white noise and a hand's sway stay within 3.5


@dataclass(frozen=True)
class RestDetection:
    """Rests that were found, and by what.

    Parameters
    ----------
    marks : tuple of Mark
        "r01", "r02", … in the order of time.
    levels : tuple of MotionThreshold
        Of each kind that the sensor has.
    window : float
        s.
    finding : Finding
        A note that says how many, how long and how quiet.
    other_parts : tuple of (rest, (start, stop))
        Of rests, by their number from 0, that are a part of a still run: samples of the other part
        that is still by itself.
    """

    marks: tuple[Mark, ...]
    levels: tuple[MotionThreshold, ...]
    window: float
    finding: Finding
    other_parts: tuple[tuple[int, tuple[int, int]], ...] = ()


def find_rests(recording: Recording, sensor: Sensor) -> RestDetection:
    """Return the rests of a recording.

    Parameters
    ----------
    recording : Recording
        Without a trial axis.
    sensor : Sensor
        Its axes name the channels; the scales of a kind's axes weigh them against one another.

    Raises
    ------
    InputError
        A trial axis, no axis, a recording too short to judge, rest and motion that cannot be told
        apart, or no rest.
    """
    kinds = axis_kinds(recording, sensor)
    window, segments = window_samples(recording), gapless_segments(recording)
    rate = recording.rate_hz
    longest = int((segments[:, 1] - segments[:, 0]).max())
    if longest < 4 * window:
        raise InputError(
            f"{recording.source}: {longest / rate:.2g} s without a gap are too short to find rests "
            f"in; {4 * window / rate:.2g} s are needed"
        )
    judged = [motion_threshold(recording, kind, segments, window) for kind in kinds]
    levels = tuple(level for level, _ in judged)
    if not any(np.isfinite(level.threshold) for level in levels):
        scatters = " and ".join(
            f"{level.quiet:.2g} {level.unit} ({KIND_NAMES[level.kind]})" for level in levels
        )
        raise InputError(
            f"{recording.source}: rest and motion cannot be distinguished: "
            f"all samples scatter equally, "
            f"{scatters}; rests in several positions are needed"
        )
    margin, most = (max(round(limit * rate), 1) for limit in MARGIN)
    shortest = max(round(SHORTEST * rate), MIN_SAMPLES)
    limits = [
        summed_variance(level.threshold, kind) for level, kind in zip(levels, kinds, strict=True)
    ]
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
            f"{recording.source}: no rest of {(shortest + 2 * margin) / rate + WINDOW:.2g} s is "
            "found: what is quiet lies scattered between moves"
            + (f", and in {crept} quiet sections the sensor turned slowly" if crept else "")
            + "".join(f"; {_threshold_text(level)}" for level in levels)
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
    """Return the longer rest of each run that was cut, where it is still by itself."""
    places: list[int] = []
    rests: list[tuple[int, int]] = []
    for k, ((start, stop), (first, last)) in enumerate(
        zip(found.tolist(), kept.tolist(), strict=True)
    ):
        part = max((start, first), (last, stop), key=lambda one: one[1] - one[0])
        if part[1] - part[0] >= shortest:
            places.append(k)
            rests.append(part)
    if not rests:
        return ()
    settled = _stationary_parts(data, np.concatenate([kept, np.array(rests)]), kinds, levels, block)
    parts = settled[len(kept) :].tolist()
    return tuple(
        (k, (start, stop))
        for k, (start, stop) in zip(places, parts, strict=True)
        if stop - start >= shortest
    )


def _stationary_parts(
    data: Array,
    found: Indices,
    kinds: Sequence[WeightedAxes],
    levels: Sequence[MotionThreshold],
    block: int,
) -> Indices:
    """Return the longest part of each run without a creep or a steady turn, (r, 2).

    Empty where that is less than half of the run.
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
            edges = np.flatnonzero(np.diff(np.r_[False, near, False].astype(np.int8)))
            parts = edges.reshape(-1, 2)
            longest = parts[np.argmax(parts[:, 1] - parts[:, 0])] if len(parts) else (0, 0)
            enough = 2 * (longest[1] - longest[0]) >= near.size
            settled[k] = found[k, 0] + block * np.array(longest if enough else (0, 0))
    return settled


def _block_means(data: Array, run: Sequence[int], kind: WeightedAxes, block: int) -> Array:
    """Return the means of the whole blocks of a run, (blocks, axes); nothing is copied."""
    start, stop = run
    whole = start + (stop - start) // block * block
    parts = [data[start:whole, column].reshape(-1, block) for column in kind.columns.tolist()]
    return np.stack([part.mean(axis=1) for part in parts], axis=1)


def _detection_text(
    recording: Recording,
    marks: Sequence[Mark],
    levels: Sequence[MotionThreshold],
    crept: int,
    shortened: int,
) -> str:
    seconds = [recording.span(mark.start, mark.stop) for mark in marks]
    low, high = (f"{s:.2g}" for s in (min(seconds), max(seconds)))
    share = 100 * sum(seconds) / recording.duration
    length = f"{low} s" if low == high else f"{low} to {high} s"
    parts = [f"{len(marks)} rest{'s' * (len(marks) > 1)} of {length} found, {share:.0f} % of time"]
    parts += map(_threshold_text, levels)
    if crept:
        parts.append(f"{crept} in which the sensor turned slowly left out")
    if shortened:
        parts.append(f"{shortened} shortened, as the sensor turned slowly at an end")
    return "; ".join(parts)


def _threshold_text(level: MotionThreshold) -> str:
    limit = f"threshold {level.threshold:.3g} {level.unit}"
    if not np.isfinite(level.threshold):
        limit = "no threshold, as rest and motion scatter alike"
    return f"scatter at rest {level.quiet:.3g} {level.unit}, {limit} ({KIND_NAMES[level.kind]})"


def find_thresholds(recording: Recording, sensor: Sensor) -> tuple[MotionThreshold, ...]:
    """Return how each kind of axis scatters, and by which threshold rests would be found."""
    window, segments = window_samples(recording), gapless_segments(recording)
    kinds = axis_kinds(recording, sensor)
    return tuple(motion_threshold(recording, kind, segments, window)[0] for kind in kinds)
