"""Read the observations from a run by hand: sections of a plan, or rests in any attitude."""

from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache
from itertools import pairwise

import numpy as np

from inercal.basics.errors import InputError
from inercal.basics.units import format_quantity
from inercal.benches.hand.axes_check import NO_TURNS, check_axes, explain_norm, positions_note
from inercal.benches.hand.bench import Hand, visit_number
from inercal.benches.hand.magnetic_reading import require_earth_field, with_magnetometers
from inercal.physics.plan import HandStep, Hold, Turn
from inercal.physics.section_settings import key_error
from inercal.physics.sensors import Sensor
from inercal.recordings import Finding, Mark, Observations, Recording, Track, segments
from inercal.recordings.data import EstimatorInput, RestsSection, RunBase, recording_loader
from inercal.recordings.data.rest_marks import (
    check_marked_rests,
    check_rests,
    planned_name,
    rests_without_plan,
    stated_marks,
)
from inercal.recordings.io.audit import require_accepted
from inercal.recordings.io.file_patterns import is_pattern
from inercal.recordings.io.mean_tables import read_means
from inercal.recordings.io.rest_norm import audit_rest_norm, rest_mean_finding
from inercal.recordings.segments import RestDetection
from inercal.recordings.segments.magnetic_means import clipped_samples, magnetic_samples
from inercal.recordings.segments.motion_thresholds import WINDOW

_CHAMBER_PAUSE = 60.0  # s; longer than a fault of a logger


def observe_whole_rest(run: RunBase[RestsSection]) -> EstimatorInput:
    """Return the whole recording as one observation, with its track.

    Raises
    ------
    InputError
        The data are a table of means, the recording has no temperature although coefficients depend
        on it, or the audit refuses it.
    """
    if run.data.kind == "means":
        text = f"method {run.method.name} needs every sample; give the recording"
        raise key_error("[data] kind", text, run.path)
    if run.data.marks != "found":
        text = f"method {run.method.name} follows the whole recording; remove marks"
        raise key_error("[data] marks", text, run.path)
    recording, sensor = recording_loader.load_recording(run), run.sensor
    if recording.temperature is None and run.whole_sensor.uses("dT"):
        raise key_error(
            "[data] temperature",
            f"is missing: method {run.method.name} needs the sensor's temperature; name its column",
            run.path,
        )
    columns = [recording.channels.index(name) for name in sensor.channels]
    reading = sensor.to_si(recording.data[:, columns])
    n = len(reading)
    hold = np.zeros(n, dtype=np.int64)
    track = Track(recording.time, reading, np.zeros((n, 0)), hold, recording.temperature)
    first, *others = nominal_plan(run)
    step = replace(first, label="motion") if others else first
    findings, magnetic = recording.findings, None
    if run.magnetometer is not None:
        own = recording_loader.load_magnetometers(run)
        clipped, railed = clipped_samples(own, run.magnetometer)
        magnetic = magnetic_samples(own.take(~clipped), run.magnetometer)
        require_earth_field(run, magnetic)
        findings += tuple(one for one in (*railed, *own.findings) if one not in findings)
    observations = Observations(
        labels=(step.label,),
        mean=reading.mean(axis=0)[None],
        covariance=np.diag(reading.var(axis=0) / n)[None],
        duration=np.array([recording.duration]),
        samples=np.array([n]),
        time=np.array([recording.time.mean()]),
        channels=sensor.channels,
        temperature=None
        if recording.temperature is None
        else np.array([recording.temperature.mean()]),
        track=track,
        magnetic=magnetic,
    )
    marks = (Mark(step.label, 0, n),)
    return EstimatorInput(recording, marks, observations, (step,), (step,), findings)


def observe(run: RunBase[RestsSection]) -> EstimatorInput:
    """Return the observations from a run by hand.

    Raises
    ------
    InputError
        The data cannot be used.
    """
    if run.method.follows_rest:
        return observe_whole_rest(run)
    sensor, bench = run.sensor, run.bench
    recording, rests = None, None
    marks: tuple[Mark, ...] = ()
    findings: tuple[Finding, ...] = ()
    if run.data.kind == "means":
        observations = _read_means(run)
    else:
        recording = audit(recording_loader.load_recording(run), sensor, bench)
        if run.method.unknown_attitudes:
            rests = segments.find_rests(recording, sensor) if run.data.marks == "found" else None
            marks, observations, findings = _free_rests(run, recording, rests)
        else:
            marks, observations, findings = _planned_sections(run, recording)
    rows = {label: k for k, label in enumerate(observations.labels)}
    if run.method.unknown_attitudes:
        plan = steps = segments.holds_from_observations(observations, sensor)
    else:
        observations = _with_planned_names(run, observations)
        steps = _planned_steps(run, observations)
        plan = _plan_with_visits(run, steps)
    forces = bool(sensor.select_axes("f").axes)
    means = observations.mean[[isinstance(step, Hold) for step in steps]]
    if recording is None and forces:
        odd = rest_mean_finding(means, sensor, bench.gravity.value)
        findings += recording_loader.require_not_refused(run.data.file, odd)
    if not run.method.unknown_attitudes:
        findings += segments.check_against_plan(observations, sensor, steps, bench.gravity.value)
        if recording is not None and run.data.marks != "found" and sensor.rank("w") == len("xyz"):
            turned = any(isinstance(step, Turn) for step in steps)
            holds = [m for m in marks if isinstance(steps[rows[m.label]], Hold)]
            axes, odd = check_axes(run, recording, holds)
            findings += odd
            if axes.agree is None and not turned and sensor.rank("f") == len("xyz"):
                observations = replace(observations, notes=(*observations.notes, NO_TURNS))
    if forces:
        findings = explain_norm(findings, means, sensor, bench.gravity.value)
    if run.magnetometer is not None:
        ordered = sorted(marks, key=lambda mark: mark.start)
        rests_of = [(rows[m.label], m) for m in ordered if isinstance(steps[rows[m.label]], Hold)]
        observations, odd = with_magnetometers(run, observations, steps, recording, rests_of)
        findings += odd
    conditions = _conditions(run, bench)
    return EstimatorInput(recording, marks, observations, plan, steps, findings, conditions, rests)


def audit(recording: Recording, sensor: Sensor, bench: Hand) -> Recording:
    """Return the recording with findings about its norms at rest.

    Raises
    ------
    InputError
        The recording is refused because of a finding.
    """
    return require_accepted(audit_rest_norm(recording, sensor, bench.gravity.value))


def nominal_plan(run: RunBase[RestsSection]) -> tuple[HandStep, ...]:
    """Return the first visits of the run's plan; the labels of the data name further visits."""
    steps = (step for step in run.steps if isinstance(step, Hold | Turn))
    return tuple(step for step in steps if visit_number(step.label) == 1)


def _numbers_visits(run: RunBase[RestsSection]) -> bool:
    """Return whether a label may be repeated, at another temperature or azimuth.

    Otherwise a repeated label is a mistake, and a second visit needs its own label, such as
    "x_p (2)".
    """
    again = run.data.temperature is not None or run.magnetometer is not None
    return again and not run.method.unknown_attitudes


def _steps_by_visit(run: RunBase[RestsSection], count: int) -> dict[str, HandStep]:
    """Return the plan's steps by name, with up to `count` visits of each step."""
    return _visits(nominal_plan(run), count)


@lru_cache
def _visits(plan: tuple[HandStep, ...], count: int) -> dict[str, HandStep]:
    found: dict[str, HandStep] = {}
    for step in plan:
        names = recording_loader.number_repeated_names([step.label] * count)
        found |= {name: replace(step, label=name) for name in names}
    return found


def _plan_with_visits(run: RunBase[RestsSection], done: Sequence[HandStep]) -> tuple[HandStep, ...]:
    """Return the plan, in which each step is followed by its further visits."""
    wanted = {step.label for step in (*nominal_plan(run), *done)}
    return tuple(s for name, s in _steps_by_visit(run, len(done)).items() if name in wanted)


def _read_means(run: RunBase[RestsSection]) -> Observations:
    if run.method.unknown_attitudes and run.sensor.select_axes("w").axes:
        raise key_error(
            "[data] kind",
            "a table of means has no rotations, which the gyros need; remove [sensor.gyro], or "
            "give the recording",
            run.path,
        )
    seconds = run.data.seconds
    if seconds is None and any(isinstance(step, Turn) for step in run.steps):
        raise key_error(
            "[data] seconds", "is missing: name the column with the durations of turns", run.path
        )
    return read_means(
        run.file(run.data.file),
        recording_loader.reader_columns(run),
        run.sensor,
        recording_loader.stated_deviations(run),
        None if seconds is None else str(seconds),
        recording_loader.number_repeated_names if _numbers_visits(run) else tuple,
    )


def _planned_sections(
    run: RunBase[RestsSection], recording: Recording
) -> tuple[tuple[Mark, ...], Observations, tuple[Finding, ...]]:
    """Return the marks, means and findings for the sections of the plan's steps."""
    steps = nominal_plan(run)
    labels, missing = [step.label for step in steps], tuple[Finding, ...]()
    note = ""
    if run.data.marks == "found" and not run.sensor.select_axes("f").axes:
        raise key_error(
            "[data] marks",
            "gyros cannot show which axis is up; label the sections and state marks = "
            '"labels", or name a file of marks',
            run.path,
        )
    if run.data.marks == "found":
        parts, every = _files(run, recording), run.magnetometer is not None
        found = segments.find_sections(recording, run.sensor, steps, parts, every=every)
        axes, odd = check_axes(run, recording, found.rests)
        marks, missing, note = found.marks, found.findings + odd, positions_note(axes)
        if not marks:
            raise InputError(
                f"{recording.source}: no rest matches a position of the plan, "
                f"{', '.join(labels)}: {found.words}; mark the sections, or correct the plan",
                file=run.file(run.data.file),
                names=tuple(labels),
            )
    else:
        marks = stated_marks(run, recording, again=_numbers_visits(run))
        names = _planned_names(run, [mark.label for mark in marks])
        names = recording_loader.number_repeated_names(names) if _numbers_visits(run) else names
        marks = tuple(replace(m, label=name) for m, name in zip(marks, names, strict=True))
    marked = {mark.label for mark in marks}
    again = [s for n, s in _steps_by_visit(run, len(marks)).items() if n in marked]
    steps = tuple(dict.fromkeys((*again, *steps)))
    labels = [step.label for step in steps]
    segments.check_marks(marks, recording, labels)
    holds = {step.label for step in steps if isinstance(step, Hold)}
    moving = check_marked_rests(run, recording, [mark for mark in marks if mark.label in holds])
    observations = segments.average_sections(
        recording, run.sensor, marks, steps, found=True, drifting=True
    )
    if note:
        observations = replace(observations, notes=(*observations.notes, note))
    stated = run.data.model_fields_set & {"gyro", "gyro_file", "gyro_time"}
    if stated and not run.sensor.select_axes("w").axes:
        note = "the gyros are not used: [sensor.gyro], with their unit, is missing"
        observations = replace(observations, notes=(*observations.notes, note))
    findings = segments.check_turn_ends(recording, run.sensor, marks, steps)
    unused = _unused_label_findings(marks, labels)
    return marks, observations, recording.findings + missing + moving + findings + unused


def _unused_label_findings(marks: Sequence[Mark], labels: Sequence[str]) -> tuple[Finding, ...]:
    """Return findings on labels that name no step; a warning for one that resembles a step."""
    names = [name for name in dict.fromkeys(mark.label for mark in marks) if name not in labels]

    def seems_meant(name: str) -> bool:
        return any(name.startswith(label) or label.startswith(name) for label in labels)

    return tuple(
        Finding(
            "warning" if seems_meant(name) else "note",
            "label",
            f"the section {name!r} is not used, because it names no step; a second visit is "
            'written "x_p (2)"',
        )
        for name in names
    )


def _files(run: RunBase[RestsSection], recording: Recording) -> tuple[tuple[int, int], ...]:
    """Return the samples of each file if the recording has several, as (start, stop).

    A recording that was paused while a chamber changed its temperature has as many parts.
    """
    labels = recording.labels
    if labels is not None and is_pattern(run.file(run.data.file)):
        change = labels[1:] != labels[:-1]
    elif run.data.temperature is not None:
        change = np.diff(recording.time) > _CHAMBER_PAUSE
    else:
        return ()
    edges = [0, *(np.flatnonzero(change) + 1).tolist(), recording.time.size]
    return tuple(pairwise(edges))


def _planned_names(run: RunBase[RestsSection], labels: Sequence[str]) -> list[str]:
    """Return the plan's name for each label such as "+Z" or "z up", or the label itself."""
    known, names = _visits(nominal_plan(run), 1), list[str]()
    for label in labels:
        text, visit, number = label.partition(" (")
        name = planned_name(text)
        names.append(label if text in known or name not in known else f"{name}{visit}{number}")
    return names


def _with_planned_names(run: RunBase[RestsSection], observations: Observations) -> Observations:
    """Return the means with the plan's names.

    If no label names a step, and each mean shows which face of the case is up, gravity decides.
    """
    names = _planned_names(run, observations.labels)
    holds = [step for step in nominal_plan(run) if isinstance(step, Hold)]
    if run.data.kind == "means" and not set(names) & _steps_by_visit(run, len(names)).keys():
        force = [k for k, axis in enumerate(run.sensor.axes) if axis.measures == "f"]
        if len(force) == len("xyz") and len(holds) == len(nominal_plan(run)):
            names = segments.faces_up(observations.mean[:, force], holds) or names
    if names == list(observations.labels):
        return observations
    return replace(observations, labels=tuple(recording_loader.number_repeated_names(names)))


def _planned_steps(run: RunBase[RestsSection], observations: Observations) -> tuple[HandStep, ...]:
    by_label = _steps_by_visit(run, len(observations.labels))
    unknown = [label for label in observations.labels if label not in by_label]
    if unknown:
        planned = ", ".join(step.label for step in nominal_plan(run))
        what = f"the plan has no step {unknown[0]!r}"
        if run.data.row is None:
            what = "gravity does not show which face is up in each row, and no column names it"
        text = f"{run.data.file}: {what}; the plan's steps are {planned}"
        raise InputError(text, file=run.file(run.data.file), names=(unknown[0],))
    return tuple(by_label[label] for label in observations.labels)


def _free_rests(
    run: RunBase[RestsSection], recording: Recording, rests: RestDetection | None
) -> tuple[tuple[Mark, ...], Observations, tuple[Finding, ...]]:
    """Return the marks, means and findings for rests in any attitude and the moves between them."""
    findings = recording.findings
    if rests is not None:
        marks, findings = rests.marks, (*findings, rests.finding)
    else:
        marks = stated_marks(run, recording, again=_numbers_visits(run))
        segments.check_marks(marks, recording, [mark.label for mark in marks])
    marks, left_out = segments.valid_marks(recording, run.sensor, marks)
    findings += check_rests(run, recording, marks) + check_axes(run, recording, marks)[1]
    observations = segments.average_sections(
        recording, run.sensor, marks, segments.holds_from_marks(marks), by_hand=True, found=True
    )
    if run.sensor.select_axes("w").axes:
        cut = (
            ()
            if rests is None
            else segments.bias_jump_test(recording, run.sensor, rests.marks, rests.other_parts)
        )
        observations = replace(
            observations,
            transitions=segments.transitions_between_rests(recording, run.sensor, marks),
            halves=segments.changes_within_rests(recording, run.sensor, marks),
            tests=(*observations.tests, *cut),
        )
    return marks, observations, findings + left_out


def _conditions(run: RunBase[RestsSection], bench: Hand) -> dict[str, str]:
    conditions = {"gravity": format_quantity(bench.gravity.value, bench.gravity.sd, "m/s²")}
    if not run.method.unknown_attitudes:
        conditions["tilt of faces (k = 1)"] = format_quantity(bench.tilt, 0.0, "°")
        if any(isinstance(step, Turn) for step in nominal_plan(run)):
            key = "angle of turns (k = 1)"
            conditions[key] = format_quantity(bench.turn_angle, 0.0, "°")
    if bench.turn_on:
        key = "gyros' bias in a recording (k = 1)"
        conditions[key] = format_quantity(bench.turn_on, 0.0, "°/h")
    return conditions


def refused_recording_rests(run: RunBase[RestsSection], recording: Recording) -> RestDetection:
    """Return the rests in a refused recording."""
    if run.data.marks != "found" or run.method.unknown_attitudes:
        return rests_without_plan(run, recording)
    found = segments.search_sections(recording, run.sensor, nominal_plan(run))
    named = {(mark.start, mark.stop): mark.label for mark in found.marks}
    marks = tuple(
        replace(rest, label=named.get((rest.start, rest.stop), rest.label)) for rest in found.rests
    )
    return RestDetection(marks, found.levels, WINDOW, Finding("note", "rests", found.words))
