"""Without a plan, select the usable rests, and find their attitudes and the turns between them.

A hand trembles even at rest, so each rest is described by its mean attitude. The rotation from one
mean attitude to the next is the weighted integral of the rate. The weight rises from 0 to 1 during
the first rest, stays 1 between the rests and falls to 0 during the second rest. To first order in
the wobble, this weighting gives the mean remaining rotation over each rest. Only the part of a long
rest that is next to the transition is weighted: over a longer part, the gyro's noise would exceed
the wobble, and over a shorter part, the sway of the hand would not average out.
"""

from bisect import bisect_left
from collections.abc import Iterator, Sequence
from itertools import accumulate

import numpy as np
from numpy.typing import NDArray

from inercal.basics.arrays import Array
from inercal.basics.errors import InputError
from inercal.physics.plan import Hold
from inercal.physics.quantities import INERTIAL
from inercal.physics.sensors import Sensor, nominal_inverse
from inercal.recordings import Finding, Mark, Observations, Recording, Transitions, sample_count
from inercal.recordings.samples import INVALID_SAMPLES

# For a difference of two clocks: step in s, steps of a change, its largest size (quantile), and the
# ratio of the agreement to that of all differences that are more than 1 s (50 steps) away.
_CLOCK_STEP, _CLOCK_CHANGE, _CLOCK_LEVEL, _CLOCK_CLEAR, _CLOCK_WIDTH = 0.02, 20, 0.9, 1.5, 50
# Weighted part of a rest in s. A hand sways with a period of some 3 s. The noise of the weighted
# part matters little because the mean rate of the rest contains it too.
WEIGHTED_DURATION = 5.0


def valid_marks(
    recording: Recording, sensor: Sensor, marks: Sequence[Mark]
) -> tuple[tuple[Mark, ...], tuple[Finding, ...]]:
    """Return the marks in time order, except those with saturated or stuck samples.

    Returns
    -------
    marks : tuple of Mark
    findings : tuple of Finding
        A warning for each mark that was omitted.

    Raises
    ------
    InputError
        No usable mark remains.
    """
    usable: list[Mark] = []
    findings: list[Finding] = []
    ordered = sorted(marks, key=lambda mark: mark.start)
    flaws = range_findings(recording, sensor, [(mark.start, mark.stop) for mark in ordered])
    for mark, flaw in zip(ordered, flaws, strict=True):
        if flaw is None:
            usable.append(mark)
            continue
        text = f"rest {mark.label} is not used: {flaw.message}"
        findings.append(Finding("warning", "rests", text, flaw.channel, mark.start, mark.stop))
    if not usable:
        raise InputError(
            f"{recording.source}: every rest has saturated or stuck samples: "
            f"{findings[0].message}; check the sensor and record again",
            names=tuple(mark.label for mark in ordered),
        )
    return tuple(usable), tuple(findings)


def flaws_of_mark(recording: Recording, mark: Mark) -> Iterator[Finding]:
    """Yield the findings about saturated or stuck samples within a mark."""
    for one in recording.findings:
        if one.what not in INVALID_SAMPLES or one.start is None or one.stop is None:
            continue
        if one.start < mark.stop and one.stop > mark.start:
            yield one


def range_findings(
    recording: Recording, sensor: Sensor, ranges: Sequence[tuple[int, int]]
) -> list[Finding | None]:
    """Return a finding on saturated or stuck samples for each half-open range; None without flaws.

    A long recording may have as many findings as ranges, so the findings are sorted once instead of
    being searched for each range.
    """
    invalid = sorted(
        (finding.start, finding.stop, k)
        for k, finding in enumerate(recording.findings)
        if finding.what in INVALID_SAMPLES and finding.channel in (None, *sensor.channels)
        if finding.start is not None and finding.stop is not None
    )
    begins = [start for start, _, _ in invalid]
    # Among the findings that begin before a range ends, the last to end overlaps it if any does.
    last_to_end = list(accumulate(((stop, k) for _, stop, k in invalid), max))
    flaws: list[Finding | None] = []
    for start, stop in ranges:
        before = bisect_left(begins, stop)
        end, k = last_to_end[before - 1] if before else (start, 0)
        flaws.append(recording.findings[k] if end > start else None)
    return flaws


def holds_from_observations(observations: Observations, sensor: Sensor) -> tuple[Hold, ...]:
    """Return a hold for each row, with its attitude computed from the nominal readings.

    Parameters
    ----------
    observations : Observations
        Observations at rest, without a trial axis.
    sensor : Sensor
        Sensor with at least an accelerometer triad.
    """
    force = sensor.select_axes("f")
    sensed = observations.mean[:, : len(force.axes)] @ nominal_inverse(force.axes)[:, :3]
    ups = sensed / np.linalg.norm(sensed, axis=-1, keepdims=True)
    return tuple(
        Hold(label, (float(x), float(y), float(z)), float(seconds))
        for label, (x, y, z), seconds in zip(
            observations.labels, ups, observations.duration, strict=True
        )
    )


def holds_from_marks(marks: Sequence[Mark]) -> tuple[Hold, ...]:
    """Return a hold for each mark, with a placeholder for its unknown attitude."""
    return tuple(Hold(mark.label, (0.0, 0.0, 1.0), 0.0) for mark in marks)


def clock_difference(recording: Recording, sensor: Sensor) -> float:
    """Return how much later the gyros show the motion than the accelerometers, s.

    The result is 0 below 1 s, or if it is not clear.

    The readings of a sensor at rest now and then change in time with the motion. The changes of the
    specific force and the integrals of the rate over the same short time are correlated.
    """
    count = int(recording.duration / _CLOCK_STEP)
    if min(sensor.rank("f"), sensor.rank("w")) < len("xyz") or count < 4 * _CLOCK_CHANGE:
        return 0.0
    grid = recording.time[0] + _CLOCK_STEP * np.arange(count)
    activity: list[NDArray[np.complex128]] = []
    for kind in INERTIAL:
        channels = sensor.select_axes(kind).channels
        x: Array = np.empty((len(channels), count))
        for row, name in zip(x, channels, strict=True):
            readings = recording.data[:, recording.channels.index(name)]
            row[:] = np.interp(grid, recording.time, readings)
        if kind == "w":
            x = np.cumsum(x - np.median(x, axis=1, keepdims=True), axis=1)
        moved = np.linalg.norm(x[:, _CLOCK_CHANGE:] - x[:, :-_CLOCK_CHANGE], axis=0)
        moved = np.minimum(moved, np.quantile(moved, _CLOCK_LEVEL))
        activity.append(np.fft.rfft(moved - moved.mean(), 2 * count))
    agreement = np.fft.irfft(np.conj(activity[0]) * activity[1], 2 * count)
    k = int(np.argmax(agreement))
    others = np.roll(agreement, _CLOCK_WIDTH - k)[2 * _CLOCK_WIDTH :]
    k -= 2 * count * (k > count)
    if others.max() * _CLOCK_CLEAR > agreement[k] or abs(k) <= _CLOCK_WIDTH:
        return 0.0  # for example if all rests have the same length
    return _CLOCK_STEP * k


def transitions_between_rests(
    recording: Recording, sensor: Sensor, marks: Sequence[Mark]
) -> Transitions:
    """Return the transitions between marks that are neighbours in time.

    Transitions with a gap or with saturated or stuck gyros are omitted.

    Parameters
    ----------
    recording : Recording
        Recording without a trial axis.
    sensor : Sensor
        Sensor whose axes name the channels.
    marks : sequence of Mark
        Rests in time order.
    """
    columns = [recording.channels.index(name) for name in sensor.channels]
    in_place = columns == list(range(len(recording.channels)))
    weighted = max(sample_count(WEIGHTED_DURATION, recording.median_step), 1)
    length = np.array([min(mark.stop - mark.start, weighted) for mark in marks])
    begin, end = np.array([(mark.start, mark.stop) for mark in marks]).T
    start, left = end[:-1] - length[:-1], end[:-1] - 1
    reached, stop = begin[1:], begin[1:] + length[1:] - 1
    # There is a gap between two samples if the number of gaps before them differs.
    gaps_before = np.searchsorted(recording.gaps[:, 0], np.stack([start, stop]))
    ranges = list(zip(start.tolist(), (stop + 1).tolist(), strict=True))
    flaws = range_findings(recording, sensor.select_axes("w"), ranges)
    valid = np.array([flaw is None for flaw in flaws], dtype=np.bool_)
    kept = np.flatnonzero((gaps_before[0] == gaps_before[1]) & valid)
    return Transitions(
        time=recording.time,
        output=recording.data if in_place else recording.data[:, columns],
        rest=kept,
        start=start[kept],
        left=left[kept],
        reached=reached[kept],
        stop=stop[kept],
        temperature=recording.temperature,
    )
