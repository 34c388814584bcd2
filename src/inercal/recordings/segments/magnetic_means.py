"""Average the readings of magnetometers over rests and over short pieces of motion.

A magnetometer is often slower than the other sensors, and its column repeats each value until the
next one arrives. The mean over a rest includes all samples. If values are repeated L times, its
covariance is that of n = (Σ L)² / Σ L² independent values. A row counts as a repetition if no axis
changes, so that the noise of a coarse magnetometer is not underestimated.
"""

from collections.abc import Sequence

import numpy as np

from inercal.basics.arrays import Array, Bools, Indices
from inercal.basics.errors import InputError
from inercal.basics.units import format_count
from inercal.physics.sensors import Sensor
from inercal.recordings import Finding, Recording, Transitions
from inercal.recordings.io.repeated_values import rail_ranges
from inercal.recordings.magnetic import MagneticPieces, MagneticReadings
from inercal.recordings.samples import INVALID_SAMPLES
from inercal.recordings.segments.attitudes import range_findings

PIECE = 0.2  # s
_TURNED = np.radians(2.5)  # the mean over a larger angle is shorter than the field, by 3e-4
_FRESH = 2  # fewest values in a rest
_FEWEST = 20  # fewest values in a recording without rests
_COARSE = 0.6  # of a step; less noise does not average the rounding out


def average_magnetometers(
    recording: Recording,
    sensor: Sensor,
    spans: Sequence[tuple[float, float]],
    labels: Sequence[str],
    clipped: Bools | None = None,
) -> tuple[MagneticReadings, tuple[Finding, ...]]:
    """Return the means over rests, with findings about the rests that are left out.

    Parameters
    ----------
    recording : Recording
        Recording of the magnetometers, which may have other samples than that of the other axes.
    sensor : Sensor
        The magnetometers.
    spans : sequence of r (start, stop)
        Time of the first and of the last sample of each rest, s.
    labels : sequence of r str
    clipped : (n,) array of bool, optional
        Result of `clipped_samples`.

    Raises
    ------
    InputError
        The magnetometers can be used in no rest.
    """
    y = _si(recording, sensor)
    fresh = new_value_rows(y)
    flawed = range_findings(recording, sensor, [_rows(recording.time, span) for span in spans])
    parts = [_values(recording.time, fresh, span) for span in spans]
    kept: list[int] = []
    lost: list[Finding] = []
    for k, (_, new) in enumerate(parts):
        why = ""
        if clipped is not None and clipped[new].any():
            channel = sensor.channels[int(np.abs(y[new]).max(axis=0).argmax())]
            why = f"{channel} is at the end of its range"
        if new.size < _FRESH:
            why = f"the magnetometers have {'only one' if new.size else 'no'} new value there"
        elif (flaw := flawed[k]) is not None:
            why = flaw.message
        if why:
            text = f"the magnetometers are not used at {labels[k]}: {why}"
            lost.append(Finding("warning", "magnetometer", text))
        else:
            kept.append(k)
    if not kept:
        raise InputError(
            f"{recording.source}: the magnetometers can be used in no rest: {lost[0].message}",
            file=recording.source,
            names=sensor.channels,
        )
    used = [parts[k] for k in kept]
    lengths = [np.diff(np.append(new, rows[-1] + 1)) for rows, new in used]
    count = np.array([length.sum() ** 2 / (length**2).sum() for length in lengths])
    scatter = np.concatenate([y[new] - y[new].mean(axis=0) for _, new in used])
    noise: Array = scatter.T @ scatter / (len(scatter) - len(used))
    rounding = np.diag(_rounding(y[fresh], np.sqrt(np.diag(noise))))
    return MagneticReadings(
        channels=sensor.channels,
        rest=np.array(kept),
        mean=np.array([y[rows].mean(axis=0) for rows, _ in used]),
        covariance=noise / count[:, None, None] + rounding,
        time=np.array([recording.time[rows].mean() for rows, _ in used]),
        samples=count,
        noise=noise + rounding,
        temperature=_kelvin(recording, [rows for rows, _ in used]),
    ), tuple(lost)


def clipped_samples(
    recording: Recording, sensor: Sensor, spans: Sequence[tuple[float, float]] = ()
) -> tuple[Bools, tuple[Finding, ...]]:
    """Return which samples cannot be used, (n,), and a warning if any is at an end of the range.

    The extreme reading of an axis is the end of its range if it is constant in several rests, while
    other axes change there. Without rests, its longest run decides (`rail_ranges`). Samples that
    the audit found saturated or stuck are also not used. The arguments are those of
    `average_magnetometers`.
    """
    y = _si(recording, sensor)
    fresh, clipped = new_value_rows(y), np.zeros(len(y), dtype=np.bool_)
    rests = [new for _, new in (_values(recording.time, fresh, span) for span in spans)]
    for column in y.T:
        ends = {float(column[fresh][start]) for start, _ in rail_ranges(column[fresh])}
        if spans:
            ends = {column.min(), column.max()}
        for end in ends:
            still = [new.size >= _FRESH and bool((column[new] == end).all()) for new in rests]
            if not spans or sum(still) > 1:
                # Another axis may reach the same end for a shorter time.
                same = (np.abs(y) == abs(end)) & (np.abs(y).max(axis=0) <= abs(end))
                clipped |= (column == end) | same.any(axis=1)
    own = [one for one in recording.findings if one.channel in sensor.channels]
    for one in own:
        clipped[one.start : one.stop] |= one.what == "saturation"
    share = float(clipped.mean())
    for one in own:
        clipped[one.start : one.stop] |= one.what in INVALID_SAMPLES
    text = (
        f"the magnetometers are at an end of their range in {100 * share:.2g} % of the samples, "
        "which are not used; record with a larger range"
    )
    return clipped, (Finding("warning", "saturation", text),) * (share > 0)


def average_pieces(
    recording: Recording, sensor: Sensor, moves: Transitions, others: Sensor
) -> MagneticPieces:
    """Return the means over pieces of 0.2 s of the motion between rests.

    If the sensor turns fast, a piece contains only the values within 2.5° of its middle. Its time
    is that of its mean attitude, which is not the mean time if the rate changes.

    Parameters
    ----------
    recording, sensor
        As for `average_magnetometers`.
    moves : Transitions
        Motion between rests, with the readings of the axes of `others`.
    others : Sensor
        Accelerometers and gyros.
    """
    y = _si(recording, sensor)
    new = np.flatnonzero(new_value_rows(y))
    time = recording.time[new]
    gyros = [k for k, axis in enumerate(others.axes) if axis.measures == "w"]
    rate = np.linalg.norm(others.to_si(moves.output)[:, gyros], axis=1)
    step = 0.5 * (rate[1:] + rate[:-1]) * np.diff(moves.time)
    turned = np.interp(time, moves.time, np.concatenate([[0.0], np.cumsum(step)]))
    found: list[tuple[int, Indices]] = []
    times: list[float] = []
    for k, (left, reached) in enumerate(zip(moves.left, moves.reached, strict=True)):
        start, stop = moves.time[left], moves.time[reached]
        own = np.flatnonzero((time > start) & (time < stop))
        piece = ((time[own] - start) / PIECE).astype(np.int64)
        for one in np.split(own, np.flatnonzero(np.diff(piece)) + 1) if own.size else ():
            near = np.abs(turned[one] - turned[one[one.size // 2]]) <= _TURNED
            used = one[near]
            found.append((k, new[used]))
            middle = float(np.mean(turned[used]))
            times.append(float(np.interp(middle, turned[used], time[used])))
    return MagneticPieces(
        transition=np.array([k for k, _ in found], dtype=np.int64),
        time=np.array(times),
        mean=np.array([y[rows].mean(axis=0) for _, rows in found]).reshape(-1, y.shape[1]),
        samples=np.array([rows.size for _, rows in found], dtype=np.int64),
        temperature=_kelvin(recording, [rows for _, rows in found]),
    )


def magnetic_samples(recording: Recording, sensor: Sensor) -> MagneticReadings:
    """Return the new values of a whole recording as pieces of one motion, without rests."""
    y = _si(recording, sensor)
    new, m = np.flatnonzero(new_value_rows(y)), len(sensor.axes)
    if new.size < _FEWEST:
        raise InputError(
            f"{recording.source}: the magnetometers have {format_count(new.size, 'new value')}; at "
            f"least {_FEWEST} are needed",
            file=recording.source,
            names=sensor.channels,
        )
    none, whole = np.zeros(0), np.zeros(new.size, dtype=np.int64)
    kelvin = None if recording.temperature is None else recording.temperature[new]
    pieces = MagneticPieces(whole, recording.time[new], y[new], np.ones_like(whole), kelvin)
    means, noise = np.zeros((0, m)), np.zeros((m, m))
    return MagneticReadings(
        sensor.channels, whole[:0], means, np.zeros((0, m, m)), none, none, noise, pieces=pieces
    )


def new_value_rows(y: Array) -> Bools:
    """Return which samples, (n, m), are new values, and neither repeated nor all zero."""
    changed = np.concatenate([[True], (y[1:] != y[:-1]).any(axis=1)])
    return changed & (y != 0).any(axis=1)


def _si(recording: Recording, sensor: Sensor) -> Array:
    return sensor.to_si(recording.data[:, [recording.channels.index(n) for n in sensor.channels]])


def _kelvin(recording: Recording, parts: Sequence[Indices]) -> Array | None:
    """Return the mean temperature of each part, or None if none was recorded."""
    kelvin = recording.temperature
    return None if kelvin is None else np.array([kelvin[rows].mean() for rows in parts])


def _rows(time: Array, span: tuple[float, float]) -> tuple[int, int]:
    """Return the half-open range of the samples in a span of time."""
    start = int(np.searchsorted(time, span[0], "left"))
    return start, int(np.searchsorted(time, span[1], "right"))


def _values(time: Array, fresh: Bools, span: tuple[float, float]) -> tuple[Indices, Indices]:
    """Return the samples in a span from the first new value on, and the new values among them."""
    start, stop = _rows(time, span)
    new = start + np.flatnonzero(fresh[start:stop])
    return np.arange(new[0] if new.size else stop, stop), new


def _rounding(y: Array, sd: Array) -> Array:
    """Return the variance of the rounding that a mean keeps, (m,), for axes with little noise."""
    steps = np.abs(np.diff(y, axis=0))
    step = np.min(steps, axis=0, initial=np.inf, where=steps > 0)
    return np.where(np.isfinite(step) & (sd < _COARSE * step), step**2 / 12, 0.0)
