"""From a recording on a turntable to the track that its filters follow, and means of its steps."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from math import degrees, pi, radians

import numpy as np
from numpy.typing import NDArray

from inercal.arrays import Array
from inercal.benches.turntable.bench import Turntable
from inercal.benches.turntable.reading.dropped_samples import dropped_sample_findings
from inercal.benches.turntable.reading.earth_rate_check import check_earth_rate
from inercal.benches.turntable.reading.plan_comparison import compare_with_plan
from inercal.benches.turntable.reading.readback_angles import (
    RecordingWithAngles,
    add_table_angles,
    describe_clock,
)
from inercal.benches.turntable.reading.readback_clock import ClockMismatch
from inercal.benches.turntable.reading.sample_checks import (
    repeated_readback_finding,
    require_range,
    require_readback,
    require_turning,
    spike_findings,
)
from inercal.benches.turntable.reading.step_labels import label_steps
from inercal.benches.turntable.reading.track_checks import (
    ColumnNames,
    check_track,
    describe_sampling,
)
from inercal.benches.turntable.rest_timing import (
    COARSE_REST_SECONDS,
    MAX_GAP_SECONDS,
    MIN_REST_SECONDS,
    settling_time,
)
from inercal.benches.turntable.settings import HOLD_COLUMN, TurntableData
from inercal.data import EstimatorInput, Source
from inercal.data.recording_loader import (
    load_recording,
    readback_columns,
    require_distinct_columns,
)
from inercal.errors import InputError
from inercal.plan import Position, Rotation, TableStep
from inercal.recording import AngleQuality, Finding, Mark, Recording, Track
from inercal.segments import (
    AxisTurn,
    find_holds,
    find_turns,
    holds_from_numbers,
    select_long_holds,
)
from inercal.segments import (
    observe as averaged,
)
from inercal.units import format_quantity

Indices = NDArray[np.int64]
_WIDEST = 0.05  # s
_NOT_LATE = 1e-3  # s
_MOVED = radians(0.1)
_EXACT = 4  # decimals of degrees in which positions are told


def observe(run: Source[TurntableData]) -> EstimatorInput:
    """Return the track of a run on a turntable, with means of its holds and turns.

    Raises
    ------
    InputError
        The data cannot be used.
    """
    bench: Turntable = run.bench
    _require_track(run)
    require_distinct_columns(run, *(str(c) for c in (run.data.table_time,) if c is not None))
    _require_small_latency(run, bench)
    recording = load_recording(run)
    try:
        read = add_table_angles(run, recording, bench)
    except ClockMismatch as error:
        holds = find_holds(recording.time, error.angles, None, settling_time(bench))
        _check_track(run, _build_track(run, recording, error.angles, holds), bench, alike=False)
        raise  # what the checks know better they have said
    recording, bench = read.recording, read.bench
    angles = np.stack([recording.readback[name] for name in bench.names], axis=-1)
    named = tuple(readback_columns(run)[name] for name in bench.names)
    if read.clock is None:
        require_readback(str(run.path), recording, angles, named)
    if HOLD_COLUMN in recording.readback:
        holds = _numbered_holds(run, recording)
    else:
        holds = find_holds(recording.time, angles, recording.labels, settling_time(bench))
    if not len(holds):
        raise InputError(
            f"{recording.source}: by its readback the table rests nowhere for a second: look at "
            f"[data] table, which is {', '.join(named)}, and at time_unit and rate: "
            f"{describe_sampling(recording.time)}"
        )
    _require_complete_first_rest(run, recording.time, angles, holds)
    track = _build_track(run, recording, angles, holds, read.quality)
    require_range(str(run.path), recording, track, run.sensor)
    findings = (
        *recording.findings,
        *spike_findings(recording, run.sensor),
        *_check_track(run, track.with_known_angles, bench),
    )
    turns = find_turns(recording.time, angles, recording.labels)
    if HOLD_COLUMN in recording.readback and recording.labels is not None:
        # What a servo still does where a hold begins is no turn.
        rests = {str(recording.labels[start]) for start, _ in holds.tolist()}
        turns = tuple(
            t for t in turns if str(recording.labels[(t.start + t.stop) // 2]) not in rests
        )
    marks, steps, own = _build_steps(
        run, recording, angles, select_long_holds(recording.time, holds), turns
    )
    findings += compare_with_plan(steps, own, run)
    observations = averaged(recording, run.sensor, marks, steps, found=True)
    return EstimatorInput(
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


def _check_track(
    run: Source[TurntableData], track: Track, bench: Turntable, *, alike: bool = True
) -> tuple[Finding, ...]:
    """Return what checks of the track notice, before filters follow it.

    Where both clocks are not `alike`, the readback may stand while the gyros turn.
    """
    kinds = {axis.measures for axis in run.sensor.axes}
    told = ColumnNames(
        tuple(map(str, run.data.accelerometer)) if "f" in kinds else (),
        tuple(map(str, run.data.gyro)) if "w" in kinds else (),
        tuple(map(str, run.data.table or bench.names)),
    )
    where = str(run.path)
    late = bench.latency.value
    if abs(late) > _NOT_LATE:
        # What the readback says now was so that long ago.
        time = track.time
        angles: list[Array] = [np.interp(time + late, time, axis) for axis in track.angles.T]
        track = replace(track, angles=np.stack(angles, axis=-1))
    if alike:
        require_turning(where, track, run.sensor, told.readback)
    again = repeated_readback_finding(track)
    return (
        *check_track(where, track, run.sensor, bench, told),
        *check_earth_rate(where, track, run.sensor, bench),
        *(dropped_sample_findings(track, run.sensor, bench) if again is None else (again,)),
    )


def _require_complete_first_rest(
    run: Source[TurntableData], time: Array, angles: Array, holds: Indices
) -> None:
    """Refuse a first rest that a gap cuts short: filters begin with a rest without one."""
    if run.method.sequential is None or len(holds) < 2:
        return
    (_, stop), (after, _) = holds[:2].tolist()
    lasting = float(time[stop - 1] - time[0])
    gap = np.diff(time[stop - 1 : after + 1])
    moved = np.abs(angles[after] - angles[stop - 1]).max()
    if lasting < MIN_REST_SECONDS and moved < _MOVED and gap.max(initial=0.0) > MAX_GAP_SECONDS:
        at = stop - 1 + int(np.argmax(gap))
        raise InputError(
            f"{run.path}: no sample for {gap.max():.3g} s after {time[at]:.6g} s, in the first "
            f"rest: the filters begin with {COARSE_REST_SECONDS:.3g} s of rest without a gap; "
            "leave out what is before it if enough is left, or record again"
        )


def _require_track(run: Source[TurntableData]) -> None:
    """Refuse what goes with other benches: filters follow the samples of one recording."""
    if run.data.kind == "means":
        raise InputError(
            f"{run.path}: [data] kind is means; filters on a turntable follow a recording"
        )
    if run.data.seconds is not None or run.data.marks != "found":
        key = "marks" if run.data.seconds is None else "seconds"
        raise InputError(
            f"{run.path}: [data] {key}: holds of a turntable are detected in its readback; leave "
            "it out"
        )


def _require_small_latency(run: Source[TurntableData], bench: Turntable) -> None:
    """Refuse a latency that the readback may have within more than is linear."""
    if run.data.table_file is None and bench.latency.sd > _WIDEST:
        raise InputError(
            f"{run.path}: [bench] latency: its deviation, {1e3 * bench.latency.sd:.3g} ms, is more "
            f"than {1e3 * _WIDEST:.3g} ms, beyond which what it does is not linear; state it "
            "nearer, or give the readback its own times, [data] table_file"
        )


def _numbered_holds(run: Source[TurntableData], recording: Recording) -> Indices:
    """Return the holds that the recording itself numbers.

    Raises
    ------
    InputError
        Numbers that are not whole, or none.
    """
    number = recording.readback[HOLD_COLUMN]
    if (number != np.round(number)).any():
        k = int(np.argmax(number != np.round(number)))
        raise InputError(
            f"{run.path}: [data] hold: {number[k]:.6g} in {recording.where(k)}: numbers of holds "
            "are whole, and negative where the table moves"
        )
    found = holds_from_numbers(recording.time, number)
    if not len(found):
        raise InputError(f"{run.path}: [data] hold: no sample of {run.data.hold!r} is in a hold")
    return found


def _build_track(
    run: Source[TurntableData],
    recording: Recording,
    angles: Array,
    holds: Indices,
    quality: AngleQuality | None = None,
) -> Track:
    number = np.full(recording.time.size, -1, dtype=np.int64)
    for k, (start, stop) in enumerate(holds.tolist()):
        number[start:stop] = k
    places = [recording.channels.index(name) for name in run.sensor.channels]
    reading = run.sensor.to_si(recording.data[:, places])
    return Track(recording.time, reading, angles, number, recording.temperature, quality)


def _build_steps(
    run: Source[TurntableData],
    recording: Recording,
    angles: Array,
    holds: Indices,
    turns: Sequence[AxisTurn],
) -> tuple[tuple[Mark, ...], tuple[TableStep, ...], list[str] | None]:
    """Return marks and steps of holds and turns, in the order of time, and their own labels."""
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
    steps = label_steps([step for *_, step in found], own, run)
    marks = tuple(
        Mark(step.label, start, stop) for (start, stop, _), step in zip(found, steps, strict=True)
    )
    return marks, steps, own


def _conditions(read: RecordingWithAngles, steps: Sequence[TableStep]) -> dict[str, str]:
    bench, count = read.bench, Counter(type(step) for step in steps)
    late = {"latency of the readback": format_quantity(bench.latency.value, bench.latency.sd, "ms")}
    return {
        "gravity": format_quantity(bench.gravity.value, bench.gravity.sd, "m/s²"),
        "latitude": f"{degrees(bench.latitude):.6g} °",
        "azimuth at zero angles": format_quantity(bench.azimuth.value, bench.azimuth.sd, "°"),
        "path": f"{count[Position]} holds and {count[Rotation]} turns, found by the readback",
        **(late if read.clock is None else describe_clock(read.clock)),
        "right angles of the axes (k = 1)": format_quantity(bench.square, 0.0, "″"),
    }
