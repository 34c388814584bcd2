"""Find samples that a turntable's recording lost without a gap in its times.

Two cases are detected; at 10 °/s one sample at 100 Hz corresponds to 360″:

* A row was lost together with its readback. Over one step the readback then turns by the angle of
  two steps, but the gyros turn by the angle of one. The effect is isolated, unlike the effects of
  latency, bias and scale.
* Only the IMU lost a sample, and the readback has its own clock. From then on the readback is
  delayed by one step, as local offsets at changes of rate show (`implied_rates`). The loss is
  located between two changes of rate.

A row that is lost at rest is not detected, because only the earth turned, by 0.15″ in 10 ms.
"""

from typing import NamedTuple

import numpy as np

from inercal.basics.arrays import Array
from inercal.basics.units import format_count
from inercal.benches.turntable.attitude import body_rates
from inercal.benches.turntable.bench import Turntable
from inercal.benches.turntable.reading.implied_rates import (
    LocalOffsets,
    RateRegression,
    fit_track_rates,
    gyro_rates,
    half_window,
    local_offsets,
    rate_vectors,
    table_rates,
)
from inercal.physics.sensors import Sensor
from inercal.recordings import GAP_FACTOR, Finding, Track
from inercal.recordings.io.column_table import row_blocks

_PIECE = 1 << 19  # samples
_MARGIN = 60.0  # s on each side of a piece; every change of rate is shorter
_FEWEST_SAMPLES = 100
_ALONE = 10.0  # times the usual difference between readback and gyros over one step
_CLEAR = 6.0  # standard deviations: a significant step between local offsets
_NORMAL = 1.4826  # standard deviation over median absolute deviation for a normal distribution
_SEEN = 3.0  # the same for steps next to a significant one
_HALF = 0.5  # samples
_MANY = 10  # samples: a larger loss falsifies the fit of the rates, and any calibration
_DUST, _COARSEST = 1e-9, np.radians(0.2)  # rad: range of steps that are due to rounding
_SHAPED = 0.01  # times the rate: a larger residual is due to the table's zeros, not to time
_MOVING = np.radians(5)  # rad/s: turns are faster
_TURNING = np.radians(0.05)  # rad/s


class SampleDrop(NamedTuple):
    """Samples lost after sample `first` and before `last`; a negative number means extra ones."""

    first: int
    last: int
    samples: float
    row: bool  # whether their readback was lost too


def dropped_sample_findings(
    track: Track, sensor: Sensor, bench: Turntable, known: RateRegression | None = None
) -> tuple[Finding, ...]:
    """Return a warning for each loss, with its time and the number of samples.

    Parameters
    ----------
    track : Track
        Track of one trial, (n, m) readings, with the times that the run uses.
    sensor : Sensor
        Sensor; there are no findings unless its gyros measure all components.
    bench : Turntable
    known : RateRegression, optional
        Result of `fit_track_rates` for the track, if already known.
    """
    findings: list[Finding] = []
    for drop in find_dropped_samples(track, sensor, bench, known):
        count = round(abs(drop.samples))
        size = f"{format_count(count, 'sample')} {'lost' if drop.samples > 0 else 'too many'}"
        cause = ""
        start, stop = track.time[drop.first], track.time[drop.last]
        if drop.row:
            text = f"{size} without a gap at {start:.6g} s: the readback jumps by "
            text += f"{drop.samples:+.2f} time steps relative to the gyros"
            if count > _MANY:
                cause = f"at least {size} without a gap at {start:.6g} s"
        else:
            delay = drop.samples * float(np.median(np.diff(track.time))) * 1e3
            text = f"{size} by the sensor without a gap between {start:.6g} s and {stop:.6g} s: "
            text += f"from then on the readback is later by {delay:.3g} ms"
        text += '; take times from a packet counter: [data] time, time_unit = "sample", rate and '
        text += "counter_modulus"
        findings.append(
            Finding("warning", "slip", text, None, drop.first, drop.last + 1, cause=cause)
        )
    return tuple(findings)


def find_dropped_samples(
    track: Track, sensor: Sensor, bench: Turntable, known: RateRegression | None = None
) -> tuple[SampleDrop, ...]:
    """Return the losses that `dropped_sample_findings` warns about, in order.

    A long track is searched piece by piece, so that only one piece and its margins are in memory.
    """
    n = track.time.size
    if sensor.rank("w") < len("xyz") or n < _FEWEST_SAMPLES:
        return ()
    known = known or fit_track_rates(bench, track, sensor)
    margin = round(_MARGIN / float(np.median(np.diff(track.time[:_PIECE]))))
    rows: list[SampleDrop] = []
    offsets: list[LocalOffsets] = []
    for start in range(0, n, _PIECE):
        first, stop = max(start - margin, 0), min(start + _PIECE, n)
        piece = track.slice(first, min(stop + margin, n))
        if n > _PIECE and not _turns(piece):
            continue
        drops, local = _search_piece(piece, rate_vectors(sensor, piece.reading), bench, known)
        rows += [
            row._replace(first=row.first + first, last=row.last + first)
            for row in drops
            if start <= row.first + first < stop
        ]
        spans = local.spans + first
        own = (spans[:, 0] >= start) & (spans[:, 0] < stop)
        offsets.append(LocalOffsets(local.time[own], local.value[own], local.sd[own], spans[own]))
    if not offsets:
        return ()
    if any(abs(row.samples) > _MANY for row in rows):
        return tuple(rows)  # the rates do not fit, so offsets have no meaning
    local = LocalOffsets(*map(np.concatenate, zip(*offsets, strict=True)))
    steps = _offset_steps(local, track.time[:_PIECE])
    # The loss may lie within one of the two changes of rate.
    alone = [
        SampleDrop(int(local.spans[k, 0]), int(local.spans[j, 1]), count, False)
        for k, j, count in steps
    ]
    return tuple(sorted([*rows, *alone]))


def _turns(piece: Track) -> bool:
    """Return whether the table turns during a piece."""
    rates = np.diff(piece.angles, axis=0) / np.diff(piece.time)[:, None]
    return float(np.abs(rates).max()) > _MOVING


def _search_piece(
    piece: Track, reading: Array, bench: Turntable, known: RateRegression
) -> tuple[list[SampleDrop], LocalOffsets]:
    """Return the lost rows and local offsets in a piece; sample numbers start at its beginning."""
    table = table_rates(bench, piece.time, piece.angles)
    fastest = float(np.percentile(np.linalg.norm(table.change, axis=-1), 99.9))
    rows = _dropped_rows(piece.time, reading, piece.angles, bench, known, fastest)
    residual = known.residual_rates(gyro_rates(piece.time, reading).rate, table.rate)
    local = local_offsets(table, residual, known)
    h = half_window(piece.time)
    spans = local.spans + h
    turning = np.linalg.norm(table.rate, axis=-1) > _MOVING
    speed = np.linalg.norm(table.rate[turning], axis=-1)
    # If the two motions differ, their time offsets have no meaning.
    difference = np.linalg.norm(residual[turning], axis=-1)
    alike = not turning.any() or float(np.median(difference / speed)) <= _SHAPED
    # A row lost during a change of rate disturbs only the offset at this change.
    usable = np.array(
        [
            alike and not any(first - 2 * h <= row.first - h <= last for row in rows)
            for first, last in spans
        ],
        dtype=np.bool_,
    )
    return rows, LocalOffsets(
        local.time[usable], local.value[usable], local.sd[usable], spans[usable]
    )


def _dropped_rows(
    time: Array,
    reading: Array,
    angles: Array,
    bench: Turntable,
    known: RateRegression,
    fastest: float,
) -> list[SampleDrop]:
    """Return the steps in which the readback, but not the gyros, skips or repeats time steps."""
    dt = np.diff(time)
    usual = float(np.median(dt))
    more, size, speed = np.empty((3, dt.size))
    for part in row_blocks(dt.size):
        next_part = slice(part.start + 1, part.stop + 1)
        middle = (angles[next_part] + angles[part]) / 2
        turned = (angles[next_part] - angles[part]) / dt[part, None]
        v = body_rates(bench, middle, turned) @ known.matrix.T
        w = (reading[next_part] + reading[part]) / 2 - known.bias
        size[part] = np.linalg.norm(w, axis=-1)
        speed[part] = np.linalg.norm(v, axis=-1)
        more[part] = np.sum(v * w, axis=-1) / np.maximum(size[part], 1e-12) - size[part]
    more *= dt  # rad
    moving = (size > _TURNING) & (dt < GAP_FACTOR * usual)
    more[~moving] = 0.0
    # Compare with both neighbours, on which latency and bias have the same effect.
    before, after = np.roll(more, 1), np.roll(more, -1)
    alone = np.maximum(more - np.maximum(before, after), 0)
    alone -= np.maximum(np.minimum(before, after) - more, 0)
    noise = _NORMAL * float(np.median(np.abs(more[moving] - before[moving]))) if moving.any() else 0
    # One resolution step of a rounded readback, up and down.
    stepped = np.abs(np.diff(angles, axis=0))
    resolution = 2 * float(stepped[stepped > _DUST].min(initial=np.inf))
    resolution = resolution if resolution < _COARSEST else 0.0
    least = np.maximum(_ALONE * noise + fastest * usual**2, size * usual / 2) + resolution
    # At the beginning and end of a turn, a delayed readback looks like lost samples.
    steady = np.minimum(np.roll(speed, 2), np.roll(speed, -2)) > size / 2
    steady &= np.maximum(np.roll(speed, 2), np.roll(speed, -2)) < 2 * size
    at = np.flatnonzero((np.abs(alone) > least) & moving & steady)
    share = (more - (before + after) / 2)[at] / (size * usual)[at]
    return [SampleDrop(int(k), int(k) + 1, float(n), True) for k, n in zip(at, share, strict=True)]


def _offset_steps(local: LocalOffsets, sampled: Array) -> list[tuple[int, int, float]]:
    """Return pairs of local offsets with lost samples between them, and the number of samples."""
    time, value, sd, _ = local
    if time.size < 3:
        return []
    span, jump = np.diff(time), np.diff(value)
    jump = jump - float(np.median(jump / span)) * span  # clocks may drift
    samples = jump / float(np.median(np.diff(sampled)))
    size = jump / np.hypot(sd[1:], sd[:-1])
    # A loss during a change of rate is shared between the steps before and after it.
    signs = np.sign(samples) * (np.abs(size) > _SEEN)
    cut = np.flatnonzero(np.diff(signs) != 0) + 1
    steps: list[tuple[int, int, float]] = []
    for run in np.split(np.arange(samples.size), cut):
        count = float(samples[run].sum())
        if signs[run[0]] and np.abs(size[run]).max() > _CLEAR and abs(count) > _HALF:
            steps.append((int(run[0]), int(run[-1]) + 1, count))
    return steps
