"""Read the observations from a run on a rate table: a table of states, or a recording.

The unit of the rates and the axes of the sensor are checked against the readings.
"""

import re
from collections.abc import Callable, Sequence
from dataclasses import replace
from math import pi, radians
from pathlib import Path
from typing import cast

import numpy as np

from inercal.basics.arrays import Array
from inercal.basics.errors import InputError
from inercal.basics.units import format_quantity
from inercal.benches.arm import fitting_arm_unit
from inercal.benches.contradicting_rows import least_absolute_fit, require_possible_rows
from inercal.benches.rate_table.bench import RateTable, mounting_names, sensed_motion, speed_names
from inercal.benches.rate_table.fixture import PLANES, Plane, mounting_attitude
from inercal.benches.rate_table.kind import RateTableData
from inercal.benches.stated_axes import signed_permutations
from inercal.physics.plan import Attitude, Spin
from inercal.physics.section_settings import key_error
from inercal.physics.sensors import G0
from inercal.physics.sensors.affine import AffineModel
from inercal.recordings import Finding, Observations, Recording, join_observations
from inercal.recordings.data import EstimatorInput, RunBase, recording_loader
from inercal.recordings.io.column_table import Table
from inercal.recordings.io.mean_tables import number_column, observations_from_table, read_columns
from inercal.recordings.segments import average_dwells, average_sections, find_dwells
from inercal.recordings.segments.dwells import ARM_RATE
from inercal.recordings.segments.stationary_states import (
    find_stationary_states,
    omitted_state_findings,
)

_OFF = 0.2  # largest relative error of a norm, after correction by a rough model of the triad
_USABLE = (0.5, 2.0)  # times nominal: range of scale factors if the run file is correct
_DETERMINED = 0.05  # times the largest singular value: below this, a triad is not determined
_FEWEST = 4  # states needed to identify the axes
_FAST = 0.9  # times the fastest rate: samples above this show the unit


def require_unit(run: RunBase[RateTableData], recording: Recording, bench: RateTable) -> None:
    """Refuse a recording whose samples at the fastest rate do not fit the stated unit.

    Parameters
    ----------
    run : Run
    recording : Recording
        Recording with the readback "arm_rate", converted to rad/s with the stated unit.
    bench : RateTable

    Raises
    ------
    InputError
        Another unit fits; the message names it.
    """
    rate = np.abs(recording.readback[ARM_RATE])
    fast = rate > _FAST * rate.max()
    if not fast.any():
        return
    columns = [recording.channels.index(name) for name in run.sensor.channels]
    read = np.linalg.norm(run.sensor.to_si(recording.data[fast][:, columns]), axis=-1)

    def off(times: float) -> float:
        result = np.hypot(bench.radius.value * (rate[fast] * times) ** 2, bench.gravity.value)
        return float(abs(np.median(read / result) - 1))

    if off(1.0) > _OFF:
        _refuse_unit(run, bench, off)


def _refuse_unit(
    run: RunBase[RateTableData], bench: RateTable, off: Callable[[float], float]
) -> None:
    """Refuse a rate or radius that fits another unit; `off` is as in `fitting_arm_unit`."""
    unit, left = fitting_arm_unit(run, bench.radius.value, off)
    if left < _OFF / 2:
        raise unit.error(run)


def _nominal_force(bench: RateTable, steps: Sequence[Spin], times: float = 1.0) -> Array:
    """Return the nominal specific force at the rates multiplied by a factor, (r, 3) m/s²."""
    return sensed_motion(bench, [replace(step, rate=step.rate * times) for step in steps], {}).f


def _fit_triad(read: Array, nominal: Array) -> AffineModel | None:
    """Fit a rough model of the triad, M a + p = f in m/s², by least absolute deviations.

    A sensor as delivered may have a bias of 0.3 g and a scale factor 20 % off. The checks use the
    residuals of this model, so that they detect only mistakes. One wrong row has little effect on a
    fit by least absolute deviations.

    Parameters
    ----------
    read, nominal : (r, 3) arrays
        Readings and nominal specific force, m/s².

    Returns
    -------
    AffineModel or None
        The model; None if the rows do not determine it, or no usable sensor can have it.
    """
    columns = np.concatenate([nominal, np.full((len(nominal), 1), G0)], axis=-1)
    size = np.linalg.svd(columns, compute_uv=False)
    if len(columns) < columns.shape[1] or size[-1] < _DETERMINED * size[0]:
        return None
    solved = least_absolute_fit(columns / G0, read / G0)
    scale = np.linalg.svd(solved[:3], compute_uv=False)
    if scale[-1] < _USABLE[0] or scale[0] > _USABLE[1]:
        return None
    return AffineModel(np.asarray(solved[:3].T, dtype=float), solved[3] * G0).inverse


def require_rates(
    run: RunBase[RateTableData], observations: Observations, bench: RateTable, steps: Sequence[Spin]
) -> None:
    """Refuse rates if the norms of the readings show that their unit is wrong.

    The readings are first corrected with a rough model of the triad.
    """
    turning = np.array([step.rate != 0 for step in steps])
    if not turning.any():
        return

    def norms(times: float) -> tuple[Array, Array]:
        result = _nominal_force(bench, steps, times)
        model = _fit_triad(observations.mean, result)
        read = observations.mean if model is None else model.correct(observations.mean)
        return np.linalg.norm(read, axis=-1), np.linalg.norm(result, axis=-1)

    def off(times: float) -> float:
        read, result = norms(times)
        return float(np.max(np.abs(read / result - 1)[turning]))

    if off(1.0) <= _OFF:
        return
    _refuse_unit(run, bench, off)
    require_possible_rows(run.path, observations, run.sensor, bench, steps)
    read, result = norms(1.0)
    worst = int(np.argmax(np.abs(read / result - 1) * turning))
    raise InputError(
        f"{run.path}: {steps[worst].label}: the readings' norm is {read[worst]:.4g} m/s², but "
        f"radius and rate give {result[worst]:.4g} m/s²; check its rate, arm_rate_unit, [bench] "
        "radius and the scale in [sensor.accelerometer]",
        file=run.path,
        names=(steps[worst].label,),
    )


def require_axes(
    run: RunBase[RateTableData], observations: Observations, bench: RateTable, steps: Sequence[Spin]
) -> None:
    """Refuse columns that fit far better in another order or with another sign."""
    if len(steps) < _FEWEST:
        return
    result, read = _nominal_force(bench, steps), observations.mean
    model = _fit_triad(read, result)
    if model is not None:
        # A bias does not show a wrong axis, so compare only the directions of the axes.
        read = read - model.inverse.offset
    fits = {way: float(np.sum((way.reorder(read) - result) ** 2)) for way in signed_permutations(3)}
    straight, best = next(iter(fits.values())), min(fits, key=lambda way: fits[way])
    if fits[best] < straight / 10 and not best.is_identity:
        given = tuple(map(str, run.data.accelerometer))
        order = [f"{'−' * (s < 0)}{given[k]}" for k, s in zip(*best, strict=True)]
        raise key_error(
            "[data] accelerometer",
            f"the readings fit the mountings as x, y, z = {', '.join(order)}, not as "
            f"{', '.join(given)}; check the order of the columns and the mounting of the sensor",
            run.path,
            tuple(order),
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
    result = (
        _table(run)
        if run.data.kind == "means"
        else reduce_recording(run, recording_loader.load_recording(run))
    )
    steps = [step for step in result.steps if isinstance(step, Spin)]
    require_rates(run, result.observations, bench, steps)
    require_axes(run, result.observations, bench, steps)
    return replace(result, conditions=_conditions(bench, steps))


def _table(run: RunBase[RateTableData]) -> EstimatorInput:
    rate, unit = (
        recording_loader.readback_columns(run)["arm_rate"],
        recording_loader.readback_units(run)["arm_rate"],
    )
    wanted, path = recording_loader.reader_columns(run), run.file(run.data.file)
    where = str(run.data.mounting)
    table = read_columns(path, wanted, [where, rate])
    rates = number_column(path, table, rate, "give the rate, 0 at rest,") * unit
    mountings = map(recording_loader.position_name, table.columns[where].tolist())
    poses = [
        _parse_mounting(text, where, f"{path} {table.place(k)}", path, table.line(k))
        for k, text in enumerate(mountings)
    ]
    # A unit with a size, such as "0.5 rev/s", would not be understood beside a rate.
    sized = re.match(r"[-+.\d]", run.data.arm_rate_unit) is not None
    shown, size = ("rpm", pi / 30) if sized else (run.data.arm_rate_unit, abs(unit))
    names = [
        f"{pose.name} at {turning:.6g} {shown}"
        for pose, turning in zip(poses, (rates / size).tolist(), strict=True)
    ]
    labels = tuple(recording_loader.number_repeated_names(names))
    observations = observations_from_table(
        path, table, labels, wanted, run.sensor, recording_loader.stated_deviations(run)
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
    size = recording_loader.readback_units(run)["arm_rate"]
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
