"""Read the observations from a table of means, or from a recording of labelled sections."""

from collections.abc import Sequence
from dataclasses import replace
from math import degrees
from pathlib import Path
from typing import Any

import numpy as np

from inercal.basics.arrays import Array
from inercal.basics.errors import InputError, error_location
from inercal.basics.units import format_quantity
from inercal.benches.characteristics import BAND_NOTE, characteristic_notes, rows_of_bands
from inercal.benches.rate_platform.bench import STATED, RatePlatform
from inercal.benches.rate_platform.linearity import gyro_characteristics
from inercal.benches.rate_platform.mean_motion import level_rate_changes
from inercal.benches.rate_platform.rate_checks import require_axes_up, require_rates, require_steady
from inercal.benches.rate_platform.section_finder import find_sections, settled
from inercal.benches.rate_platform.sections import (
    SMALL_RATE,
    KnownTurn,
    PlatformStep,
    Pose,
    RateDwell,
    dwell_label,
    pose_label,
    step_of_label,
    turn_label,
)
from inercal.benches.rate_platform.settings import RatePlatformData
from inercal.physics.section_settings import key_error
from inercal.physics.sensors import Sensor
from inercal.recordings import Finding, Mark, Recording
from inercal.recordings.data import EstimatorInput, RunBase, recording_loader
from inercal.recordings.data.rest_marks import parse_face
from inercal.recordings.io.column_table import Table
from inercal.recordings.io.file_patterns import is_pattern
from inercal.recordings.io.mean_tables import observations_from_table, read_columns
from inercal.recordings.io.rest_norm import rest_mean_finding
from inercal.recordings.segments import average_sections, marks_from_labels

_ACROSS = 0.5  # cosine between a gyro's axis and the table's, below which a scale hardly shows
_SHORTEST = 1.0  # s: a table does not reach a rate and hold it in less


def observe(run: RunBase[RatePlatformData]) -> EstimatorInput:
    """Return the observations from a run on a rate platform.

    Raises
    ------
    InputError
        The data cannot be used, or a stated error of the bench acts in no section.
    """
    bench: RatePlatform = run.bench
    result = _table(run) if run.data.kind == "means" else _recording(run)
    steps = [step for step in result.steps if isinstance(step, RateDwell | Pose)]
    _refuse_unused_errors(run, bench, steps)
    still = [isinstance(step, Pose) or step.rate == 0 for step in steps]
    odd = rest_mean_finding(result.observations.mean[still], run.sensor, bench.gravity.value)
    findings = result.findings + recording_loader.require_not_refused(run.data.file, odd)
    require_rates(run, result.observations, bench, steps)
    require_axes_up(run, result.observations, bench, steps)
    found = gyro_characteristics(result.observations, run.sensor, bench, steps)
    notes, names = characteristic_notes(found), {one.name for one in found}
    if "threshold" in names and "resolution" not in names:
        limit = f"{degrees(SMALL_RATE):g} °/s"
        text = f"A resolution needs small rates about a rate above {limit}, up to a tenth of it."
        notes = (*notes, text)
    findings += _unseen_exchanges(run.sensor, steps)
    conditions = _conditions(bench, steps)
    if banded := rows_of_bands(found):
        result = result.rows([row for row in range(len(steps)) if row not in banded])
        notes = (*notes, BAND_NOTE)
    return replace(
        result, findings=findings, conditions=conditions, notes=notes, characteristics=found
    )


def _unseen_exchanges(sensor: Sensor, steps: Sequence[RateDwell | Pose]) -> tuple[Finding, ...]:
    """Return a note on gyros about whose axes nothing turns: their columns may be exchanged."""
    up = [step.up for step in steps if isinstance(step, RateDwell) and step.rate]
    gyros = sensor.select_axes("w")
    turned = np.abs(gyros.input_axes("w") @ np.array(up).T).max(axis=1) if up else np.ones(0)
    names = [n for n, most in zip(gyros.channels, turned, strict=False) if most < _ACROSS]
    if len(names) < 2:
        return ()
    text = f"exchanged or reversed columns of {' and '.join(names)}; turn about these axes"
    return (Finding("note", "unseen", text),)


def _refuse_unused_errors(
    run: RunBase[RatePlatformData], bench: RatePlatform, steps: Sequence[PlatformStep]
) -> None:
    sensor = run.sensor
    if run.adds_coefficients and bench.arm is not None:  # the arm acts if `g` is added
        with_g = sensor.select_axes("w").with_coefficients("g").coefficients
        free = dict.fromkeys((*sensor.coefficients, *with_g))
        sensor = replace(sensor, coefficients=tuple(free))
    names = {p.name for p in bench.nuisances(steps, sensor).values()}
    turns = any(isinstance(step, RateDwell) and step.rate for step in steps)
    why, also = ("", "") if turns else ("no row turns, so ", "measure at several rates, or ")
    for name, one in STATED.items():
        own = {f"{name}_{k}" for k in one.components} or {name}
        if own & set(bench.qualified.names):
            continue  # one qualification serves runs of several kinds
        if bench.deviation(name) is not None and not own & names:
            text = f"{why}nothing in this run depends on it; {also}remove the key"
            raise key_error(f"[bench] {name}", text, run.path)


def _table(run: RunBase[RatePlatformData]) -> EstimatorInput:
    data, path, wanted = run.data, run.file(run.data.file), recording_loader.reader_columns(run)
    columns = {
        name: str(column)
        for name in ("axis", "table_rate", "turn", "setting", "roll", "pitch", "seconds")
        if (column := getattr(data, name)) is not None
    }
    recording_loader.require_distinct_columns(run, *columns.values())
    _require_partners(run, columns)
    if not {"axis", "roll"} & set(columns):
        raise key_error(
            "[data] axis",
            "is missing: name the columns axis and table_rate for rests and rates, or roll and "
            "pitch for poses",
            run.path,
        )
    table = read_columns(path, wanted, list(columns.values()))
    durations = table.numbers(columns["seconds"]) if "seconds" in columns else None
    seconds = np.zeros(table.rows) if durations is None else durations
    made = [_step(data, path, table, columns, k, one) for k, one in enumerate(seconds.tolist())]
    labels = tuple(recording_loader.number_repeated_names([step.label for step in made]))
    steps = tuple(replace(step, label=label) for step, label in zip(made, labels, strict=True))
    observations = observations_from_table(
        path, table, labels, wanted, run.sensor, recording_loader.stated_deviations(run), durations
    )
    return EstimatorInput(None, (), observations, steps, steps, ())


def _require_partners(run: RunBase[RatePlatformData], columns: dict[str, str]) -> None:
    """Refuse a column that needs another column if the other column is not named."""
    needed = [("table_rate", "axis"), ("turn", "axis"), ("turn", "seconds")]
    needed += [("roll", "pitch"), ("pitch", "roll")]
    if "turn" not in columns:
        needed.append(("axis", "table_rate"))
    for name, partner in needed:
        if name in columns and partner not in columns:
            raise key_error(
                f"[data] {partner}", f"is missing: {name} needs it; name its column", run.path
            )


def _step(
    data: RatePlatformData,
    path: Path,
    table: Table,
    columns: dict[str, str],
    row: int,
    seconds: float,
) -> PlatformStep:
    """Return the section that one row of a table describes."""
    line = table.first_line + row

    def cell(name: str) -> str:
        if name not in columns:
            return ""
        text = recording_loader.position_name(table.columns[columns[name]].tolist()[row])
        return "" if text == "nan" else text

    def refuse(name: str, text: str) -> InputError:
        return InputError(
            f"{path} line {line}: column {columns.get(name, name)!r} {text}",
            file=path,
            line=line,
            names=(columns.get(name, name),),
        )

    def number(name: str) -> float:
        text = cell(name)
        try:
            value = float(text.replace("−", "-"))
        except ValueError:
            value = float("nan")
        if not np.isfinite(value):
            raise refuse(name, f"is {text!r}; give a number" if text else "is empty; give a number")
        return value

    if cell("axis") and (cell("roll") or cell("pitch")):
        raise refuse("axis", "names the axis of a rate, but the row has angles of a pose; keep one")
    if not cell("axis"):
        if "roll" not in columns:
            raise refuse("axis", "is empty; name the case axis that is up, such as x or -x")
        roll, pitch = (number(name) * data.angle_size for name in ("roll", "pitch"))
        return Pose(pose_label(roll, pitch), roll, pitch, seconds)
    axis = parse_face(cell("axis"))
    if axis is None:
        raise refuse("axis", f"is {cell('axis')!r}; name the case axis that is up, such as x or -x")
    if cell("turn"):
        if cell("table_rate"):
            raise refuse("turn", "has the angle of a turn, but the row has a rate; keep one")
        angle = number("turn") * data.angle_size
        if not seconds > 0:
            raise refuse("seconds", "needs a duration above 0 for the turn")
        return KnownTurn(turn_label(axis, angle), axis, angle / seconds, seconds, cell("setting"))
    rate = number("table_rate") * data.rate_size
    if "setting" in columns and not cell("setting"):
        raise refuse("setting", "is empty; give the setting's name")
    return RateDwell(dwell_label(axis, rate), axis, rate, seconds, cell("setting"))


def _recording(run: RunBase[RatePlatformData]) -> EstimatorInput:
    if run.data.seconds is not None:
        raise key_error("[data] seconds", "is only for a table of means; remove the key", run.path)
    recording = recording_loader.load_recording(run)
    marks, steps = _marked_sections(run, recording)
    longest = max((step.seconds for step in steps), default=1.0)
    if longest < _SHORTEST:
        text = f"the longest section lasts {longest:.3g} s; check the unit of time, or the rate"
        raise key_error("[data] time_unit" if run.data.time else "[data] rate", text, run.path)
    known = level_rate_changes(run.bench.latitude, recording, run.sensor, marks, steps)
    require_steady(run, recording, marks, steps, known)
    # Sections at a rate are steady too, so their scatter is noise.
    turning = [step.label for step in steps if isinstance(step, KnownTurn)]
    means = average_sections(
        recording, run.sensor, marks, steps, found=True, drifting=True, turning=turning, known=known
    )
    return EstimatorInput(recording, marks, means, steps, steps, recording.findings)


def _marked_sections(
    run: RunBase[RatePlatformData], recording: Recording
) -> tuple[tuple[Mark, ...], tuple[PlatformStep, ...]]:
    """Return the sections: labelled, one file each, or found with the gyros."""
    data, settle = run.data, run.data.settling_seconds
    if data.marks == "labels" or is_pattern(run.file(data.file)):
        if data.sections is not None:
            raise key_error(
                "[data] sections", "the labels already name the sections; remove sections", run.path
            )
        marks = marks_from_labels(recording)
        spans = [recording.span(mark.start, mark.stop) for mark in marks]
        steps = tuple(
            step_of_label(mark.label, seconds) for mark, seconds in zip(marks, spans, strict=True)
        )
        return settled(recording, marks, steps, settle) if settle else (marks, steps)
    if data.marks != "found":
        raise key_error(
            "[data] marks",
            'sections are "found" with the gyros in the order of [data] sections or the plan, or '
            'labelled, such as "x +50" and "x rest", with marks = "labels"',
            run.path,
        )
    with error_location(run.path):
        return find_sections(recording, run.sensor, _stated_sections(run), settle)


def _stated_sections(run: RunBase[RatePlatformData]) -> list[PlatformStep]:
    """Return the sections that [data] sections or the plan states."""
    if run.data.sections is None:
        return [step for step in run.steps if isinstance(step, RateDwell | Pose)]
    labels = recording_loader.number_repeated_names(run.data.sections)
    return [step_of_label(label, 1.0) for label in labels]  # durations follow from the recording


def _conditions(bench: RatePlatform, steps: Sequence[PlatformStep]) -> dict[str, str]:
    dwells = [step for step in steps if isinstance(step, RateDwell)]
    result = {"gravity": format_quantity(bench.gravity.value, bench.gravity.sd, "m/s²")}
    if bench.latitude is not None:
        result["latitude"] = format_quantity(bench.latitude.value, bench.latitude.sd, "°")
    if dwells:
        rates: Array = np.array([step.rate for step in dwells]) * 180 / np.pi
        result["rates"] = f"{rates.min():.6g} to {rates.max():.6g} °/s".replace("-", "−")
        result["settings"] = ", ".join(dict.fromkeys(step.place for step in dwells))
    result["sections"] = f"{len(dwells)} at rates and rests, {len(steps) - len(dwells)} poses"
    for name, one in STATED.items():
        value: Any = bench.deviation(name)
        if value is not None:
            unit = {"1": "ppm", "m": "mm", "°/s": "°/h"}.get(one.like, one.like)
            result[f"{one.meaning} (k = 1)"] = format_quantity(value, 0.0, unit)
    return result
