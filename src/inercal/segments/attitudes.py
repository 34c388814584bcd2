"""Rests without a plan: which of the marks can be used, and in which attitude each was."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from inercal.errors import InputError
from inercal.plan import Hold
from inercal.recording import Finding, Mark, Observations, Recording
from inercal.sensors import Sensor, inverse

FLAWS = ("saturation", "stuck")


def unflawed(
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
    for mark in sorted(marks, key=lambda mark: mark.start):
        flaw = next(
            (f for f in flaws(recording, sensor) if touches(f, mark.start, mark.stop)), None
        )
        if flaw is None:
            kept.append(mark)
            continue
        text = f"rest {mark.label} is left out: {flaw.message}"
        findings.append(Finding("warning", "rests", text, flaw.channel, mark.start, mark.stop))
    if not kept:
        raise InputError(f"{recording.source}: no rest without a flaw; {findings[0].message}")
    return tuple(kept), tuple(findings)


def flaws(recording: Recording, sensor: Sensor) -> list[Finding]:
    """Return the findings of saturated or stuck samples of the sensor's channels."""
    return [
        finding
        for finding in recording.findings
        if finding.what in FLAWS and finding.channel in (None, *sensor.channels)
    ]


def touches(finding: Finding, start: int, stop: int) -> bool:
    """Return whether a finding concerns samples start to stop (half open)."""
    if finding.start is None or finding.stop is None:
        return False
    return finding.start < stop and finding.stop > start


def held(observations: Observations, sensor: Sensor) -> tuple[Hold, ...]:
    """Return each row as the hold that it was, its attitude by the nominal readings.

    Parameters
    ----------
    observations : Observations
        Rows are rests; without a trial axis.
    sensor : Sensor
        An accelerometer triad at least.
    """
    force = sensor.only("f")
    bare = Sensor(force.name, force.axes)
    felt = inverse(bare, observations.mean[:, : len(force.axes)], np.zeros(0)).f
    ups = felt / np.linalg.norm(felt, axis=-1, keepdims=True)
    return tuple(
        Hold(label, (float(x), float(y), float(z)), float(seconds))
        for label, (x, y, z), seconds in zip(
            observations.labels, ups, observations.duration, strict=True
        )
    )


def as_found(marks: Sequence[Mark]) -> tuple[Hold, ...]:
    """Return a hold for each mark, its attitude not known yet."""
    return tuple(replace(_UNKNOWN, label=mark.label) for mark in marks)


_UNKNOWN = Hold("", (0.0, 0.0, 1.0), 0.0)
