"""Rests of a sensor that is moved by hand, found in the signal alone: no plan, no unit, no setting.

For each kind of axis (accelerometers, gyros) the statistic is v, the variance over a sliding
window of half a second summed over the axes. A sample is at rest where v of each kind is below the
kind's threshold, which splits a histogram of log v into two classes by Otsu's criterion (1979,
IEEE Trans. SMC 9(1), 62–66): the split t with the largest variance between the classes,

    n₁(t) n₂(t) (m₁(t) − m₂(t))²,   n the number and m the mean of log v below and above t;

where the bins between two classes are empty, their middle. log v makes it free of units, and puts
the threshold about half-way, in decades, between rest and motion. Minimum-error thresholding
(Kittler & Illingworth 1986, Pattern Recognition 19, 41–47) was tried first. It puts the threshold
where the narrow peak of rest ends, and so breaks rests at the least tremor: 44 rests instead of 38
in a log of an Xsens MTi, 17 instead of 22 of an MPU-9150 held now by hand, now by a table. In 48
simulated sessions (at rest for 10–95 % of the time, tremor, coarse steps, a noisy axis) it missed
rests in 8, Otsu's in 3: those with a heavy tremor after a rest on a table. What guards Otsu's:

- Where v stays within a ratio of 4, it is counted for two seconds only, and the outer twentieths
  of the counts are moved inwards: neither one long rest nor one shock makes a class.
- v counts as at least that of the rounding, Σ q²/12 with q the smallest step of an axis: a coarse
  axis may stand dead still.
- Classes whose mean scatters differ by less than a ratio of 1.75 are one class. White noise gives
  1.1, a hand's sway in one position 1.5. That kind has no say; if none has, there is no threshold.

The runs at rest are cut at both ends, for the hand lets go. A slow steady turn is quiet too, hence
runs are kept only as far as the means of quarter seconds stay near: the accelerometers' around the
run's median within five of their deviations from it, pooled over the runs by their median (at least
the scatter of rest, at most the threshold), the gyros' around their usual mean within their
threshold. A run that keeps less than half is left out. Rests that hold less than a twentieth of
what is quiet are none.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import exp, log, sqrt
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from inercal.errors import InputError
from inercal.recording import Finding, Mark, Recording
from inercal.segments import _kernels
from inercal.segments.average import MIN_SAMPLES
from inercal.sensors import Sensor

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
Kind = Literal["f", "w"]

WINDOW = 0.5  # s over which scatter is judged
MARGIN = (0.25, 0.4)  # s cut off both ends of a run: a tenth of it, within these limits
SHORTEST = 0.5  # s that are left at least; a rest of 1.5 s leaves that much
APART = 1.75  # ratio of the classes' mean scatters
NAMES: dict[Kind, str] = {"f": "accelerometers", "w": "gyros"}
_STAY = 2.0  # s for which a level is counted
_OUTER = 0.05
_BINS = 512
_SPAN = 1e14  # of v; rounding of the sums is below, and 24 bits are within
_MOVING = 0.01  # of its samples differ from the last one: else an axis is dead, not coarse
_HELD = 0.05  # of the quiet time: in steady motion a still moment here and there is no rest
_SETTLED = 5.0  # deviations of the means; white noise and a hand's sway stay within 3.5


@dataclass(frozen=True)
class Level:
    """How much one kind of axis scatters over a window: root mean square over its axes.

    Parameters
    ----------
    kind : "f" or "w"
    unit : str
        Output unit of the numbers.
    quiet, moving : float
        Median at rest and in motion, or the median and largest of all where they are not told
        apart.
    threshold : float
        Infinite where rest and motion of this kind cannot be told apart.
    """

    kind: Kind
    unit: str
    quiet: float
    moving: float
    threshold: float


@dataclass(frozen=True)
class Rests:
    """Rests that were found, and by what.

    Parameters
    ----------
    marks : tuple of Mark
        "r01", "r02", … in the order of time.
    levels : tuple of Level
        Of each kind that the sensor has.
    window : float
        s.
    finding : Finding
        A note that says how many, how long and how quiet.
    """

    marks: tuple[Mark, ...]
    levels: tuple[Level, ...]
    window: float
    finding: Finding


def find_rests(recording: Recording, sensor: Sensor) -> Rests:
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
    kinds = _kinds(recording, sensor)
    window, segments = _window(recording), _segments(recording)
    rate = recording.rate_hz
    longest = int((segments[:, 1] - segments[:, 0]).max())
    if longest < 4 * window:
        raise InputError(
            f"{recording.source}: {longest / rate:.2g} s without a gap are too short to find rests "
            f"in; {4 * window / rate:.2g} s are needed"
        )
    judged = [_level(recording, kind, segments, window) for kind in kinds]
    levels = tuple(level for level, _ in judged)
    if not any(np.isfinite(level.threshold) for level in levels):
        scatters = " and ".join(
            f"{level.quiet:.2g} {level.unit} ({NAMES[level.kind]})" for level in levels
        )
        raise InputError(
            f"{recording.source}: rest and motion cannot be told apart: all samples scatter alike, "
            f"{scatters}, as in one position only; rests in several positions are needed"
        )
    margin, most = (max(round(limit * rate), 1) for limit in MARGIN)
    shortest = max(round(SHORTEST * rate), MIN_SAMPLES)
    found = _kernels.runs(
        recording.data,
        np.concatenate([kind.columns for kind in kinds]),
        np.concatenate([kind.weight for kind in kinds]),
        np.cumsum([kind.columns.size for kind in kinds]),
        np.array([_sum(level.threshold, kind) for level, kind in zip(levels, kinds, strict=True)]),
        segments,
        window,
        shortest + 2 * margin,
    )
    trimmed = np.clip((found[:, 1] - found[:, 0]) // 10, margin, most)
    found[:, 0] += trimmed
    found[:, 1] -= trimmed
    settled = _settled(recording.data, found, kinds, levels, window // 2) if len(found) else found
    kept = settled[settled[:, 1] - settled[:, 0] >= shortest]
    crept = len(found) - len(kept)
    held = float((kept[:, 1] - kept[:, 0]).sum()) / recording.time.size
    if held <= _HELD * min(share for _, share in judged):
        raise InputError(
            f"{recording.source}: no rest of {(shortest + 2 * margin) / rate + WINDOW:.2g} s is "
            "found: what is quiet lies scattered between moves"
            + (f", and in {crept} quiet sections the sensor turned slowly" if crept else "")
        )
    width = max(len(str(len(kept))), 2)
    marks = tuple(
        Mark(f"r{k:0{width}d}", start, stop) for k, (start, stop) in enumerate(kept.tolist(), 1)
    )
    shortened = int((settled != found).any(axis=1).sum()) - crept
    finding = Finding("note", "rests", _said(recording, marks, levels, crept, shortened))
    return Rests(marks, levels, window / rate, finding)


def scatter(recording: Recording, sensor: Sensor, kind: Kind) -> Array:
    """Return what the thresholds are held against, at each sample: (n,), output units.

    The standard deviation over a window, root mean square over the axes of one kind.

    Parameters
    ----------
    recording : Recording
        Without a trial axis.
    sensor : Sensor
    kind : "f" or "w"

    Raises
    ------
    InputError
        A trial axis, or no axis of this kind.
    """
    for one in _kinds(recording, sensor):
        if one.kind == kind:
            window, segments = _window(recording), _segments(recording)
            v = _kernels.variances(recording.data, one.columns, one.weight, segments, window)
            v /= one.columns.size
            return np.sqrt(v, out=v)
    raise InputError(f"sensor {sensor.name} has no {NAMES[kind]}")


@dataclass(frozen=True, eq=False)
class _Axes:
    """The columns of one kind of axis, with weights that put them on the first one's scale."""

    kind: Kind
    unit: str
    columns: Indices
    weight: Array


def _kinds(recording: Recording, sensor: Sensor) -> list[_Axes]:
    if recording.data.ndim != 2:
        raise InputError(
            f"{recording.source}: rests are found in one recording, not in data of shape "
            f"{recording.data.shape}"
        )
    found: list[_Axes] = []
    for kind in NAMES:
        axes = sensor.only(kind).axes
        if axes:
            columns = np.array([recording.channels.index(axis.name) for axis in axes])
            scale = np.array([axis.readout.scale for axis in axes])
            unit = recording.units[int(columns[0])]
            found.append(_Axes(kind, unit, columns, (scale[0] / scale) ** 2))
    if not found:
        raise InputError(f"sensor {sensor.name} has no axes to find rests by")
    return found


def _window(recording: Recording) -> int:
    return max(round(WINDOW * recording.rate_hz), 4)


def _segments(recording: Recording) -> Indices:
    """Return the ranges of samples between gaps, (s, 2)."""
    after = recording.gaps[:, 1]
    return np.column_stack([np.r_[0, after], np.r_[after, recording.time.size]])


def _level(
    recording: Recording, axes: _Axes, segments: Indices, window: int
) -> tuple[Level, float]:
    """Return the split of one kind's scatter, and which part of the windows is quiet.

    The threshold is infinite where there are no two classes.
    """
    given = (recording.data, axes.columns, axes.weight, segments, window)
    top, step, changes = _kernels.extent(*given)
    coarse = np.where(changes >= _MOVING * recording.time.size, step, 0.0)
    lowest = max(float(axes.weight @ coarse**2) / 12, top / _SPAN)
    if not top > lowest:
        still = float(np.sqrt(top / axes.columns.size))
        return Level(axes.kind, axes.unit, still, still, np.inf), 1.0
    stay = round(_STAY / WINDOW * window)
    counted, every = _kernels.histogram(*given, lowest, top, stay, _BINS)
    width = log(top / lowest) / _BINS
    bins, ratio = _otsu(counted)
    split = bins if ratio * width > 2 * log(APART) else _BINS

    def deviation(place: float) -> float:
        return sqrt(lowest * exp(width * place) / axes.columns.size)

    level = Level(
        axes.kind,
        axes.unit,
        quiet=deviation(_median(every[: int(split)])),
        moving=deviation(split + _median(every[int(split) :]) if split < _BINS else _BINS),
        threshold=deviation(split) if split < _BINS else np.inf,
    )
    return level, float(every[: int(split)].sum()) / float(every.sum())


def _otsu(counts: Indices) -> tuple[float, float]:
    """Return the best split and the distance between the means on either side, in bins."""
    n = _winsorised(counts)
    x = np.arange(n.size) + 0.5
    below = np.cumsum(n)[:-1]
    above = n.sum() - below
    sums = np.cumsum(n * x)
    inside = (below > 0) & (above > 0)
    first = sums[:-1] / np.where(inside, below, 1.0)
    second = (sums[-1] - sums[:-1]) / np.where(inside, above, 1.0)
    distance = np.where(inside, second - first, 0.0)
    between = below * above * distance**2
    best = np.flatnonzero(between >= (1 - 1e-9) * between.max())
    return 1 + 0.5 * float(best[0] + best[-1]), float(distance[best[0]])


def _median(counts: Indices) -> float:
    """Return the middle of the bin of the median."""
    total = np.cumsum(counts)
    return int(np.searchsorted(total, 0.5 * float(total[-1]))) + 0.5


def _winsorised(counts: Indices) -> Array:
    """Return counts whose outer twentieths are moved to the bins where the rest begins."""
    total = np.cumsum(counts)
    low, high = np.searchsorted(total, [_OUTER * total[-1], (1 - _OUTER) * total[-1]])
    n = counts.astype(np.float64)
    n[low] += n[:low].sum()
    n[high] += n[high + 1 :].sum()
    n[:low] = n[high + 1 :] = 0.0
    return n


def _settled(
    data: Array, found: Indices, kinds: Sequence[_Axes], levels: Sequence[Level], block: int
) -> Indices:
    """Return the longest part of each run without a creep or a steady turn, (r, 2).

    Empty where that is less than half of the run.
    """
    good = [np.ones((stop - start) // block, np.bool_) for start, stop in found.tolist()]
    for kind, level in zip(kinds, levels, strict=True):
        if not np.isfinite(level.threshold):
            continue
        means = [_means(data, run, kind, block) for run in found.tolist()]
        middles = [np.median(mean, axis=0) for mean in means]
        if kind.kind == "f":
            off = [
                float(np.mean((mean - middle) ** 2 @ kind.weight))
                for mean, middle in zip(means, middles, strict=True)
            ]
            limit = max(_SETTLED**2 * float(np.median(off)), _sum(level.quiet, kind))
            limit = min(limit, _sum(level.threshold, kind))
        else:
            limit = _sum(level.threshold, kind)
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


def _means(data: Array, run: Sequence[int], kind: _Axes, block: int) -> Array:
    """Return the means of the whole blocks of a run, (blocks, axes); nothing is copied."""
    start, stop = run
    whole = start + (stop - start) // block * block
    parts = [data[start:whole, column].reshape(-1, block) for column in kind.columns.tolist()]
    return np.stack([part.mean(axis=1) for part in parts], axis=1)


def _sum(deviation: float, axes: _Axes) -> float:
    """Return the variance summed over a kind's axes from a standard deviation."""
    return axes.columns.size * deviation**2


def _said(
    recording: Recording,
    marks: Sequence[Mark],
    levels: Sequence[Level],
    crept: int,
    shortened: int,
) -> str:
    seconds = [recording.span(mark.start, mark.stop) for mark in marks]
    low, high = (f"{s:.2g}" for s in (min(seconds), max(seconds)))
    share = 100 * sum(seconds) / recording.duration
    length = f"{low} s" if low == high else f"{low} to {high} s"
    parts = [f"{len(marks)} rest{'s' * (len(marks) > 1)} of {length} found, {share:.0f} % of time"]
    for level in levels:
        limit = f"threshold {level.threshold:.3g} {level.unit}"
        if not np.isfinite(level.threshold):
            limit = "no threshold, as rest and motion scatter alike"
        parts.append(
            f"scatter at rest {level.quiet:.3g} {level.unit}, {limit} ({NAMES[level.kind]})"
        )
    if crept:
        parts.append(f"{crept} in which the sensor turned slowly left out")
    if shortened:
        parts.append(f"{shortened} shortened, as the sensor turned slowly at an end")
    return "; ".join(parts)
