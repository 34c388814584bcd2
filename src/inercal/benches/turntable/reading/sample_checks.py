"""Check single samples and columns of a turntable's recording, before motions are compared.

The checks find readings at the end of their range, a row that is far from both its neighbours, and
a readback that is constant while the gyros measure a turn or that repeats each value. In later
checks all of these would look like a wrong unit or an exchanged column.
"""

# pyright: reportMissingTypeStubs=false, reportUnknownVariableType=false
# pyright: reportUnknownMemberType=false

from collections.abc import Sequence
from math import degrees, pi, radians

import numpy as np
import scipy.ndimage
from numpy.typing import NDArray

from inercal.basics.arrays import Array
from inercal.basics.errors import InputError
from inercal.basics.units import format_duration
from inercal.physics.quantities import Measures
from inercal.physics.sensors import G0, Sensor
from inercal.recordings import Finding, Recording, Track, sample_count
from inercal.recordings.samples import INVALID_SAMPLES

_TURNING = radians(1)  # rad/s
_LASTING = 1.0  # s during which gyros measure a turn while the readback is constant
_FLAT = 0.3  # s in total during which gyros stay at one value while the table turns
_ALONE = {"f": 0.3 * G0, "w": radians(5)}  # a spike exceeds both neighbours by this, and
_LONGEST = 10  # samples of a spike
_SIGMAS = 30.0  # by this many times the usual second difference
_JUMP = radians(10)  # a jump of the readback exceeds both neighbours by this
_WHOLE_TURNS = {"°": 360.0, "rad": 2 * pi, "″": 1_296_000.0}
_RESTART = 0.99  # part of a whole turn that the angle jumps where it starts again
_REPEATED = 0.6  # fraction of the steps while the table turns
_FEWEST_INTERVALS = 10  # between readings of an interpolated readback
_DUST = 1e-9  # rad: smaller changes are rounding errors
_BEND = 0.01  # times the largest second difference within `_AROUND`: smaller ones are straight
_AROUND, _LONGEST_INTERVAL = 0.5, 3.0  # s
_COMPARABLE = 0.3  # s: straight lines over longer intervals hide how the rate changes
_NORMAL = 1.4826
_NAMED = 3  # most spikes that are named
_BLOCK = 1 << 16  # samples


def require_range(where: str, recording: Recording, track: Track, sensor: Sensor) -> None:
    """Refuse gyros that are at the end of their range while the table turns.

    Raises
    ------
    InputError
        A gyro is clipped. The message names the channel, the total time and the first place.
    """
    turning = _largest_axis_rate(track) > _TURNING
    step = float(np.median(np.diff(track.time)))
    names = [axis.name for axis in sensor.axes if axis.measures == "w"]
    for name in names:
        flaws = [
            f
            for f in recording.findings
            if f.what in INVALID_SAMPLES
            and f.channel == name
            and f.start is not None
            and f.stop is not None
        ]
        flat = np.zeros(turning.size, np.bool_)
        for flaw in flaws:
            flat[flaw.start : flaw.stop] = True
        seconds = float((flat & turning).sum()) * step
        if seconds > _FLAT:
            raise InputError(
                f"{where}: {flaws[0].message}; for {format_duration(seconds)} in all it is at "
                "the end of its range while the table turns; turn more slowly, or set a wider "
                "range",
                names=(name,),
            )


def require_angle_unit(where: str, raw: Array, size: float, names: Sequence[str]) -> None:
    """Refuse angles that start again after a whole turn in another unit than the stated one.

    Parameters
    ----------
    where : str
        Start of error messages.
    raw : (n, k) array
        Readback in the stated unit.
    size : float
        Size of the stated unit, rad.
    names : sequence of k str
        Names of the readback's columns.

    Raises
    ------
    InputError
        From one sample to the next, a column jumps from one end of its range to the other, and its
        range is a whole turn in another unit. The message names this unit.
    """
    for name, column in zip(names, raw.T, strict=True):
        span, jump = float(np.ptp(column)), float(np.abs(np.diff(column)).max(initial=0.0))
        for unit, turn in _WHOLE_TURNS.items():
            stated = _RESTART < turn * size / (2 * pi) < 1 / _RESTART
            if not stated and _RESTART * turn < jump <= span < turn / _RESTART:
                raise InputError(
                    f"{where}: [data] table_unit: {name} starts again after {turn:.4g}, which is "
                    f'a whole turn in {unit}; state table_unit = "{unit}"',
                    key="[data] table_unit",
                    names=(name,),
                )


def require_readback(where: str, recording: Recording, angles: Array, names: Sequence[str]) -> None:
    """Refuse a row whose readback is far from that of both neighbouring rows.

    Parameters
    ----------
    where : str
        Start of error messages.
    recording : Recording
    angles : (n, k) array
        Readback, rad.
    names : sequence of k str
        Names of the readback's columns.

    Raises
    ------
    InputError
        A row jumps. The message names the row, the time and the column.
    """
    for name, column in zip(names, angles.T, strict=True):
        k = _isolated_samples(column, _JUMP, 1)[:, 0]
        if k.size:
            row, rest = int(k[0]), k.size - 1
            more = f" ({rest} further rows jump too)" if rest else ""
            raise InputError(
                f"{where}: {recording.where(row)} ({recording.time[row]:.6g} s): the readback "
                f"{name} is {degrees(column[row]):.6g}° between {degrees(column[row - 1]):.6g}° "
                f"and {degrees(column[row + 1]):.6g}°{more}; remove the row",
                names=(name,),
            )


def require_turning(where: str, track: Track, sensor: Sensor, names: Sequence[str]) -> None:
    """Refuse a readback that is constant while the gyros measure a turn.

    Raises
    ------
    InputError
        The readback is constant. The message names the axes that never change, or the time from
        which they are constant.
    """
    gyros = [axis.measures == "w" for axis in sensor.axes]
    if not any(gyros):
        return
    step = float(np.median(np.diff(track.time)))
    size = max(sample_count(0.2, step), 2)
    w = track.reading[:, gyros]
    first = np.arange(0, track.time.size - size, size)
    mean = np.add.reduceat(w, first, axis=0)[:-1] / size
    moved = np.abs(np.diff(track.angles[first], axis=0))
    still = moved.max(axis=-1) < 1e-4 * size * step
    if not still.any():
        return
    bias = np.median(mean[still], axis=0)
    lost = still & (np.linalg.norm(mean - bias, axis=-1) > _TURNING)
    if lost.sum() * size * step < _LASTING or np.ptp(track.angles, axis=0).max() < 1e-3:
        return
    never: dict[str, str] = {}
    constant: dict[str, str] = {}
    for name, column in zip(names, moved.T, strict=True):
        at = np.flatnonzero(column > 1e-4 * size * step)
        if not at.size:
            never[name] = f"{name} never changes"
        elif lost[at[-1] + 1 :].sum() * size * step > _LASTING:
            constant[name] = f"{name} is constant from {track.time[first[at[-1] + 1]]:.4g} s on"
    begun = track.time[first[int(np.argmax(lost))]]
    causes = never or constant
    raise InputError(
        f"{where}: the readback is constant for {format_duration(lost.sum() * size * step)} "
        "while the gyros "
        f"measure a turn, first at {begun:.4g} s: {', '.join(causes.values()) or 'check its unit'}",
        names=tuple(causes),
    )


def spike_findings(recording: Recording, sensor: Sensor) -> tuple[Finding, ...]:
    """Return a warning for each reading, or few rows, far from the readings before and after."""
    found: list[Finding] = []
    for axis in sensor.axes:
        column = recording.data[:, recording.channels.index(axis.name)]
        si = (column - axis.readout.offset) / axis.readout.scale
        for k, stop in wild_samples(si, axis.measures)[:_NAMED].tolist():
            where = recording.where(k)
            rows = f"{where} to {recording.where(stop - 1)}" if stop - k > 1 else where
            text = (
                f"{axis.name} reads {column[k]:.5g} {axis.readout.unit} in {rows} "
                f"({recording.time[k]:.6g} s), between {column[k - 1]:.5g} before and "
                f"{column[stop]:.5g} after; remove {rows}"
            )
            found.append(Finding("warning", "outlier", text, axis.name, k, stop))
    return tuple(found)


def repeated_readback_finding(track: Track) -> Finding | None:
    """Return a warning if the readback repeats values while the table turns, or is too slow."""
    if (interval := readback_interval(track)) > _COMPARABLE:
        text = (
            f"the readback was interpolated from {1 / interval:.3g} Hz: its angles are wrong while "
            "the rate changes; record it with its own times at 10 Hz or more"
        )
        return Finding("warning", "readback", text)
    turning = (_largest_axis_rate(track) > _TURNING)[1:]
    if turning.sum() < 1 / _REPEATED:
        return None
    same = np.asarray(~np.diff(track.angles, axis=0).any(axis=-1), dtype=np.bool_)
    if float(same[turning].sum() / turning.sum()) < _REPEATED:
        return None
    step = float(np.median(np.diff(track.time)))
    rate = 1 / (step * turning.sum() / max((~same[turning]).sum(), 1))
    text = (
        f"the readback has {rate:.3g} Hz, but the readings have {1 / step:.4g} Hz: rows repeat its "
        "values while the table turns, so its delay varies; record it with its own times in [data] "
        "table_file, or record a new value in each row"
    )
    return Finding("warning", "readback", text)


def readback_interval(track: Track) -> float:
    """Return the time between the readings of a linearly interpolated readback, s, or else 0.

    Between two readings the angles lie on straight lines, even while the rate changes.
    """
    step = float(np.median(np.diff(track.time)))
    turned = np.diff(track.angles, axis=0)
    # A coarse readback bends, too, but it stands still before or after its steps.
    moves = np.minimum(np.abs(turned[1:]), np.abs(turned[:-1])) > _DUST
    bend = np.where(moves, np.abs(np.diff(turned, axis=0)), 0.0).max(axis=-1)
    around = scipy.ndimage.maximum_filter1d(bend, 2 * sample_count(_AROUND, step) + 1)
    edges = np.diff(bend > np.maximum(_BEND * around, _DUST), prepend=False, append=False)
    first, stop = np.flatnonzero(edges).reshape(-1, 2).T
    apart = np.diff(first)
    apart = apart[apart * step < _LONGEST_INTERVAL]
    if apart.size < _FEWEST_INTERVALS or np.median(stop - first) > 2:  # rows beside a reading
        return 0.0
    interval = float(np.median(apart)) * step
    return interval if interval > 1.5 * step else 0.0


def _largest_axis_rate(track: Track) -> Array:
    """Return the fastest axis' speed within half a second around each sample, rad/s."""
    step = float(np.median(np.diff(track.time)))
    h = max(sample_count(0.25, step), 1)
    n = track.time.size
    rate = np.zeros(n)
    for start in range(0, n, _BLOCK):
        at = np.arange(start, min(start + _BLOCK, n))
        low, high = np.maximum(at - h, 0), np.minimum(at + h, n - 1)
        turned = np.abs(track.angles[high] - track.angles[low]).max(axis=-1)
        rate[at] = turned / (track.time[high] - track.time[low])
    return rate


def wild_samples(column: Array, kind: Measures) -> NDArray[np.int64]:
    """Return the first sample of each spike in readings, SI, and the one after it, (k, 2)."""
    return _isolated_samples(column, _ALONE[kind], _LONGEST)


def _isolated_samples(column: Array, least: float, longest: int) -> NDArray[np.int64]:
    """Return groups, (k, 2), of at most `longest` samples that are far from both neighbours."""
    steps = np.abs(np.diff(column))
    if not (steps > least).any():
        return np.empty((0, 2), np.int64)
    usual = _NORMAL * float(np.median(np.abs(np.diff(column, 2))))
    jumps = np.flatnonzero(steps > max(least, _SIGMAS * usual))
    wild = np.zeros(column.size + 1, np.int8)
    for k in range(1, longest + 1):
        before, last = jumps[:-k], jumps[k:]
        apart = np.abs(column[last + 1] - column[before])
        lonely = (last - before <= longest) & (2 * apart < np.minimum(steps[before], steps[last]))
        for start, stop in zip(before[lonely].tolist(), last[lonely].tolist(), strict=True):
            wild[start + 1 : stop + 1] = 1
    return np.flatnonzero(np.diff(wild, prepend=0)).reshape(-1, 2)
