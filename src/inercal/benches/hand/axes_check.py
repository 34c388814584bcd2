"""Detect exchanged, reversed or wrongly scaled columns from the turns between rests.

Accelerometers that are off by about gravity are also recognised: some firmware removes gravity.
"""

from collections.abc import Sequence
from dataclasses import replace
from itertools import product
from math import degrees

import numpy as np

from inercal.basics.arrays import Array
from inercal.basics.errors import InputError
from inercal.physics.sensors import G0, Sensor
from inercal.recordings import Finding, Mark, Recording
from inercal.recordings.data import RestsSection, RunBase
from inercal.recordings.data.recording_loader import unsigned_column
from inercal.recordings.segments.gravity_turns import (
    TurnVerdict,
    judge_turns,
    name_columns,
    read_gravity_turns,
    sphere,
)

_BY_READINGS = "the positions were identified by the axis that reads gravity"
_UNKNOWN = (
    f"{_BY_READINGS}: exchanged columns and reversed axes cannot be detected, because {{}}; hold "
    "one known axis up and compare, or state the marks"
)

_NEAR_UNIT = 0.8  # share of 9.8 above which the change of an axis looks like another unit
_MANY_TURNS = 5  # more than these agree with some order of the axes, unless it changes
NO_TURNS = (
    "the movements between the sections could not be compared with gravity, for example because "
    "they are not in the recording, so exchanged or reversed gyro columns cannot be detected"
)

_RANGES = (0.25, 0.5, 2.0, 4.0)  # ratios of the ranges of an accelerometer
_SPHERE = 0.02  # scatter of the norms, relative to gravity, of usable accelerometers
_FAR = 0.5  # of gravity; larger than the bias of any working accelerometer
_NEAR = 0.1  # relative difference between the radius and gravity, from scale factors


def check_axes(
    run: RunBase[RestsSection], recording: Recording, rests: Sequence[Mark]
) -> tuple[TurnVerdict, tuple[Finding, ...]]:
    """Check the sensor's axes against the turns between rests; return the verdict and warnings.

    Parameters
    ----------
    run : RunBase
    recording : Recording
        A recording without a trial axis.
    rests : sequence of Mark
        The rests, in any order.

    Raises
    ------
    InputError
        The turns disagree with the recorded gravity, and exactly one change of axes or unit makes
        them agree.
    """
    ordered = sorted(rests, key=lambda one: one.start)
    turns = read_gravity_turns(recording, run.sensor, ordered)
    found = judge_turns(turns, others=run.data.marks == "found")
    if found.agree is None and found.turns > _MANY_TURNS:
        _require_equal_units(run, recording, rests)
        text = f"{found.turns} turns between rests agree with no order and signs of the axes: "
        text += changed_scale(recording, run.sensor, ordered) or (
            "columns may be exchanged or wrong in a part of the recording"
        )
        return found, (Finding("note", "axes", text),)
    if found.agree is not False:
        return found, ()
    changes = ", or if ".join(_with_columns(one, run) for one in sorted(found.changes, key=len))
    text = (
        f"{found.turns} turns between rests do not agree with gravity as recorded; they agree only "
        f"if {changes}"
    )
    advice = f"{mistake_advice(found.changes, rate=run.data.rate)}{run.sensor.negative_scales}"
    if not found.clear:
        return found, (Finding("warning", "axes", f"{text}; {advice}"),)
    if not found.unique:
        cause = f"{min(found.changes, key=len)} (or the axes are changed in another way)"
        return found, (Finding("refused", "axes", f"{text}; {advice}", cause=cause),)
    raise InputError(
        f"{recording.source or run.data.file}: {text}: {advice}",
        file=run.file(run.data.file),
        key="[data] accelerometer",
        names=found.changes,
    )


def changed_scale(recording: Recording, sensor: Sensor, rests: Sequence[Mark]) -> str:
    """Say which accelerometer's range was switched during the recording.

    Return "" unless a switch of one axis, by one of the usual ratios of ranges, makes the norms of
    all rests equal.

    Parameters
    ----------
    recording : Recording
        A recording without a trial axis.
    sensor : Sensor
    rests : sequence of Mark
        The rests in the order of time.
    """
    names = [axis.name for axis in sensor.axes if axis.measures == "f"]
    if len(names) != len("xyz"):
        return ""
    columns = [recording.channels.index(name) for name in names]
    means = np.array([recording.data[r.start : r.stop, columns].mean(axis=0) for r in rests])

    def misfit(k: int, first: int, factor: float) -> float:
        read = means.copy()
        read[first:, k] /= factor
        centre, radius = sphere(read)
        if centre is None or radius is None:
            return np.inf
        return float(np.linalg.norm(read - centre, axis=1).std()) / radius

    cases = [*product(range(3), range(2, len(rests) - 1), _RANGES)]
    k, first, factor = min(cases, key=lambda one: misfit(*one))
    if misfit(k, first, factor) > _SPHERE or misfit(0, 0, 1.0) < 3 * _SPHERE:
        return ""
    start = recording.time[rests[first].start]
    return (
        f"{names[k]} reads {factor:g} times as much from {start:.6g} s on, as if its range was "
        "switched; calibrate each part as a file of its own"
    )


def _require_equal_units(
    run: RunBase[RestsSection], recording: Recording, rests: Sequence[Mark]
) -> None:
    """Raise an error if one accelerometer is in m/s² and the others are in g, or vice versa."""
    force = run.sensor.select_axes("f")
    columns = [recording.channels.index(name) for name in force.channels]
    means = [recording.data[one.start : one.stop, columns].mean(axis=0) for one in rests]
    scales = np.array([axis.readout.scale for axis in force.axes])
    reach = np.ptp(np.array(means) / scales, axis=0)
    if not reach.all():
        return
    ratio = reach / np.median(reach)
    factor = np.maximum(ratio, 1 / ratio)
    far = np.flatnonzero(factor > _NEAR_UNIT * G0).tolist()
    if len(far) == 1 and factor[far[0]] < G0 / _NEAR_UNIT:
        name = force.channels[far[0]]
        size = f"{factor[far[0]]:.2g} times {'more' if ratio[far[0]] > 1 else 'less'}"
        raise InputError(
            f"{recording.source or run.data.file}: {name} changes {size} between the rests than "
            "the other accelerometers, as if one is in g and the others in m/s²; convert its "
            "column to the unit of the others",
            file=run.file(run.data.file),
            key="[sensor.accelerometer] unit",
            names=(name,),
        )


def _with_columns(change: str, run: RunBase[RestsSection]) -> str:
    """Describe a change and add the column of each axis that it names."""
    columns: dict[str, str] = {}
    for letter, names in (("a", run.data.accelerometer), ("g", run.data.gyro)):
        for axis, column in zip("xyz", names, strict=False):
            name = f"{letter}{axis}"
            columns[name] = f"{name} (column {unsigned_column(column)})"
    return name_columns(change, columns)


def mistake_advice(changes: Sequence[str], rate: str | None) -> str:
    """Return advice on which keys of the run file to check."""
    if all("unit" in one for one in changes):
        other = "°/s read as rad/s" if "°/s" in changes[0] else "rad/s read as °/s"
        return f"this looks like {other}: see unit in [sensor.gyro]"
    if any("multiplied" in one for one in changes):
        text = "check scale and unit in [sensor.gyro], and the full scale of the board"
        return (
            f'{text}; or [data] rate = "{rate}" is wrong, and all times with it' if rate else text
        )
    gyros = any(name in one for one in changes for name in ("gx", "gy", "gz", "triad", "gyro"))
    force = any(name in one for one in changes for name in ("ax", "ay", "az", "triad"))
    keys = " and ".join(["accelerometer"] * force + ["gyro"] * gyros)
    return f'check the columns in [data] {keys} ("-" before a name reverses it)'


def positions_note(found: TurnVerdict) -> str:
    """Return a note on how far the turns confirm the order and the signs of the axes."""
    if found.agree is None:
        return _UNKNOWN.format("too few turns between rests can be compared with gravity")
    if not found.agree:
        return f"{_BY_READINGS}, but the turns between rests do not agree with the axes as recorded"
    if not found.unique:
        return _UNKNOWN.format(f"other axes also agree with the {found.turns} turns between rests")
    return (
        f"{_BY_READINGS}, and {found.turns} turns between rests agree with gravity to "
        f"{degrees(found.misfit):.1f}°, and with no other order or signs of the axes; if both "
        "triads are rotated together relative to the case, this cannot be detected: hold one "
        "known axis up and compare, or state the marks"
    )


def far_off(means: Array, sensor: Sensor, gravity: float) -> dict[str, float]:
    """Return the accelerometers whose bias is about gravity, with their bias, m/s².

    Parameters
    ----------
    means : (r, m) array
        Mean readings at rest in several attitudes, SI.
    sensor : Sensor
    gravity : float
        Local gravity, m/s².
    """
    columns = [k for k, axis in enumerate(sensor.axes) if axis.measures == "f"]
    if len(columns) != len("xyz"):
        return {}
    centre, radius = sphere(means[:, columns])
    if centre is None or radius is None or abs(radius / gravity - 1) > _NEAR:
        return {}
    if float(np.ptp(means[:, columns], axis=0).max()) < radius:
        return {}  # the attitudes are too similar to determine a centre
    found = zip((sensor.channels[k] for k in columns), centre.tolist(), strict=True)
    return {name: bias for name, bias in found if abs(bias) > _FAR * gravity}


def explain_norm(
    findings: Sequence[Finding], means: Array, sensor: Sensor, gravity: float
) -> tuple[Finding, ...]:
    """Return the findings; the one about the norm at rest names accelerometers that are far off."""
    far = far_off(means, sensor, gravity)
    text = " and ".join(
        f"{k} is off by {v / gravity:+.2f} g".replace("-", "−") for k, v in far.items()
    )
    if not far:
        return tuple(findings)
    advice = (
        f"{text}, which the estimated bias contains: check whether the firmware removes gravity"
    )
    return tuple(
        replace(one, message=advice) if one.what == "units" and one.severity == "warning" else one
        for one in findings
    )
