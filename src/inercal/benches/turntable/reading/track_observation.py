"""Read the filters' track and the means of the steps from a recording on a turntable."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from math import degrees, pi, radians

import numpy as np

from inercal.basics.arrays import Array, Indices
from inercal.basics.errors import InputError, error_location
from inercal.basics.units import format_duration, format_quantity
from inercal.benches.turntable.bench import (
    COARSE_REST_SECONDS,
    MAX_GAP_SECONDS,
    MIN_REST_SECONDS,
    Turntable,
    settling_time,
)
from inercal.benches.turntable.reading import sample_checks
from inercal.benches.turntable.reading.dropped_samples import dropped_sample_findings
from inercal.benches.turntable.reading.gyro_comparison import gyro_comparison_findings
from inercal.benches.turntable.reading.host_readback import Interruption, are_interrupted
from inercal.benches.turntable.reading.implied_rates import (
    RateRegression,
    check_earth_rate,
    fit_track_rates,
)
from inercal.benches.turntable.reading.readback_angles import (
    RecordingWithAngles,
    SoakWaits,
    add_table_angles,
    describe_clock,
    without_waits,
)
from inercal.benches.turntable.reading.readback_clock import ClockMismatch
from inercal.benches.turntable.reading.step_labels import compare_with_plan, label_steps
from inercal.benches.turntable.reading.still_table_observation import observe_without_angles
from inercal.benches.turntable.reading.track_checks import (
    ColumnNames,
    check_track,
    describe_sampling,
)
from inercal.benches.turntable.settings import HOLD_COLUMN, TurntableData
from inercal.physics.plan import Position, Rotation, TableStep
from inercal.physics.section_settings import key_error
from inercal.recordings import AngleQuality, Finding, Mark, Recording, Track
from inercal.recordings.data import EstimatorInput, RunBase, recording_loader
from inercal.recordings.segments import average_sections
from inercal.recordings.segments.turntable_segments import (
    AxisTurn,
    find_holds,
    find_turns,
    holds_from_numbers,
    select_long_holds,
)

_WIDEST = 0.05  # s
_NOT_LATE = 1e-3  # s
_MOVED = radians(0.1)
_EXACT = 4  # decimals in degrees for the angles of positions


def observe(run: RunBase[TurntableData]) -> EstimatorInput:
    """Return the track of a run on a turntable, with the means of its holds and turns.

    Raises
    ------
    InputError
        The data cannot be used.
    """
    if run.method.without_angles:
        return observe_without_angles(run)
    if "sample" in run.data.model_fields_set:
        raise key_error(
            "[data] sample", f"{run.method.name} needs instantaneous readings; remove it", run.path
        )
    bench: Turntable = run.bench
    with error_location(run.path):
        _require_track(run)
    recording_loader.require_distinct_columns(
        run, *(str(c) for c in (run.data.table_time,) if c is not None)
    )
    _require_small_latency(run, bench)
    recording = recording_loader.load_recording(run)
    try:
        read = add_table_angles(run, recording, bench)
    except ClockMismatch as error:
        holds = find_holds(recording.time, error.angles, None, settling_time(bench))
        _check_track(run, _build_track(run, recording, error.angles, holds), bench, alike=False)
        raise  # the checks raise an error with a cause, if they find one
    read, soaks = without_waits(read, run.environment)
    recording, bench = read.recording, read.bench
    angles = np.stack([recording.readback[name] for name in bench.names], axis=-1)
    named = tuple(recording_loader.readback_columns(run)[name] for name in bench.names)
    if read.clock is None:
        size = abs(recording_loader.readback_units(run)[bench.names[0]])
        sample_checks.require_angle_unit(str(run.path), angles / size, size, named)
        sample_checks.require_readback(str(run.path), recording, angles, named)
    if HOLD_COLUMN in recording.readback:
        with error_location(run.path):
            holds = _numbered_holds(run, recording)
    else:
        holds = find_holds(recording.time, angles, recording.labels, settling_time(bench))
    if not len(holds):
        raise InputError(
            f"{recording.source}: according to its readback the table never rests for one second; "
            f"check [data] table, which is {', '.join(named)}, time_unit and rate: "
            f"{describe_sampling(recording.time)}",
            key="[data] table",
            names=named,
        )
    _require_complete_first_rest(run, recording.time, angles, holds)
    track = _build_track(run, recording, angles, holds, read.quality)
    sample_checks.require_range(str(run.path), recording, track, run.sensor)
    findings = (
        *recording.findings,
        *sample_checks.spike_findings(recording, run.sensor),
        *_check_soaks(run, track, bench, read.interruptions, soaks),
    )
    turns = find_turns(recording.time, angles, recording.labels)
    if HOLD_COLUMN in recording.readback and recording.labels is not None:
        # The settling of a servo at the beginning of a hold is not a turn.
        rests = {str(recording.labels[start]) for start, _ in holds.tolist()}
        turns = tuple(
            t for t in turns if str(recording.labels[(t.start + t.stop) // 2]) not in rests
        )
    marks, steps, own = _build_steps(
        run, recording, angles, select_long_holds(recording.time, holds), turns
    )
    repeated = _repeated_steps(recording.time, marks, own, read.interruptions)
    findings += compare_with_plan(steps, own, run, repeated)
    try:
        observations = average_sections(recording, run.sensor, marks, steps, found=True)
    except InputError as error:
        # If turns are split, an error of the readback is the cause, so report that.
        causes = [one.message for one in findings if one.what == "readback"]
        raise error.located(f"{run.path}: {'; '.join(causes)}") if causes else error from None
    before, after = recording.time[recording.gaps].T
    known = are_interrupted(before, after, (*read.interruptions, *soaks.waits))
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
        pauses=tuple(np.flatnonzero(known).tolist()),
    )


def _check_soaks(
    run: RunBase[TurntableData],
    track: Track,
    bench: Turntable,
    interruptions: Sequence[Interruption],
    soaks: SoakWaits,
) -> tuple[Finding, ...]:
    """Check the track of each soak, because the checks assume constant biases and scales."""
    known = (*interruptions, *soaks.waits)
    ends = (*soaks.first_samples[1:], track.time.size)
    parts = [track.slice(*part) for part in zip(soaks.first_samples, ends, strict=True)]
    if len(parts) == 1:
        return _check_track(run, track.with_known_angles, bench, known)
    found = [
        one for part in parts for one in _check_track(run, part.with_known_angles, bench, known)
    ]
    return tuple(replace(one, start=None, stop=None) for one in found)


def _check_track(
    run: RunBase[TurntableData],
    track: Track,
    bench: Turntable,
    interruptions: Sequence[Interruption] = (),
    *,
    alike: bool = True,
) -> tuple[Finding, ...]:
    """Check a track before filters follow it, and return the findings.

    If the clocks are not `alike`, the readback may be constant while the gyros measure a turn.
    """
    kinds = {axis.measures for axis in run.sensor.axes}
    columns = ColumnNames(
        tuple(map(str, run.data.accelerometer)) if "f" in kinds else (),
        tuple(map(str, run.data.gyro)) if "w" in kinds else (),
        tuple(map(str, run.data.table or bench.names)),
    )
    where = str(run.path)
    late = bench.latency.value
    if abs(late) > _NOT_LATE:
        # The readback shows the angles at a time earlier by `late`.
        time = track.time
        angles: list[Array] = [np.interp(time + late, time, axis) for axis in track.angles.T]
        track = replace(track, angles=np.stack(angles, axis=-1))
    if alike:
        sample_checks.require_turning(where, track, run.sensor, columns.readback)
    findings = check_track(where, track, run.sensor, bench, columns, interruptions)
    known: RateRegression | None = None
    if run.sensor.rank("w") == len("xyz"):
        known = fit_track_rates(bench, track, run.sensor)
    findings += check_earth_rate(where, track, run.sensor, bench, known)
    if (repeated := sample_checks.repeated_readback_finding(track)) is not None:
        return (*findings, repeated)
    lost = dropped_sample_findings(track, run.sensor, bench, known)
    return findings + (lost or gyro_comparison_findings(track, run.sensor, bench))


def _require_complete_first_rest(
    run: RunBase[TurntableData], time: Array, angles: Array, holds: Indices
) -> None:
    """Refuse a gap in the first rest, because filters begin with a rest without a gap."""
    if run.method.sequential is None or len(holds) < 2:
        return
    (_, stop), (after, _) = holds[:2].tolist()
    duration = float(time[stop - 1] - time[0])
    gap = np.diff(time[stop - 1 : after + 1])
    moved = np.abs(angles[after] - angles[stop - 1]).max()
    if duration < MIN_REST_SECONDS and moved < _MOVED and gap.max(initial=0.0) > MAX_GAP_SECONDS:
        at = stop - 1 + int(np.argmax(gap))
        raise InputError(
            f"{run.path}: the first rest has no sample for {format_duration(gap.max())} after "
            f"{time[at]:.6g} s, but the filters need {COARSE_REST_SECONDS:.3g} s without a gap; "
            "remove the samples before the gap if the rest after it is long enough, or record "
            "again",
            file=run.path,
        )


def _require_track(run: RunBase[TurntableData]) -> None:
    """Refuse keys for other benches, because filters follow the samples of one recording."""
    if run.data.kind == "means":
        raise key_error(
            "[data] kind", "the filters on a turntable need samples, not means; give a recording"
        )
    if run.data.seconds is not None or run.data.marks != "found":
        key = "marks" if run.data.seconds is None else "seconds"
        raise key_error(
            f"[data] {key}", "holds of a turntable are detected in its readback; remove the key"
        )


def _require_small_latency(run: RunBase[TurntableData], bench: Turntable) -> None:
    """Refuse a latency that is too uncertain for the linear model of the filters."""
    if run.data.table_file is None and bench.latency.sd > _WIDEST:
        raise key_error(
            "[bench] latency",
            f"its standard uncertainty, {1e3 * bench.latency.sd:.3g} ms, exceeds "
            f"{1e3 * _WIDEST:.3g} ms, the limit of the linear model; measure the latency better, "
            "or state the readback's file with its times in [data] table_file",
            run.path,
        )


def _numbered_holds(run: RunBase[TurntableData], recording: Recording) -> Indices:
    """Return the holds that the recording itself numbers.

    Raises
    ------
    InputError
        A number is not whole, or there is no hold.
    """
    number = recording.readback[HOLD_COLUMN]
    if (number != np.round(number)).any():
        k = int(np.argmax(number != np.round(number)))
        raise key_error(
            "[data] hold",
            f"{recording.where(k)} has {number[k]:.6g}; the number of a hold must be whole, and "
            "negative while the table moves",
        )
    holds = holds_from_numbers(recording.time, number)
    if not len(holds):
        raise key_error(
            "[data] hold",
            f"column {run.data.hold!r} has no hold number, 0 or more; number the holds, or remove "
            "the key",
        )
    return holds


def _build_track(
    run: RunBase[TurntableData],
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
    run: RunBase[TurntableData],
    recording: Recording,
    angles: Array,
    holds: Indices,
    turns: Sequence[AxisTurn],
) -> tuple[tuple[Mark, ...], tuple[TableStep, ...], list[str] | None]:
    """Return marks and steps for holds and turns in the order of time, and the recorded labels."""
    sections: list[tuple[int, int, TableStep]] = []
    for start, stop in holds.tolist():
        mean = angles[start:stop].mean(axis=0)
        rounded = np.degrees(pi - (pi - mean) % (2 * pi)).round(_EXACT) + 0.0
        seconds = recording.span(start, stop)
        sections.append((start, stop, Position("", tuple(np.radians(rounded).tolist()), seconds)))
    for turn in turns:
        step = Rotation("", turn.axis, turn.angle, abs(turn.rate))
        sections.append((turn.start, turn.stop, step))
    sections.sort(key=lambda section: section[0])
    middles = [(start + stop) // 2 for start, stop, _ in sections]
    own = None if recording.labels is None else recording.labels[middles].tolist()
    steps = label_steps([step for *_, step in sections], own, run)
    marks = tuple(
        Mark(step.label, start, stop)
        for (start, stop, _), step in zip(sections, steps, strict=True)
    )
    return marks, steps, own


def _repeated_steps(
    time: Array,
    marks: Sequence[Mark],
    own: Sequence[str] | None,
    interruptions: Sequence[Interruption],
) -> frozenset[str]:
    """Return the labels of steps that were interrupted, and of moves until they were repeated.

    The host gave these steps no label. They lie between two steps that have one.
    """
    blank = [not name.strip() for name in own or ()]
    repeated: set[str] = set()
    for k in np.flatnonzero(blank).tolist():
        before = max((j for j in range(k) if not blank[j]), default=None)
        after = min((j for j in range(k, len(blank)) if not blank[j]), default=None)
        start = -np.inf if before is None else time[marks[before].stop - 1]
        stop = np.inf if after is None else time[marks[after].start]
        if any(one.start <= stop and one.stop >= start for one in interruptions):
            repeated.add(marks[k].label)
    return frozenset(repeated)


def _conditions(read: RecordingWithAngles, steps: Sequence[TableStep]) -> dict[str, str]:
    bench, count = read.bench, Counter(type(step) for step in steps)
    late = {"latency of the readback": format_quantity(bench.latency.value, bench.latency.sd, "ms")}
    return {
        "gravity": format_quantity(bench.gravity.value, bench.gravity.sd, "m/s²"),
        "latitude": f"{degrees(bench.latitude):.6g} °",
        "azimuth at zero angles": format_quantity(bench.azimuth.value, bench.azimuth.sd, "°"),
        "path": f"{count[Position]} holds and {count[Rotation]} turns, detected in the readback",
        **(late if read.clock is None else describe_clock(read.clock)),
        "right angles of the axes (k = 1)": format_quantity(bench.square, 0.0, "″"),
    }
