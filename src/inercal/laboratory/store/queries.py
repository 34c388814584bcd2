"""Read entries from a register."""

import json
from collections.abc import Sequence
from datetime import datetime
from typing import Any

from sqlalchemy import ColumnElement, Connection, Row, Select, Table, func, select

from inercal.basics.errors import InputError
from inercal.laboratory.store.entries import CalibrationEntry, FileEntry, RunEntry, SensorEntry
from inercal.laboratory.store.register_tables import (
    bench,
    calibration,
    coefficient,
    file,
    run,
    sensor,
)
from inercal.recordings.io.column_table import shorten

_MAX_LISTED = 8  # number of sensors that an error message lists


def sensors(db: Connection, *where: ColumnElement[bool]) -> tuple[SensorEntry, ...]:
    """Return the sensors, sorted by name."""
    count, last = func.count(calibration.c.id), func.max(calibration.c.measured)
    query = (
        select(sensor, count.label("calibrations"), last.label("last"))
        .outerjoin(calibration, calibration.c.sensor_id == sensor.c.id)
        .where(*where)
        .group_by(sensor.c.id)
    )
    found = (
        SensorEntry(
            row.id,
            row.name,
            _axis_names(row.axes, row.name),
            row.calibrations,
            row.last and row.last.partition("T")[0],
            row.entered_by,
            row.entered_at,
        )
        for row in _rows(db, query)
    )
    # The names are sorted here, because servers have different sort orders for text.
    return tuple(sorted(found, key=lambda one: one.name))


def _rows(db: Connection, query: Select[Any]) -> list[Row[Any]]:
    """Return the rows of a query with checked types, because SQLite allows any type in a column.

    Raises
    ------
    InputError
        If the type of a value differs from the type of its column.
    """
    columns = list(query.selected_columns)
    kinds = [(one.name, one.type.python_type) for one in columns]
    rows = list(db.execute(query).all())
    for row in rows:
        for (name, kind), value in zip(kinds, row, strict=True):
            right = isinstance(value, int | float) if kind is float else isinstance(value, kind)
            if not (right or value is None):
                raise _damaged_error(f"{name} of a row is {shorten(repr(value))}")
    return rows


def _axis_names(text: str, sensor_name: str) -> tuple[str, ...]:
    try:
        return tuple(str(axis["name"]) for axis in json.loads(text))
    except (ValueError, TypeError, LookupError, RecursionError):
        raise _damaged_error(f"the axes of sensor {sensor_name!r} are {shorten(text)!r}") from None


def _damaged_error(what: str) -> InputError:
    return InputError(f"the register is damaged: {what}; restore it from a copy", key="--register")


def find_sensor(db: Connection, key: int | str) -> SensorEntry:
    """Return the sensor with this id or name.

    Raises
    ------
    InputError
        If there is no such sensor; the message lists some sensors that exist.
    """
    column = sensor.c.id if isinstance(key, int) else sensor.c.name
    found = sensors(db, column == key)
    if found:
        return found[0]
    known = [repr(each.name) for each in sensors(db)]
    listed = ", ".join(known[:_MAX_LISTED]) + ", …" * (len(known) > _MAX_LISTED)
    raise InputError(
        f"there is no sensor {key!r} in the register; "
        f"{f'it has {listed}' if known else 'it is empty'}",
        names=(str(key),),
    )


def _of_sensor(db: Connection, table: Table, key: int | str | None) -> list[ColumnElement[bool]]:
    """Return the condition that rows belong to the sensor with this id or name, if there is one."""
    return [] if key is None else [table.c.sensor_id == find_sensor(db, key).id]


def runs(
    db: Connection, *, sensor_key: int | str | None = None, newest: int | None = None
) -> tuple[RunEntry, ...]:
    """Return the runs of all sensors or of one by start time; `newest` limits their number."""
    where = _of_sensor(db, run, sensor_key)
    query = (
        select(run, sensor.c.name.label("sensor"), bench.c.kind, bench.c.name.label("bench"))
        .join(sensor, sensor.c.id == run.c.sensor_id)
        .join(bench, bench.c.id == run.c.bench_id)
        .where(*where)
        .order_by(run.c.begun.desc(), run.c.id.desc())
        .limit(newest)
    )
    found = _rows(db, query)[::-1]
    files: dict[int, list[FileEntry]] = {row.id: [] for row in found}
    theirs = select(file).join(run, run.c.id == file.c.run_id).where(*where)
    if newest is not None:
        theirs = theirs.where(file.c.run_id.in_(files))
    for row in _rows(db, theirs):
        if row.run_id in files:  # a run may have been entered in the meantime
            files[row.run_id].append(FileEntry(row.name, row.size, row.sha256))
    return tuple(
        RunEntry(
            row.id, row.key, row.sensor, row.kind, row.bench, row.begun, row.state,
            row.table_address, row.imu_address, row.folder,
            tuple(sorted(files[row.id], key=lambda one: one.name)),
            row.entered_by, row.entered_at,
        )
        for row in found
    )  # fmt: skip


def calibrations(
    db: Connection,
    *where: ColumnElement[bool],
    sensor_key: int | str | None = None,
    newest: int | None = None,
) -> tuple[CalibrationEntry, ...]:
    """Return all calibrations, those of a sensor or the newest, in the order of measurement."""
    query = (
        select(
            calibration,
            sensor.c.name.label("sensor"),
            bench.c.kind.label("kind"),
            bench.c.name.label("bench"),
        )
        .join(sensor, sensor.c.id == calibration.c.sensor_id)
        .outerjoin(bench, bench.c.id == calibration.c.bench_id)
        .where(*where, *_of_sensor(db, calibration, sensor_key))
    )
    if newest is not None:
        query = query.order_by(calibration.c.measured.desc(), calibration.c.id.desc()).limit(newest)
    # The rows are sorted here, because the database would sort whole calibration files.
    found = sorted(_rows(db, query), key=lambda row: (row.measured, row.id))
    return tuple(map(_calibration_entry, found))


def calibration_numbers(db: Connection, *where: ColumnElement[bool]) -> tuple[int, ...]:
    """Return the ids of calibrations in the order of measurement."""
    query = select(calibration.c.id).where(*where)
    return tuple(db.scalars(query.order_by(calibration.c.measured, calibration.c.id)))


def _calibration_entry(row: Row[Any]) -> CalibrationEntry:
    try:
        datetime.fromisoformat(row.measured)
    except ValueError:
        what = f"the time of calibration #{row.id} is {shorten(row.measured)!r}"
        raise _damaged_error(what) from None
    return CalibrationEntry(
        row.id, row.sensor, row.kind or "", row.bench or "", row.run_id, row.measured,
        row.measured_from, row.method, row.estimator, row.grade, row.sha256, row.entered_by,
        row.entered_at, row.content,
    )  # fmt: skip


def find_calibration(db: Connection, number: int) -> CalibrationEntry:
    """Return the calibration with this id.

    Raises
    ------
    InputError
        If there is no such calibration.
    """
    found = calibrations(db, calibration.c.id == number)
    if found:
        return found[0]
    last = db.scalar(select(func.max(calibration.c.id)))
    raise InputError(
        f"there is no calibration #{number} in the register; "
        f"{f'the last one is #{last}' if last else 'it has no calibrations'}",
        names=(f"#{number}",),
    )


def coefficients(db: Connection, number: int) -> Sequence[tuple[str, float, float, str]]:
    """Return name, value, standard uncertainty and SI unit of a calibration's coefficients."""
    query = (
        select(coefficient)
        .where(coefficient.c.calibration_id == number)
        .order_by(coefficient.c.place)
    )
    return [(row.name, row.value, row.std, row.unit) for row in _rows(db, query)]
