"""Rests without a plan: which of the marks can be used, and in which attitude each was."""

from bisect import bisect_left
from collections.abc import Sequence
from dataclasses import replace
from itertools import accumulate

import numpy as np

from inercal.errors import InputError
from inercal.plan import Hold
from inercal.recording import Finding, Mark, Observations, Recording
from inercal.sensors import Sensor, inverse

INVALID_SAMPLES = ("saturation", "stuck")


def valid_marks(
    recording: Recording, sensor: Sensor, marks: Sequence[Mark]
) -> tuple[tuple[Mark, ...], tuple[Finding, ...]]:
    """Return the marks in the order of time without those on saturated or stuck samples.

    Returns
    -------
    marks : tuple of Mark
    findings : tuple of Finding
        A warning for each that was left out.

    Raises
    ------
    InputError
        None is left.
    """
    kept: list[Mark] = []
    findings: list[Finding] = []
    ordered = sorted(marks, key=lambda mark: mark.start)
    spoilt = range_findings(recording, sensor, [(mark.start, mark.stop) for mark in ordered])
    for mark, flaw in zip(ordered, spoilt, strict=True):
        if flaw is None:
            kept.append(mark)
            continue
        text = f"rest {mark.label} is left out: {flaw.message}"
        findings.append(Finding("warning", "rests", text, flaw.channel, mark.start, mark.stop))
    if not kept:
        raise InputError(f"{recording.source}: no rest without a flaw; {findings[0].message}")
    return tuple(kept), tuple(findings)


def range_findings(
    recording: Recording, sensor: Sensor, ranges: Sequence[tuple[int, int]]
) -> list[Finding | None]:
    """Return for each range of samples (half open) a finding of saturated or stuck ones in it.

    None where the sensor's channels have none there. A long recording may have as many findings
    as ranges: they are sorted once, not searched for each.
    """
    found = sorted(
        (finding.start, finding.stop, k)
        for k, finding in enumerate(recording.findings)
        if finding.what in INVALID_SAMPLES and finding.channel in (None, *sensor.channels)
        if finding.start is not None and finding.stop is not None
    )
    begins = [start for start, _, _ in found]
    # Of those that begin before a range ends, the one that ends last is in it if any is.
    lasting = list(accumulate(((stop, k) for _, stop, k in found), max))
    spoilt: list[Finding | None] = []
    for start, stop in ranges:
        begun = bisect_left(begins, stop)
        end, k = lasting[begun - 1] if begun else (start, 0)
        spoilt.append(recording.findings[k] if end > start else None)
    return spoilt


def holds_from_observations(observations: Observations, sensor: Sensor) -> tuple[Hold, ...]:
    """Return each row as the hold that it was, its attitude by the nominal readings.

    Parameters
    ----------
    observations : Observations
        Rows are rests; without a trial axis.
    sensor : Sensor
        An accelerometer triad at least.
    """
    force = sensor.select_axes("f")
    bare = Sensor(force.name, force.axes)
    sensed = inverse(bare, observations.mean[:, : len(force.axes)], np.zeros(0)).f
    ups = sensed / np.linalg.norm(sensed, axis=-1, keepdims=True)
    return tuple(
        Hold(label, (float(x), float(y), float(z)), float(seconds))
        for label, (x, y, z), seconds in zip(
            observations.labels, ups, observations.duration, strict=True
        )
    )


def holds_from_marks(marks: Sequence[Mark]) -> tuple[Hold, ...]:
    """Return a hold for each mark, its attitude not known yet."""
    return tuple(replace(_UNKNOWN, label=mark.label) for mark in marks)


_UNKNOWN = Hold("", (0.0, 0.0, 1.0), 0.0)
