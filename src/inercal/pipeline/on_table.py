"""From a table of states on a rate table to observations: mounting, rate, mean of each axis."""

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from itertools import permutations, product
from math import pi, radians
from typing import NamedTuple, cast

import numpy as np
from numpy.typing import NDArray

from inercal.benches import RateTable
from inercal.benches.mountings import PLANES, Plane, mounting
from inercal.benches.rate_table import felt, mountings, speeds
from inercal.errors import InputError
from inercal.estimate import Estimate
from inercal.io.means import means_of, read_columns
from inercal.methods import fresh
from inercal.pipeline.inputs import (
    Gathered,
    columns,
    load_recording,
    plain,
    readback_columns,
    readback_units,
    stated_sd,
)
from inercal.plan import Attitude, Spin
from inercal.recording import Finding, Mark, Observations, Recording, joined
from inercal.runfile import Run
from inercal.segments import average_dwells, find_dwells, find_stands, left_out, observe
from inercal.segments.dwells import ARM_RATE
from inercal.sensors import Sensor
from inercal.units import readable

Array = NDArray[np.float64]
_ANGLE = r"(-?\d+(?:\.\d+)?)\s*°?"
_NAME = re.compile(rf"({'|'.join(PLANES)})(?:[ _]*{_ANGLE}(?:\s*\+\s*{_ANGLE})?)?")
_OFF = 0.2  # of a norm: no scale factor, bias or cross-axis term of a usable sensor makes it so
_RATES = {  # what a rate would be times its stated unit, if it is in another one
    "rad/s": 30 / pi,
    "rpm": pi / 30,
    "rev/s": 60.0,
    "°/s": 1 / 6,
}
_FEWEST = 4  # states that tell which axis is which


def gather(run: Run, bench: RateTable) -> Gathered:
    """Return the observations of a run on a rate table.

    Raises
    ------
    InputError
        The data cannot be used.
    """
    if run.data.seconds is not None:
        raise InputError(f"{run.path}: [data] seconds: states are means; leave it out")
    made = _table(run) if run.data.kind == "means" else states_of(run, load_recording(run))
    _require_rates(run, made.observations, bench, made.steps)
    _require_axes(run, made.observations, bench, made.steps)
    return Gathered(
        made.recording,
        made.marks,
        made.observations,
        made.steps,
        made.steps,
        made.findings,
        _conditions(bench, made.steps),
    )


class States(NamedTuple):
    """What a table or a recording holds."""

    observations: Observations
    steps: tuple[Spin, ...]
    recording: Recording | None = None
    marks: tuple[Mark, ...] = ()
    findings: tuple[Finding, ...] = ()


def _table(run: Run) -> States:
    named, units = readback_columns(run), readback_units(run)
    wanted = columns(run)
    path = run.file(run.data.file)
    where = str(run.data.mounting)
    table = read_columns(path, wanted, [where, named["arm_rate"]])
    rates = table.numbers(named["arm_rate"]) * units["arm_rate"]
    bad = np.flatnonzero(~np.isfinite(rates))
    if bad.size:
        raise InputError(
            f"{path} line {table.first_line + bad[0]}: column {named['arm_rate']!r} holds no "
            "number; give the rate, 0 at rest, or take the row out"
        )
    poses = [
        _pose(plain(text), f"{path} line {table.first_line + k}: column {where!r}")
        for k, text in enumerate(table.columns[where].tolist())
    ]
    labels = _labels(poses, rates)
    durations = np.ones(len(labels))  # nothing depends on them
    observations = means_of(path, table, labels, wanted, run.sensor, stated_sd(run), durations)
    steps = tuple(
        Spin(label, rate, 0.0, pose)
        for label, rate, pose in zip(labels, rates.tolist(), poses, strict=True)
    )
    return States(observations, steps)


def states_of(run: Run, recording: Recording) -> States:
    """Reduce a recording: rests as they are, what turns over whole turns once it is steady.

    Parameters
    ----------
    run : Run
    recording : Recording
        As it is read: with labels, which name mountings, and "arm_rate" in the unit of its column.

    Raises
    ------
    InputError
        No dwell, too few turns, or a label that is no mounting.
    """
    size = readback_units(run)["arm_rate"]
    recording = replace(recording, readback={ARM_RATE: recording.readback[ARM_RATE] * size})
    dwells, flawed = find_dwells(recording, "table")
    turning, spun = average_dwells(recording, run.sensor, dwells)
    rests, also = find_stands(recording)
    names = [mark.label for mark in rests]
    held = [Spin(name, 0.0) for name in names]
    both = observe(recording, run.sensor, rests, held, found=True) if rests else None
    observations = turning if both is None else joined(turning, both)
    marks = (*(dwell.mark for dwell in dwells), *rests)
    assert recording.labels is not None
    steps: list[Spin] = []
    for step, mark in zip((*spun, *held), marks, strict=True):
        text, where = str(recording.labels[mark.start]), recording.where(mark.start)
        pose = _pose(text, f"{recording.source} {where}: column {str(run.data.mounting)!r}")
        steps.append(replace(step, attitude=pose))
    flawed += also
    findings = recording.findings + flawed + left_out(recording, marks, flawed)
    return States(observations, tuple(steps), recording, marks, findings)


def _pose(text: str, where: str) -> Attitude:
    found = _NAME.fullmatch(text.strip())
    if found is None:
        raise InputError(
            f"{where} is {text!r}; a mounting is {', '.join(PLANES)}, with a tilt in ° where it is "
            'tilted, "XY 30", and a second one where there are two, "XY 135 + 45"'
        )
    plane, first, second = found.groups()
    return mounting(
        cast("Plane", plane),
        radians(float(first or 0)),
        None if second is None else radians(float(second)),
    )


def _labels(poses: Sequence[Attitude], rates: Array) -> tuple[str, ...]:
    count: Counter[str] = Counter()
    found: list[str] = []
    for pose, rate in zip(poses, (rates * 30 / pi).tolist(), strict=True):
        name = f"{pose.name} at {rate:.6g} rpm"
        count[name] += 1
        found.append(name if count[name] == 1 else f"{name} ({count[name]})")
    return tuple(found)


def _made(bench: RateTable, steps: Sequence[Spin], times: float = 1.0) -> Array:
    """Return what is felt nominally, (r, 3) m/s², at rates `times` as large."""
    return felt(bench, [replace(step, rate=step.rate * times) for step in steps], {}).f


def _require_rates(
    run: Run, observations: Observations, bench: RateTable, steps: Sequence[Spin]
) -> None:
    """Refuse rates in another unit than stated: the norms of the readings tell."""
    turning = np.array([step.rate != 0 for step in steps])
    if not turning.any():
        return
    read = np.linalg.norm(observations.mean, axis=-1)

    def off(times: float) -> float:
        made = np.linalg.norm(_made(bench, steps, times), axis=-1)
        return float(np.max(np.abs(read / made - 1)[turning]))

    if off(1.0) <= _OFF:
        return
    given = run.data.arm_rate_unit
    fitting = [unit for unit, times in _RATES.items() if off(times) < _OFF / 2 and unit != given]
    if fitting and given == "rpm":
        raise InputError(
            f"{run.path}: [data] arm_rate_unit: by the norms of the readings the rates are in "
            f'{fitting[0]}, not in rpm; state arm_rate_unit = "{fitting[0]}"'
        )
    made = np.linalg.norm(_made(bench, steps), axis=-1)
    worst = int(np.argmax(np.abs(read / made - 1) * turning))
    raise InputError(
        f"{run.path}: {steps[worst].label}: the readings' norm is {read[worst]:.4g} m/s² where "
        f"radius and rate make {made[worst]:.4g}; look at arm_rate_unit, [bench] radius and the "
        "scale in [sensor.accelerometer]"
    )


def _require_axes(
    run: Run, observations: Observations, bench: RateTable, steps: Sequence[Spin]
) -> None:
    """Refuse columns that are exchanged or reversed: they fit far better otherwise."""
    if len(steps) < _FEWEST:
        return
    made, read = _made(bench, steps), observations.mean
    fits = {
        (order, signs): float(np.sum((read[:, order] * np.array(signs) - made) ** 2))
        for order in permutations(range(3))
        for signs in product((1, -1), repeat=3)
    }
    straight, best = fits[(0, 1, 2), (1, 1, 1)], min(fits, key=lambda key: fits[key])
    if fits[best] < straight / 10 and best != ((0, 1, 2), (1, 1, 1)):
        given = run.data.accelerometer
        order = ", ".join(f"{'−' * (s < 0)}{given[k]}" for k, s in zip(*best, strict=True))
        raise InputError(
            f"{run.path}: [data] accelerometer: the readings fit the mountings as x, y, z = "
            f"{order}, not as {', '.join(map(str, given))}: look at the columns' order and at how "
            "the sensor was mounted"
        )


def beside(sensor: Sensor, estimate: Estimate, bench: RateTable, gathered: Gathered) -> str:
    """Say what the result is off by on fresh poses, beside its residuals."""
    fastest = max(abs(step.rate) for step in gathered.steps if isinstance(step, Spin))
    return fresh.note(sensor, estimate, fastest, bench.radius.value, bench.gravity.value)


def _conditions(bench: RateTable, steps: Sequence[Spin]) -> dict[str, str]:
    in_all, at = len(set(mountings(steps))), len(set(speeds(steps)))
    return {
        "gravity": readable(bench.gravity.value, bench.gravity.sd, "m/s²"),
        "radius": readable(bench.radius.value, bench.radius.sd, "m"),
        "states": f"{len(steps)}, in {in_all} mountings at {at} speeds",
        "angles of each mounting (k = 1)": readable(bench.pose, 0.0, "°"),
        "radius of each mounting (k = 1)": readable(bench.seat, 0.0, "mm"),
        "rate, common to all (k = 1)": readable(bench.rate, 0.0, "%"),
        "speed (k = 1)": readable(bench.speed, 0.0, "%"),
        "lean at rest, two components (k = 1)": readable(bench.lean, 0.0, "°"),
    }
