"""From a recording on a turntable to the track that its filters follow, and means of its steps."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from math import degrees, pi

import numpy as np
from numpy.typing import NDArray

from inercal.benches import Turntable
from inercal.errors import InputError
from inercal.pipeline.inputs import (
    Gathered,
    load_recording,
    readback_columns,
    require_own_columns,
)
from inercal.pipeline.turntable.checks import Columns, require_sound
from inercal.pipeline.turntable.clock import NotAlike
from inercal.pipeline.turntable.earth import require_earth
from inercal.pipeline.turntable.labels import labelled
from inercal.pipeline.turntable.readback import Read, told, with_angles
from inercal.pipeline.turntable.slips import slipped
from inercal.plan import Position, Rotation, TableStep
from inercal.recording import Finding, Mark, Recording, Track
from inercal.runfile import Run
from inercal.segments import Turned, find_holds, find_turns, observe
from inercal.units import readable

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
_SETTLING = 0.25  # s beside what the readback may be late by
_EXACT = 4  # decimals of degrees in which positions are told


def gather(run: Run, bench: Turntable) -> Gathered:
    """Return the track of a run on a turntable, with means of its holds and turns.

    Raises
    ------
    InputError
        The data cannot be used.
    """
    _require_track(run)
    require_own_columns(run)
    recording = load_recording(run)
    try:
        read = with_angles(run, recording, bench)
    except NotAlike as error:
        holds = find_holds(recording.time, error.angles, None, _settling(bench))
        _checked(run, _track(run, recording, error.angles, holds), bench)
        raise  # what the checks know better they have said
    recording, bench = read.recording, read.bench
    angles = np.stack([recording.readback[name] for name in bench.names], axis=-1)
    holds = find_holds(recording.time, angles, recording.labels, _settling(bench))
    if not len(holds):
        named = ", ".join(readback_columns(run).values())
        raise InputError(
            f"{recording.source}: by its readback the table rests nowhere for a second: look at "
            f"[data] table, which is {named}"
        )
    track = _track(run, recording, angles, holds)
    findings = (*recording.findings, *_checked(run, track, bench))
    turns = find_turns(recording.time, angles, recording.labels)
    marks, steps = _steps(run, recording, angles, holds, turns)
    observations = observe(recording, run.sensor, marks, steps, found=True)
    return Gathered(
        recording,
        marks,
        replace(observations, track=track),
        steps,
        steps,
        findings,
        _conditions(read, steps),
        bench=bench,
        notes=read.notes,
    )


def _checked(run: Run, track: Track, bench: Turntable) -> tuple[Finding, ...]:
    """Return what checks of the track notice, before filters follow it."""
    kinds = {axis.measures for axis in run.sensor.axes}
    told = Columns(
        tuple(map(str, run.data.accelerometer)) if "f" in kinds else (),
        tuple(map(str, run.data.gyro)) if "w" in kinds else (),
        tuple(map(str, run.data.table or bench.names)),
    )
    where = str(run.path)
    return (
        *require_sound(where, track, run.sensor, bench, told),
        *require_earth(where, track, run.sensor, bench),
        *slipped(track, run.sensor, bench),
    )


def _require_track(run: Run) -> None:
    """Refuse what goes with other benches: filters follow the samples of one recording."""
    if run.data.kind == "means":
        raise InputError(
            f"{run.path}: [data] kind is means; filters on a turntable follow a recording"
        )
    if run.data.seconds is not None or run.data.marks != "found":
        key = "marks" if run.data.seconds is None else "seconds"
        raise InputError(
            f"{run.path}: [data] {key}: holds of a turntable are found by its readback; leave it "
            "out"
        )


def _settling(bench: Turntable) -> float:
    """Return how long the table is taken to settle, s; the readback may be late besides."""
    return _SETTLING + abs(bench.latency.value) + 2 * bench.latency.sd


def _track(run: Run, recording: Recording, angles: Array, holds: Indices) -> Track:
    number = np.full(recording.time.size, -1, dtype=np.int64)
    for k, (start, stop) in enumerate(holds.tolist()):
        number[start:stop] = k
    places = [recording.channels.index(name) for name in run.sensor.channels]
    reading = run.sensor.to_si(recording.data[:, places])
    return Track(recording.time, reading, angles, number)


def _steps(
    run: Run, recording: Recording, angles: Array, holds: Indices, turns: Sequence[Turned]
) -> tuple[tuple[Mark, ...], tuple[TableStep, ...]]:
    """Return the marks and steps of holds and turns, in the order of time."""
    found: list[tuple[int, int, TableStep]] = []
    for start, stop in holds.tolist():
        at = angles[start:stop].mean(axis=0)
        told = np.degrees(pi - (pi - at) % (2 * pi)).round(_EXACT) + 0.0
        seconds = recording.span(start, stop)
        found.append((start, stop, Position("", tuple(np.radians(told).tolist()), seconds)))
    for turn in turns:
        step = Rotation("", turn.axis, turn.angle, abs(turn.rate))
        found.append((turn.start, turn.stop, step))
    found.sort(key=lambda one: one[0])
    middles = [(start + stop) // 2 for start, stop, _ in found]
    own = None if recording.labels is None else recording.labels[middles].tolist()
    steps = labelled([step for *_, step in found], own, run)
    marks = tuple(
        Mark(step.label, start, stop) for (start, stop, _), step in zip(found, steps, strict=True)
    )
    return marks, steps


def _conditions(read: Read, steps: Sequence[TableStep]) -> dict[str, str]:
    bench, count = read.bench, Counter(type(step) for step in steps)
    late = {"latency of the readback": readable(bench.latency.value, bench.latency.sd, "ms")}
    return {
        "gravity": readable(bench.gravity.value, bench.gravity.sd, "m/s²"),
        "latitude": f"{degrees(bench.latitude):.6g} °",
        "azimuth at zero angles": readable(bench.azimuth.value, bench.azimuth.sd, "°"),
        "path": f"{count[Position]} holds and {count[Rotation]} turns, found by the readback",
        **(late if read.clock is None else told(read.clock)),
        "right angles of the axes (k = 1)": readable(bench.square, 0.0, "″"),
    }
