"""Find the rounding steps of a recording's channels, and their noise during rests.

A channel whose rests span many levels needs no correction and is not examined further. For the
other channels, the step is found from the whole channel, including motion. If a channel stays at
one value during rests and never reads the neighbouring values, it has a dead band there: the true
value may be anywhere in this band.
"""

from collections.abc import Sequence

import numpy as np

from inercal.basics.arrays import Array
from inercal.estimation.uncertainty.rounding import Ladder, noise_lower_bound, rounding_ladder
from inercal.physics.sensors import Sensor
from inercal.recordings.rounding_errors import NOISY, ReadingSteps

_LOOKED_AT = 400  # samples of each rest that are used to count its levels
_FEW = 12  # largest number of levels in them; with more, the noise is above a step
_LARGE = 0.9  # steps of noise, with which rounding leaves an error of one millionth
_EVEN = 1e-3  # of a step
_COARSER = 0.7  # of the step at rest; a smaller step in the whole channel is the step of its text
_UNROUNDED = 0.5  # of the samples in motion; with more distinct levels, nothing is rounded
_OFTEN = 3  # samples at one value, which are more than a single spike
_WIDE = 4.0  # a gap so many times as wide as the gaps beyond it is that of a dead band
_BESIDE = 6  # number of gaps that show the usual width
_SMOOTH = 0.1  # ratio of second differences to scatter; 2.4 for white noise
_DIGITS = 12  # of a channel's largest reading; smaller changes are rounding of the computer


def reading_steps(
    data: Array,
    columns: Sequence[int],
    sensor: Sensor,
    rests: Sequence[tuple[int, int]],
    *,
    si: bool = False,
) -> ReadingSteps:
    """Return how the channels are rounded.

    Parameters
    ----------
    data : (..., n, k) array
        Data of the recording, output units; with several trials, only the first one is examined.
    columns : sequence of m int
        Columns of the sensor's axes.
    sensor : Sensor
    rests : sequence of (int, int)
        Half-open ranges of samples at rest.
    si : bool
        Whether the data are already in SI units.
    """
    one: Array = data.reshape(-1, *data.shape[-2:])[0]
    scale = np.array([1.0 if si else abs(axis.readout.scale) for axis in sensor.axes])
    m = len(columns)
    moving = len(one) - sum(stop - start for start, stop in rests)
    step, noise, text = np.zeros(m), np.full(m, NOISY), np.zeros(m)
    dead = np.zeros(m, dtype=np.bool_)
    unknown: list[int] = []
    for k, (column, axis) in enumerate(zip(columns, sensor.axes, strict=True)):
        stated = axis.noise.quantisation * float(scale[k])
        own = [one[start:stop, column] for start, stop in rests]
        few = bool(own) and _has_few_levels(own)
        lonely = _lonely_value(own) if own else None
        stepped = bool(own) and (stated > 0 or few) and not _averages_out(own, stated)
        if lonely is None and not stepped:
            continue
        readings = _without_last_digits(one[:, column])
        own = [readings[start:stop] for start, stop in rests]
        levels = np.unique(readings)
        ladder = rounding_ladder(levels) if stepped else None
        if ladder is None and not stated and _is_without_noise(own, levels, moving):
            continue
        least = max(stated, _COARSER * _step_at_rest(own))
        if stepped and (ladder is None or ladder.step < least):
            ladder = _coarse_ladder(levels, own, stated)
        band = 0.0 if lonely is None else _dead_band(levels, lonely)
        if band > (0.0 if ladder is None else ladder.step):
            step[k], noise[k], dead[k] = band, 0.0, True
        elif ladder is None:
            unknown += [k] * stepped
        else:
            noise[k] = min(noise_lower_bound([ladder.indices(y) for y in own]), NOISY)
            step[k], text[k] = ladder.step, ladder.off
    step, text = step / scale, text / scale
    for k in unknown:  # for a channel with a single value, use the step of the others
        kind = sensor.axes[k].measures
        like = [float(step[j]) for j in range(m) if sensor.axes[j].measures == kind]
        step[k], noise[k] = min([one for one in like if one], default=0.0), 0.0
    return ReadingSteps(np.where((noise < NOISY) | (text > 0), step, 0.0), noise, dead, text)


def _without_last_digits(readings: Array) -> Array:
    """Return readings without the trailing digits that computer rounding leaves in them."""
    size = float(np.fmax.reduce(np.abs(readings), initial=0.0))
    return np.round(readings, _DIGITS - 1 - int(np.floor(np.log10(size)))) if size else readings


def _coarse_ladder(levels: Array, rests: Sequence[Array], stated: float) -> Ladder | None:
    """Return levels spaced by the stated step, the step at rest, or the smallest gap."""
    step = max(stated, _step_at_rest(rests))
    if not step and levels.size > 1 and _has_few_levels(rests):
        step = float(np.diff(levels).min())
    return Ladder(step, float(rests[0][0]), 0.0) if step else None


def _step_at_rest(rests: Sequence[Array]) -> float:
    """Return the smallest gap between two levels within one rest; 0 if each rest has one value.

    Noise reaches all neighbouring levels, so a value that was never read is not a level.
    """
    gaps = [float(np.min(np.diff(np.unique(y)), initial=np.inf)) for y in rests]
    least = min(gaps, default=np.inf)
    return least if np.isfinite(least) else 0.0


def _has_few_levels(rests: Sequence[Array]) -> bool:
    """Return whether most rests take only a few levels, each of them many times."""
    few = 0
    for y in map(_some, rests):
        most = min(_FEW, max(1, y.size // 2))
        few += len(set(y[: 2 * most].tolist())) <= most and np.unique(y).size <= most
    return 2 * few >= len(rests)


def _some(y: Array) -> Array:
    """Return a subset of the samples of a rest, evenly spaced."""
    return y[:: max(1, y.size // _LOOKED_AT)]


def _is_without_noise(rests: Sequence[Array], levels: Array, moving: int) -> bool:
    """Return whether the readings were simulated without noise and are not rounded.

    In such data each rest has a constant value, as with coarse steps, or changes smoothly, but the
    rests differ from each other, and so do nearly all samples in motion. A channel with a dead
    band, in contrast, reads one value in all rests that are within it.
    """
    values = {float(y[0]) for y in rests if y.size and not np.ptp(y)}
    smooth = [float(np.std(np.diff(y, 2))) <= _SMOOTH * float(np.std(y)) for y in rests]
    several = len(values) > 1 or any(np.ptp(y) for y in rests)
    return all(smooth) and several and levels.size > _UNROUNDED * moving


def _lonely_value(rests: Sequence[Array]) -> float | None:
    """Return the value of a dead band, which is far from all other readings; None without one."""
    some = np.sort(np.concatenate([_some(y) for y in rests]))
    # A shortcut for nearly all channels: no value occurs often enough.
    if some[0] < some[-1] and not (some[_OFTEN - 1 :] == some[: 1 - _OFTEN]).any():
        return None
    values, counts = np.unique(some, return_counts=True)
    gaps = np.diff(values)
    if not gaps.size:
        return float(values[0])
    wide = _WIDE * float(np.median(gaps)) if gaps.size > _BESIDE else 0.0
    sides = np.concatenate([[np.inf], gaps, [np.inf]])
    widest = int(np.argmax(gaps))
    for k in (int(np.argmax(counts)), widest, widest + 1):
        if counts[k] >= _OFTEN and float(sides[k : k + 2].min()) >= wide:
            return float(values[k])
    return None


def _averages_out(rests: Sequence[Array], stated: float) -> bool:
    """Return whether rounding averages out because the noise exceeds evenly spaced steps."""
    step = max(stated, _step_at_rest(rests))
    scatter = float(np.median([y.std() for y in rests]))
    if not step or scatter < _LARGE * step:
        return False
    if stated >= step:
        return True
    gaps = np.diff(np.unique(np.concatenate(rests))) / step
    return float(np.abs(gaps - np.rint(gaps)).max()) < _EVEN


def _dead_band(levels: Array, value: float) -> float:
    """Return the width of the range around a value that is never read; 0 if there is none.

    The true value may be as far away as the nearest reading on either side.
    """
    place, gaps = int(np.searchsorted(levels, value)), np.diff(levels)
    widest = 0.0
    for beside in (gaps[:place][::-1], gaps[place:]):
        if beside.size > _BESIDE and beside[0] > _WIDE * np.median(beside[1 : 1 + _BESIDE]):
            widest = max(widest, float(beside[0]))
    return 2 * widest
