"""Read the observations from a dividing-head run: a table or a recording of positions."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from math import pi
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from inercal.basics.arrays import Array
from inercal.basics.errors import InputError, error_location
from inercal.basics.units import format_count, format_quantity, si_factor
from inercal.benches.characteristics import BAND_NOTE, characteristic_notes, rows_of_bands
from inercal.benches.dividing_head import passes
from inercal.benches.dividing_head.bench import DividingHead
from inercal.benches.dividing_head.characteristics import head_characteristics
from inercal.benches.dividing_head.checks import (
    repeat_visit_warnings,
    require_usable_readings,
)
from inercal.benches.dividing_head.phases import require_phases
from inercal.benches.dividing_head.settings import DividingHeadData
from inercal.physics.plan import Index
from inercal.physics.section_settings import key_error, positive_value
from inercal.recordings import Finding, Mark, Recording
from inercal.recordings.data import EstimatorInput, RunBase, recording_loader
from inercal.recordings.data.rest_marks import check_rests, stated_marks
from inercal.recordings.io.column_table import Table
from inercal.recordings.io.mean_tables import number_column, observations_from_table, read_columns
from inercal.recordings.segments import average_sections, check_marks, find_rests


def observe(run: RunBase[DividingHeadData]) -> EstimatorInput:
    """Return the observations from a run on a dividing head.

    Raises
    ------
    InputError
        The data cannot be used.
    """
    bench: DividingHead = run.bench
    if run.data.seconds is not None:
        text = "a dividing head is at rest during a reading; remove the key"
        raise key_error("[data] seconds", text, run.path)
    recording_loader.require_distinct_columns(run)
    result = _table(run, bench) if run.data.kind == "means" else _recording(run)
    steps = [step for step in result.steps if isinstance(step, Index)]
    with error_location(run.path):
        require_usable_readings(run, bench, steps)
    stated = run.data.warm_up_band
    band = None if stated is None else positive_value(stated, "g", "[data] warm_up_band")
    found = head_characteristics(result.observations, run.sensor, bench, steps, band)
    warm = len(passes.warm_up_rows(steps))
    result = replace(result.rows(range(warm, len(steps))), characteristics=found)
    steps = steps[warm:]
    findings = result.findings + _missing_trim_positions(run, bench, steps)
    with error_location(run.path):
        require_phases(run, result.observations, steps)
    shown = passes.small_tilt_series([step.angle for step in steps]) or warm
    shown = shown or any(one.figure.detected for one in found)
    notes = characteristic_notes(found) if shown else ()
    findings += repeat_visit_warnings(result.observations, run.sensor, bench, steps)
    if bench.collimated != "none" and run.data.autocollimator is None:
        text = f"The head is assumed to have been adjusted {_TRIMMED[bench.collimated]}, because "
        text += "[data] names no autocollimator. If it was not adjusted, state autocollimation = "
        notes = (*notes, f'{text}"none".')
    if rows_of_bands(found):
        result, notes = result.rows(passes.rows_without_series(steps)), (*notes, BAND_NOTE)
    return replace(
        result, findings=findings, conditions=_conditions(run, bench, steps), notes=notes
    )


_TRIMMED = {
    "pairs": "in each pass until the autocollimator read the same at 180° as at 0° and at 270° as "
    "at 90°",
    "every": "until the autocollimator read zero at every position",
}
_FEW = 4  # so few positions may lie within 6.28°
_TURNS = 60.0  # rad; no run turns as far as this


def _table(run: RunBase[DividingHeadData], bench: DividingHead) -> EstimatorInput:
    named, units = recording_loader.readback_columns(run), recording_loader.readback_units(run)
    wanted = recording_loader.reader_columns(run)
    path = run.file(run.data.file)
    times = [] if run.data.time is None else [str(run.data.time)]
    table = read_columns(path, wanted, [*named.values(), *times])
    _require_filled(run, table)
    readback = {name: table.numbers(column) * units[name] for name, column in named.items()}
    for name, values in readback.items():
        bad = ~np.isfinite(values)
        if name == "autocollimator":
            # A reading that is not used may be missing.
            bad &= _collimated_positions(bench, readback["angle"])
            bad[: len(passes.warm_up_rows([Index("", a) for a in readback["angle"].tolist()]))] = (
                False
            )
        if bad.any():
            text = f"has no number; {_WANTED[name]}"
            raise table.cell_error(path, int(np.argmax(bad)), named[name], text)
    _require_unit(run, readback["angle"] / units["angle"])
    names = None
    if wanted.label is not None:
        names = [
            recording_loader.position_name(value) for value in table.columns[wanted.label].tolist()
        ]
    steps = _steps(names, {name: np.nan_to_num(values) for name, values in readback.items()})
    labels = tuple(step.label for step in steps)
    observations = observations_from_table(
        path, table, labels, wanted, run.sensor, recording_loader.stated_deviations(run)
    )
    for name in times:
        time = number_column(path, table, name, "write the time") * si_factor(
            run.data.time_unit, "s"
        )
        observations = replace(observations, time=time, timed=True)
    return EstimatorInput(None, (), observations, steps, steps, ())


_WANTED = {
    "angle": "give the head's angle or remove the row",
    "level": "give the level's reading or remove the row",
    "autocollimator": "give its reading, because [bench] autocollimation needs it here",
}


def _require_filled(run: RunBase[DividingHeadData], table: Table) -> None:
    names = [str(column) for column in run.data.accelerometer]
    read = [table.columns[name] for name in names]
    if all(column.dtype.kind == "f" and not np.isfinite(column).any() for column in read):
        path = run.file(run.data.file)
        text = f"{path}: columns {', '.join(names)} are empty; fill in the sheet"
        raise InputError(text, file=path, names=tuple(names))


def _require_unit(run: RunBase[DividingHeadData], angle: Array) -> None:
    """Refuse angles that are not in the stated unit, judged by a turn of 6.28 rad or 360°."""
    reach, given = float(np.abs(angle).max(initial=0.0)), run.data.angle_unit
    little = given in ("°", "deg") and angle.size > _FEW and reach < 2 * pi
    if little or (given == "rad" and reach > _TURNS):
        other = "rad" if little else "°"
        raise key_error(
            "[data] angle_unit",
            f"the angles go up to {reach:.4g} {given}; if they are in {other}, state angle_unit = "
            f'"{other}"',
            run.path,
        )


def _recording(run: RunBase[DividingHeadData]) -> EstimatorInput:
    recording, units = recording_loader.load_recording(run), recording_loader.readback_units(run)
    readback = {name: values * units[name] for name, values in recording.readback.items()}
    found = run.data.marks == "found"
    rests = find_rests(recording, run.sensor) if found else None
    marks = stated_marks(run, recording) if rests is None else rests.marks
    check_marks(marks, recording, [mark.label for mark in marks])
    starts = [mark.start for mark in marks]
    _require_unit(run, recording.readback["angle"][starts])
    means = {
        name: np.array([values[mark.start : mark.stop].mean() for mark in marks])
        for name, values in readback.items()
    }
    angles = [_mean_angle(recording, mark, readback["angle"]) for mark in marks]
    moving = check_rests(run, recording, marks)
    names = None if found else [mark.label for mark in marks]
    steps = _steps(names, means | {"angle": np.array(angles)})
    marks = tuple(replace(m, label=step.label) for m, step in zip(marks, steps, strict=True))
    observations = average_sections(recording, run.sensor, marks, steps, found=True)
    findings = recording.findings + moving
    rests = None if rests is None else replace(rests, marks=marks)
    return EstimatorInput(recording, marks, observations, steps, steps, findings, rests=rests)


def _mean_angle(recording: Recording, mark: Mark, angle: Array) -> float:
    """Return the mean angle of a section, rad, even if the encoder alternates 0° and 359.999°.

    Raises
    ------
    InputError
        The head moves during the section.
    """
    own = angle[mark.start : mark.stop]
    away = (own - own[0] + pi) % (2 * pi) - pi
    part = max(away.size // 4, 1)
    if (
        abs(np.median(away[:part]) - np.median(away[-part:])) > passes.ANGLE_TOLERANCE
        or np.ptp(away) > 20 * passes.ANGLE_TOLERANCE
    ):
        raise InputError(
            f"{recording.source}: section {mark.label} ({recording.where(mark.start)}): the "
            "head's angle changes; mark only the time at one position",
            names=(mark.label,),
        )
    return float(own[0] + away.mean())


def _steps(names: Sequence[str] | None, readback: Mapping[str, Array]) -> tuple[Index, ...]:
    """Return one step per row from the readback; without names, steps are named by angle."""
    angle = readback["angle"]
    sense = _approach_senses(angle)
    if names is None:
        small = {k for rows in passes.small_tilt_series(angle.tolist()) for k in rows}
        degrees = (angle * 180 / pi).tolist()
        names = recording_loader.number_repeated_names(
            [
                f"{round(a, 6 if k in small else 3):.9g}° {'forward' if s > 0 else 'reverse'}"
                for k, (a, s) in enumerate(zip(degrees, sense, strict=True))
            ]
        )
    zero = np.zeros(angle.size)
    level, reading = (readback.get(name, zero).tolist() for name in ("level", "autocollimator"))
    return tuple(map(Index, names, angle.tolist(), sense, level, reading))


def _approach_senses(angle: Array) -> list[Literal[1, -1]]:
    """Return the sense of approach to each position; the first has the sense of the second."""
    moves = pi - (pi - np.diff(angle)) % (2 * pi)
    still = np.full(moves.size, passes.ANGLE_TOLERANCE)
    for rows in passes.small_tilt_series(angle.tolist()):
        still[rows.start : rows.stop - 1] = passes.SAME_ANGLE
    found: list[Literal[1, -1]] = []
    sense: Literal[1, -1] = 1
    for move, limit in zip(moves[::-1].tolist(), still[::-1].tolist(), strict=True):
        # If a position is repeated where the sense changes, the repeat begins the way back.
        sense = sense if abs(move) < limit else (1 if move > 0 else -1)
        found.append(sense)
    found.append(sense)
    return found[::-1]


def _collimated_positions(bench: DividingHead, angle: Array) -> NDArray[np.bool_]:
    """Return whether the autocollimator is used at each angle."""
    if bench.collimated == "every":
        return np.ones(angle.size, dtype=np.bool_)
    cardinal = [passes.matches_any_angle(a, passes.CARDINAL_ANGLES) for a in angle.tolist()]
    return np.array(cardinal) & (bench.collimated == "pairs")


def _missing_trim_positions(
    run: RunBase[DividingHeadData], bench: DividingHead, steps: Sequence[Index]
) -> tuple[Finding, ...]:
    """Return a warning for each pass in which a position for trimming the head is missing.

    Raises
    ------
    InputError
        The position is missing in every pass.
    """
    if bench.collimated != "pairs":
        return ()
    found: list[Finding] = []
    for name, missing in passes.missing_cardinal_angles(steps).items():
        text = "autocollimation trims 180° to 0° and 270° to 90° in each pass, but "
        text += f"{name} has no " + ", ".join(f"{angle * 180 / pi:.0f}°" for angle in missing)
        angles = [step.angle for step in steps]
        if not all(passes.matches_any_angle(angle, angles) for angle in missing):
            raise InputError(
                f"{run.path}: [bench] {text}: add it to {run.data.file}, or state another "
                "autocollimation",
                file=run.path,
                key="[bench] autocollimation",
                names=(name,),
            )
        found.append(Finding("warning", "pairs", text))
    return tuple(found)


def _conditions(
    run: RunBase[DividingHeadData], bench: DividingHead, steps: Sequence[Index]
) -> dict[str, str]:
    count = len(passes.pass_names(steps))
    g = bench.gravity
    found = {
        "gravity": format_quantity(g.value, g.sd, "m/s²")
        + (" (treated as exact)" if g.sd == 0 else ""),
        "positions": f"{len(set(passes.first_visit_rows(steps)))}, {len(steps)} rows in "
        + format_count(count, "pass", "passes")
        + (": drift does not cancel" if count == 1 else ""),
        "head's error, rms (k = 1)": f"{bench.rms * 648_000 / pi:.3g} ″",
        "autocollimation": bench.collimated,
    }
    if bench.collimated != "none":
        found["autocollimator (k = 1)"] = format_quantity(bench.autocollimator, 0.0, "″")
        faces = len(bench.polygon)
        found["polygon"] = f"{faces} certified faces" if faces else "assumed to be equally spaced"
    if run.data.level is not None:
        found["tilt of the base"] = "measured by the level"
    return found
