"""Samples that a turntable's recording lost without a gap in its times.

Two kinds show, and both harm: at 10 °/s one sample of 100 Hz is 360″.

* A row lost with its readback: over one step the readback goes on by two steps' angle where the
  gyros turned for one. It stands alone, so that latency, bias and scale do not look like it.
* A sample of the IMU alone, beside a readback with its own clock: from then on the readback is
  late by one step, as offsets local to changes of rate tell (`rates`).
  It is placed between two such changes.

A row lost at rest does not show: nothing turned but the earth, 0.15″ in 10 ms.
"""

from typing import NamedTuple

import numpy as np

from inercal.arrays import Array
from inercal.benches.turntable.attitude import motion
from inercal.benches.turntable.bench import Turntable
from inercal.benches.turntable.reading.implied_rates import (
    RateRegression,
    fit_rates,
    gyro_rates,
    half_window,
    local_offsets,
    table_rates,
)
from inercal.recording import GAP_FACTOR, Finding, Track
from inercal.sensors import Sensor

_ALONE = 10.0  # times the usual difference between readback and gyros over one step
_CLEAR = 6.0  # standard deviations of a step between local offsets
_NORMAL = 1.4826  # standard deviations of a normal distribution in its median absolute one
_SEEN = 3.0  # the same, beside a clear one
_HALF = 0.5  # of a sample
_DUST, _COARSEST = 1e-9, np.radians(0.2)  # rad, of steps that are rounding
_SHAPED = 0.01  # of the rate: more beyond it is of the table's zeros, not of time
_MOVING = np.radians(5)  # rad/s, of turns
_TURNING = np.radians(0.05)  # rad/s


class SampleDrop(NamedTuple):
    """Samples lost after sample `first` and before `last`; negative: as many too many."""

    first: int
    last: int
    samples: float
    row: bool  # with their readback


def dropped_sample_findings(track: Track, sensor: Sensor, bench: Turntable) -> tuple[Finding, ...]:
    """Return a warning for each slip: when, and how many samples.

    Parameters
    ----------
    track : Track
        Of one trial, (n, m) readings; times as they are taken to be.
    sensor : Sensor
        With three gyros; otherwise nothing is found.
    bench : Turntable
    """
    found: list[Finding] = []
    for slip in find_dropped_samples(track, sensor, bench):
        count = round(abs(slip.samples))
        some = f"{count} sample{'s' * (count > 1)} {'lost' if slip.samples > 0 else 'too many'}"
        start, stop = track.time[slip.first], track.time[slip.last]
        if slip.row:
            text = f"{some} unnoticed at {start:.6g} s: the readback jumps by {slip.samples:+.2f}"
            text += " steps of time against the gyros"
        else:
            text = f"{some} of the sensor unnoticed between {start:.6g} s and {stop:.6g} s: from "
            late = slip.samples * float(np.median(np.diff(track.time))) * 1e3
            text += f"then on the readback is later by {late:.3g} ms"
        text += '; take times from a packet counter: [data] time, time_unit = "sample", rate and '
        text += "counter_modulus"
        found.append(Finding("warning", "slip", text, None, slip.first, slip.last + 1))
    return tuple(found)


def find_dropped_samples(track: Track, sensor: Sensor, bench: Turntable) -> tuple[SampleDrop, ...]:
    """Return the slips that `dropped_sample_findings` tells of, in their order."""
    gyros = [axis.measures == "w" for axis in sensor.axes]
    if sum(gyros) != 3 or track.time.size < 100:
        return ()
    reading = track.reading[:, gyros]
    table, read = table_rates(bench, track.time, track.angles), gyro_rates(track.time, reading)
    known = fit_rates(read.rate, table.rate)
    fastest = float(np.percentile(np.linalg.norm(table.change, axis=-1), 99.9))
    rows = _readback_slips(track.time, reading, track.angles, bench, known, fastest)
    turning = np.linalg.norm(table.rate, axis=-1) > _MOVING
    left = np.linalg.norm(known.residual_rates(read.rate, table.rate)[turning], axis=-1)
    speed = np.linalg.norm(table.rate[turning], axis=-1)
    if turning.any() and np.median(left / speed) > _SHAPED:
        return tuple(rows)  # the two do not turn alike: offsets in time tell nothing
    local = local_offsets(table, read, known)
    h = half_window(track.time)
    # A row lost within a change of rate moves that one's offset alone.
    spoilt = [
        any(first - h <= one.first - h <= last + h for one in rows) for first, last in local.spans
    ]
    kept = ~np.array(spoilt, dtype=np.bool_)
    steps = _offset_steps(local.time[kept], local.value[kept], local.sd[kept], track.time)
    spans = local.spans[kept] + h
    # It may lie within one of the changes itself.
    alone = [SampleDrop(int(spans[k, 0]), int(spans[j, 1]), n, False) for k, j, n in steps]
    return tuple(sorted([*rows, *alone]))


def _readback_slips(
    time: Array,
    reading: Array,
    angles: Array,
    bench: Turntable,
    known: RateRegression,
    fastest: float,
) -> list[SampleDrop]:
    """Return the steps over which the readback alone goes on by more or fewer than one."""
    dt = np.diff(time)
    usual = float(np.median(dt))
    turned = np.diff(angles, axis=0) / dt[:, None]
    middle = (angles[1:] + angles[:-1]) / 2
    v = motion(bench, middle, turned, np.zeros_like(turned), {}).w @ known.matrix.T
    w = (reading[1:] + reading[:-1]) / 2 - known.bias
    size = np.linalg.norm(w, axis=-1)
    more = (np.sum(v * w, axis=-1) / np.maximum(size, 1e-12) - size) * dt  # rad
    moving = (size > _TURNING) & (dt < GAP_FACTOR * usual)
    more[~moving] = 0.0
    # Beyond both neighbours: where latency or bias makes a difference, it is theirs as well.
    before, after = np.roll(more, 1), np.roll(more, -1)
    alone = np.maximum(more - np.maximum(before, after), 0)
    alone -= np.maximum(np.minimum(before, after) - more, 0)
    noise = _NORMAL * float(np.median(np.abs(more[moving] - before[moving]))) if moving.any() else 0
    # One step of a readback that is rounded, up and down.
    stepped = np.abs(np.diff(angles, axis=0))
    resolution = 2 * float(stepped[stepped > _DUST].min(initial=np.inf))
    resolution = resolution if resolution < _COARSEST else 0.0
    least = np.maximum(_ALONE * noise + fastest * usual**2, size * usual / 2) + resolution
    # Where the table begins or ends to turn, a readback that is late looks like samples lost.
    speed = np.linalg.norm(v, axis=-1)
    steady = np.minimum(np.roll(speed, 2), np.roll(speed, -2)) > size / 2
    steady &= np.maximum(np.roll(speed, 2), np.roll(speed, -2)) < 2 * size
    at = np.flatnonzero((np.abs(alone) > least) & moving & steady)
    share = (more - (before + after) / 2)[at] / (size * usual)[at]
    return [SampleDrop(int(k), int(k) + 1, float(n), True) for k, n in zip(at, share, strict=True)]


def _offset_steps(
    time: Array, value: Array, sd: Array, sampled: Array
) -> list[tuple[int, int, float]]:
    """Return between which local offsets the clocks come apart by samples, and by how many."""
    if time.size < 3:
        return []
    span, jump = np.diff(time), np.diff(value)
    jump = jump - float(np.median(jump / span)) * span  # clocks may run apart
    samples = jump / float(np.median(np.diff(sampled)))
    size = jump / np.hypot(sd[1:], sd[:-1])
    # Within a change of rate, a loss is a part of the step before it and a part of that after.
    signs = np.sign(samples) * (np.abs(size) > _SEEN)
    cut = np.flatnonzero(np.diff(signs) != 0) + 1
    found: list[tuple[int, int, float]] = []
    for run in np.split(np.arange(samples.size), cut):
        whole = float(samples[run].sum())
        if signs[run[0]] and np.abs(size[run]).max() > _CLEAR and abs(whole) > _HALF:
            found.append((int(run[0]), int(run[-1]) + 1, whole))
    return found
