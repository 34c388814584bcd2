"""Read the observations from a run on a rate table: a table of states, or a recording."""

import re
from collections.abc import Sequence
from dataclasses import replace
from math import pi, radians
from pathlib import Path
from typing import cast

from inercal.basics.errors import InputError
from inercal.basics.units import format_quantity
from inercal.benches.rate_table.bench import RateTable, mounting_names, speed_names
from inercal.benches.rate_table.checks import require_axes, require_rates, require_unit
from inercal.benches.rate_table.fixture import PLANES, Plane, mounting_attitude
from inercal.benches.rate_table.settings import RateTableData
from inercal.physics.plan import Attitude, Spin
from inercal.physics.section_settings import key_error
from inercal.recordings import Finding, Recording, join_observations
from inercal.recordings.data import EstimatorInput, RunBase
from inercal.recordings.data.recording_loader import (
    load_recording,
    number_repeated_names,
    position_name,
    readback_columns,
    readback_units,
    reader_columns,
    stated_deviations,
)
from inercal.recordings.io.column_table import Table
from inercal.recordings.io.mean_tables import number_column, observations_from_table, read_columns
from inercal.recordings.segments import average_dwells, average_sections, find_dwells
from inercal.recordings.segments.dwells import ARM_RATE
from inercal.recordings.segments.stationary_states import (
    find_stationary_states,
    omitted_state_findings,
)

_ANGLE = r"(-?\d+(?:\.\d+)?)\s*°?"
_NAME = re.compile(rf"({'|'.join(PLANES)})(?:[ _]*{_ANGLE}(?:\s*\+\s*{_ANGLE})?)?")
_MOST_TILT = 360.0  # °


def observe(run: RunBase[RateTableData]) -> EstimatorInput:
    """Return the observations from a run on a rate table.

    Raises
    ------
    InputError
        The data cannot be used.
    """
    bench: RateTable = run.bench
    if run.data.seconds is not None:
        raise key_error(
            "[data] seconds", "a table of means needs no durations; remove the key", run.path
        )
    result = _table(run) if run.data.kind == "means" else reduce_recording(run, load_recording(run))
    steps = [step for step in result.steps if isinstance(step, Spin)]
    require_rates(run, result.observations, bench, steps)
    require_axes(run, result.observations, bench, steps)
    return replace(result, conditions=_conditions(bench, steps))


def _table(run: RunBase[RateTableData]) -> EstimatorInput:
    rate, unit = readback_columns(run)["arm_rate"], readback_units(run)["arm_rate"]
    wanted, path = reader_columns(run), run.file(run.data.file)
    where = str(run.data.mounting)
    table = read_columns(path, wanted, [where, rate])
    rates = number_column(path, table, rate, "give the rate, 0 at rest,") * unit
    poses = [
        _parse_mounting(position_name(text), where, f"{path} {table.place(k)}", path, table.line(k))
        for k, text in enumerate(table.columns[where].tolist())
    ]
    rpm = (rates * 30 / pi).tolist()
    names = [f"{pose.name} at {turning:.6g} rpm" for pose, turning in zip(poses, rpm, strict=True)]
    labels = tuple(number_repeated_names(names))
    observations = observations_from_table(
        path, table, labels, wanted, run.sensor, stated_deviations(run)
    )
    steps = tuple(
        Spin(label, turning, 0.0, pose)
        for label, turning, pose in zip(labels, rates.tolist(), poses, strict=True)
    )
    used = [where, rate, *(name for _, name, _ in wanted.channels)]
    return EstimatorInput(
        None, (), observations, steps, steps, _duplicate_row_findings(path, table, used)
    )


def _duplicate_row_findings(path: Path, table: Table, used: Sequence[str]) -> tuple[Finding, ...]:
    """Return a warning about identical rows, because each counts as an independent state."""
    first: dict[tuple[object, ...], int] = {}
    found: list[Finding] = []
    for k, row in enumerate(zip(*(table.columns[name].tolist() for name in used), strict=True)):
        if (same := first.setdefault(row, k)) != k:
            rows = f"{table.place(same)} and {table.place(k)}"
            text = f"{rows} of {path.name} are identical; remove one if it is a copy"
            found.append(Finding("warning", "repeated", text))
    return tuple(found)


def reduce_recording(run: RunBase[RateTableData], recording: Recording) -> EstimatorInput:
    """Reduce a recording to means: at rest, and over whole turns at each steady rate.

    Parameters
    ----------
    run : Run
    recording : Recording
        Recording with labels that name mountings, and "arm_rate" in the unit of its column.

    Raises
    ------
    InputError
        There is no dwell, there are too few turns, or a label does not name a mounting.
    """
    size = readback_units(run)["arm_rate"]
    recording = replace(recording, readback={ARM_RATE: recording.readback[ARM_RATE] * size})
    require_unit(run, recording, run.bench)
    found, flawed = find_dwells(recording, "table")
    # Samples without a label are no state: a host also records ramps and changes of the mounting.
    assert recording.labels is not None
    dwells = tuple(one for one in found if str(recording.labels[one.mark.start]).strip())
    turning, spun = average_dwells(recording, run.sensor, dwells)
    rests, also = find_stationary_states(recording)
    held = [Spin(mark.label, 0.0) for mark in rests]
    both = average_sections(recording, run.sensor, rests, held, found=True) if rests else None
    observations = turning if both is None else join_observations(turning, both)
    marks = (*(dwell.mark for dwell in dwells), *rests)
    steps: list[Spin] = []
    for step, mark in zip((*spun, *held), marks, strict=True):
        text, column = str(recording.labels[mark.start]), str(run.data.mounting)
        where = f"{recording.source} {recording.where(mark.start)}"
        attitude = _parse_mounting(text, column, where, recording.source or None)
        steps.append(replace(step, attitude=attitude))
    flawed += also
    findings = recording.findings + flawed + omitted_state_findings(recording, marks, flawed)
    return EstimatorInput(recording, marks, observations, tuple(steps), tuple(steps), findings)


def _parse_mounting(
    text: str, column: str, where: str, file: str | Path | None, line: int | None = None
) -> Attitude:
    found = _NAME.fullmatch(text.strip())
    if found is None:
        raise InputError(
            f"{where}: column {column!r} is {text!r}; a mounting is {', '.join(PLANES)}, without "
            'a tilt, with one tilt in °, "XY 30", or with two tilts, "XY 135 + 45"',
            file=file,
            line=line,
            names=(column,),
        )
    plane, first, second = found.groups()
    far = [tilt for tilt in (first, second) if tilt is not None and abs(float(tilt)) > _MOST_TILT]
    if far:
        raise InputError(
            f"{where}: column {column!r} is {text!r}: the tilt of {far[0]}° is more than a whole "
            "turn; correct the tilt",
            file=file,
            line=line,
            names=(column,),
        )
    return mounting_attitude(
        cast("Plane", plane),
        radians(float(first or 0)),
        None if second is None else radians(float(second)),
    )


def _conditions(bench: RateTable, steps: Sequence[Spin]) -> dict[str, str]:
    in_all, at = len(set(mounting_names(steps))), len(set(speed_names(steps)))
    return {
        "gravity": format_quantity(bench.gravity.value, bench.gravity.sd, "m/s²"),
        "radius": format_quantity(bench.radius.value, bench.radius.sd, "m"),
        "states": f"{len(steps)}, in {in_all} mountings at {at} speeds",
        "angles of each mounting (k = 1)": format_quantity(bench.pose, 0.0, "°"),
        "radius of each mounting (k = 1)": format_quantity(bench.seat, 0.0, "mm"),
        "rate, common to all (k = 1)": format_quantity(bench.rate, 0.0, "%"),
        "speed (k = 1)": format_quantity(bench.speed, 0.0, "%"),
        "lean at rest, two components (k = 1)": format_quantity(bench.lean, 0.0, "°"),
    }
