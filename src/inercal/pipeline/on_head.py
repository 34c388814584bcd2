"""From a run on a dividing head to observations: a table of positions, or a recording of them."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace
from math import pi
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from inercal.benches import DividingHead
from inercal.benches.passes import CARDINAL, SAME, beyond_turns, lacking, pass_names
from inercal.errors import InputError
from inercal.io.marks import as_read, marks_from_file
from inercal.io.means import means_of, read_columns
from inercal.pipeline.inputs import (
    Gathered,
    columns,
    load_recording,
    plain,
    readback_columns,
    readback_units,
    stated_sd,
)
from inercal.plan import Index
from inercal.recording import Finding, Mark, Observations, Recording
from inercal.runfile import Run
from inercal.segments import check_marks, find_rests, marks_from_labels, observe
from inercal.sensors import G0
from inercal.units import readable

Array = NDArray[np.float64]
_STEADY = 1e-5  # rad, 2″: the head stood still
_PHASE = 10 * pi / 180  # no fixture is further off
_SWING = (0.5, 2.0)  # times g
_FEWEST = 3  # positions that tell a phase


def gather(run: Run, bench: DividingHead) -> Gathered:
    """Return the observations of a run on a dividing head.

    Raises
    ------
    InputError
        The data cannot be used.
    """
    if run.data.seconds is not None:
        raise InputError(f"{run.path}: [data] seconds: a dividing head stands still; leave it out")
    made = _table(run, bench) if run.data.kind == "means" else _recording(run, bench)
    recording, marks, observations, steps, findings = made
    _require_collimated(run, bench, steps)
    _require_phases(run, observations, steps)
    conditions = _conditions(run, bench, steps)
    return Gathered(recording, marks, observations, steps, steps, findings, conditions)


_Made = tuple[
    Recording | None, tuple[Mark, ...], Observations, tuple[Index, ...], tuple[Finding, ...]
]


def _table(run: Run, bench: DividingHead) -> _Made:
    named, units = readback_columns(run), readback_units(run)
    wanted = columns(run)
    path = run.file(run.data.file)
    table = read_columns(path, wanted, list(named.values()))
    said = {name: table.numbers(column) * units[name] for name, column in named.items()}
    for name, values in said.items():
        bad = ~np.isfinite(values)
        if name == "autocollimator":
            # Where it is not used it need not have been read.
            bad &= _collimated(bench, said["angle"])
        if bad.any():
            raise InputError(
                f"{path} line {table.first_line + int(np.argmax(bad))}: column {named[name]!r} "
                f"holds no number; {_WANTED[name]}"
            )
    names = None
    if wanted.label is not None:
        names = [plain(value) for value in table.columns[wanted.label].tolist()]
    steps = _steps(names, {name: np.nan_to_num(values) for name, values in said.items()})
    labels = tuple(step.label for step in steps)
    durations = np.ones(len(labels))  # nothing depends on them
    observations = means_of(path, table, labels, wanted, run.sensor, stated_sd(run), durations)
    return None, (), observations, steps, ()


_WANTED = {
    "angle": "give the head's angle or take the row out",
    "level": "give what the level read or take the row out",
    "autocollimator": "give what it read, or state [bench] autocollimation without this position",
}


def _recording(run: Run, bench: DividingHead) -> _Made:
    recording, units = load_recording(run), readback_units(run)
    said = {name: values * units[name] for name, values in recording.readback.items()}
    if run.data.marks == "found":
        marks = find_rests(recording, run.sensor).marks
    elif run.data.marks == "labels":
        marks = marks_from_labels(recording)
    else:
        marks = as_read(marks_from_file(run.file(run.data.marks)), recording)
    check_marks(marks, recording, [mark.label for mark in marks])
    for mark in marks:
        if np.ptp(said["angle"][mark.start : mark.stop]) > _STEADY:
            raise InputError(
                f"{recording.source}: section {mark.label} ({recording.where(mark.start)}): the "
                "head's angle changes; mark only the time at one position"
            )
    means = {
        name: np.array([values[mark.start : mark.stop].mean() for mark in marks])
        for name, values in said.items()
    }
    found = run.data.marks == "found"
    steps = _steps(None if found else [mark.label for mark in marks], means)
    marks = tuple(replace(m, label=step.label) for m, step in zip(marks, steps, strict=True))
    observations = observe(recording, run.sensor, marks, steps, found=found)
    return recording, marks, observations, steps, recording.findings


def _steps(names: Sequence[str] | None, said: Mapping[str, Array]) -> tuple[Index, ...]:
    """Return the steps of rows at these angles, levels and readings; None names them by angle."""
    angle = said["angle"]
    sense = _senses(angle)
    if names is None:
        once = [
            f"{degrees:.6g}° {'forward' if s > 0 else 'reverse'}"
            for degrees, s in zip((angle * 180 / pi).tolist(), sense, strict=True)
        ]
        count: Counter[str] = Counter()
        names = []
        for name in once:
            count[name] += 1
            names.append(name if count[name] == 1 else f"{name} ({count[name]})")
    nothing = np.zeros(angle.size)
    level, reading = said.get("level", nothing), said.get("autocollimator", nothing)
    return tuple(
        Index(name, a, s, one, other)
        for name, a, s, one, other in zip(
            names, angle.tolist(), sense, level.tolist(), reading.tolist(), strict=True
        )
    )


def _senses(angle: Array) -> list[Literal[1, -1]]:
    """Return in which sense each position was come to; the first as the next."""
    moves = pi - (pi - np.diff(angle)) % (2 * pi)
    found: list[Literal[1, -1]] = []
    sense: Literal[1, -1] = 1
    for move in reversed(moves.tolist()):
        # A position that is read again where the head turns round opens the way back.
        sense = sense if abs(move) < SAME else (1 if move > 0 else -1)
        found.append(sense)
    found.append(sense)
    return found[::-1]


def _collimated(bench: DividingHead, angle: Array) -> NDArray[np.bool_]:
    """Return at which angles the autocollimator is used."""
    if bench.collimated == "every":
        return np.ones(angle.size, dtype=np.bool_)
    cardinal = [any(beyond_turns(a - c) < SAME for c in CARDINAL) for a in angle.tolist()]
    return np.array(cardinal) & (bench.collimated == "pairs")


def _require_collimated(run: Run, bench: DividingHead, steps: Sequence[Index]) -> None:
    """Refuse a pass that lacks a position by which the head is trimmed."""
    if bench.collimated != "pairs":
        return
    for name, angles in lacking(steps).items():
        missing = ", ".join(f"{angle * 180 / pi:.0f}°" for angle in angles)
        raise InputError(
            f"{run.path}: [bench] autocollimation is by pairs, 180° as 0° and 270° as 90° in each "
            f"pass; {name} has no {missing}: add it to {run.data.file}, or state "
            '"none" or "every"'
        )


def _require_phases(run: Run, observations: Observations, steps: Sequence[Index]) -> None:
    """Refuse accelerometers that do not swing by 1 g with the phase at which they are mounted."""
    angle = np.array([step.angle for step in steps])
    basis = np.stack([np.ones_like(angle), np.sin(angle), np.cos(angle)], axis=-1)
    if np.linalg.matrix_rank(basis, tol=1e-6) < _FEWEST:
        return
    _, sine, cosine = np.linalg.lstsq(basis, observations.mean, rcond=None)[0]
    most = [float(a) for a in np.arctan2(sine, cosine) * 180 / pi % 360]  # where each reads most
    wanted = [90.0, 0.0]
    where = f"{run.path}: [data] accelerometer"
    given = [str(column) for column in run.data.accelerometer]
    off = [abs((a - w + 180) % 360 - 180) for a, w in zip(most, wanted, strict=False)]
    limit = _PHASE * 180 / pi
    if max(off) > limit:
        crossed = len(most) > 1 and all(
            abs((a - w + 180) % 360 - 180) < limit
            for a, w in zip(most, reversed(wanted), strict=True)
        )
        first, *second = most
        if crossed:
            raise InputError(
                f"{where}: {given[0]} and {given[1]} are swapped: {given[0]} reads most at "
                f"{first:.0f}° and {given[1]} at {second[0]:.0f}°, where A reads most at 90° and B "
                f'at 0°; write ["{given[1]}", "{given[0]}"]'
            )
        k = int(np.argmax(off))
        raise InputError(
            f"{where}: {given[k]} reads most at {most[k]:.0f}°, where {'AB'[k]} reads most at "
            f"{wanted[k]:.0f}°: the head counts the other way, or {given[k]} is mounted otherwise"
        )
    swing = np.hypot(sine, cosine) / G0
    if not ((swing > _SWING[0]) & (swing < _SWING[1])).all():
        k = int(np.argmax(np.abs(np.log(swing))))
        raise InputError(
            f"{where}: {given[k]} swings by {swing[k]:.3g} g in the field of gravity, not by 1 g; "
            "look at the unit and the scale in [sensor.accelerometer]"
        )


def _conditions(run: Run, bench: DividingHead, steps: Sequence[Index]) -> dict[str, str]:
    different = len({round(step.angle % (2 * pi), 6) for step in steps})
    count = len(pass_names(steps))
    found = {
        "gravity": readable(bench.gravity.value, bench.gravity.sd, "m/s²"),
        "positions": f"{different}, in {count} pass{'es' * (count > 1)}",
        "head's error, rms (k = 1)": f"{bench.rms * 648_000 / pi:.3g} ″",
        "autocollimation": bench.collimated,
    }
    if bench.collimated != "none":
        found["autocollimator (k = 1)"] = readable(bench.autocollimator, 0.0, "″")
        faces = len(bench.polygon)
        found["polygon"] = f"{faces} faces as certified" if faces else "taken as even"
    if run.data.level is not None:
        found["tilt of the base"] = "by the level's readings"
    return found
