"""Insert entries into a register; existing entries are not changed.

Each function needs a connection with a transaction that has locked the register.

Verified calibrations that can be entered, with the additional columns of the register.
"""

import json
from contextlib import suppress
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

from sqlalchemy import Connection, Table, insert, select, update

from inercal.basics.documents import attributes, to_utc
from inercal.basics.errors import InputError
from inercal.calibration import Calibration
from inercal.calibration.comparison import recording_sha256
from inercal.calibration.files import calibration_object, canonical_text, parse, read_text
from inercal.laboratory.store.entries import RunFacts
from inercal.laboratory.store.register_tables import (
    bench,
    calibration,
    coefficient,
    file,
    run,
    sensor,
)
from inercal.physics.quantities import QUANTITIES
from inercal.physics.sensors import SI_UNITS, Sensor


@dataclass(frozen=True, eq=False)
class CalibrationDocument:
    """A verified calibration with its text.

    Parameters
    ----------
    source : str
        Name used in error messages.
    text : str
        The whole calibration file as JSON.
    sha256 : str
        SHA-256 hash that the file states.
    calibration : Calibration
    created : str
        Time of creation, ISO 8601, UTC; empty if the file does not state it.
    recording : str
        SHA-256 of the recording; empty if the file does not state it.
    """

    source: str
    text: str
    sha256: str
    calibration: Calibration
    created: str
    recording: str

    @property
    def units(self) -> list[str]:
        """SI units of the coefficients."""
        sensor = self.calibration.sensor
        return [SI_UNITS[sensor.coefficient(name).unit] for name in sensor.coefficients]


def make_document(source: Calibration | str | Path) -> CalibrationDocument:
    """Convert a calibration, or a calibration file, to a document that can be entered.

    Raises
    ------
    InputError
        If the file is missing or damaged, or has content that a register cannot store.
    """
    if isinstance(source, Calibration):
        name = f"calibration of {source.sensor.name}"
        text = json.dumps(calibration_object(source), ensure_ascii=False)
    else:
        name, text = str(source), read_text(source)
    calibration = parse(text, name)
    content: dict[str, Any] = json.loads(text)
    created = calibration.provenance.get("created", "")
    return CalibrationDocument(
        name,
        canonical_text(content),
        content["sha256"],
        calibration,
        created and to_utc(created),
        recording_sha256(calibration),
    )


def utc_now() -> str:
    """Return the current time in the form that the register stores."""
    return datetime.now(UTC).isoformat(timespec="milliseconds")


_DONE_STATE = "done"


@dataclass(frozen=True)
class EntryAuthor:
    """The author and time of an entry, ISO 8601, UTC."""

    by: str
    at: str

    @property
    def columns(self) -> dict[str, str]:
        """Return the values of the author and time columns, which all tables have."""
        return {"entered_by": self.by, "entered_at": self.at}


def enter_sensor(db: Connection, entered: Sensor, who: EntryAuthor) -> int:
    """Enter a sensor, or new axes of a registered sensor, and return its id.

    Raises
    ------
    InputError
        If the register has an axis with the same name that measures a different quantity.
    """
    axes = {axis.name: str(axis.measures) for axis in entered.axes}
    return enter_axes(db, entered.name, axes, who)


def enter_axes(db: Connection, sensor_name: str, axes: dict[str, str], who: EntryAuthor) -> int:
    """Enter a sensor by its name and the quantity of each axis, "f" or "w"; return its id.

    Raises
    ------
    InputError
        See `enter_sensor`.
    """
    found = db.execute(select(sensor).where(sensor.c.name == sensor_name)).one_or_none()
    if found is None:
        values = {"name": sensor_name, "axes": _axes_json(axes)}
        return insert_row(db, sensor, values, who)
    known = {axis["name"]: axis["measures"] for axis in json.loads(found.axes)}
    for name, measures in axes.items():
        if known.get(name, measures) != measures:
            raise InputError(
                f"sensor {sensor_name}: axis {name} measures {QUANTITIES[measures].name}, "
                f"but in the register it measures {QUANTITIES[known[name]].name}; give this "
                "sensor another name",
                names=(name,),
            )
    if axes.keys() - known.keys():
        values = {"axes": _axes_json(known | axes)}
        db.execute(update(sensor).where(sensor.c.id == found.id).values(values))
    return found.id


def _axes_json(axes: dict[str, str]) -> str:
    listed = [{"name": name, "measures": measures} for name, measures in axes.items()]
    return json.dumps(listed, ensure_ascii=False)


def enter_bench(db: Connection, kind: str, name: str, who: EntryAuthor) -> int:
    """Enter a bench by its kind and its name, if it has a name; return its id."""
    found = db.scalar(select(bench.c.id).where(bench.c.kind == kind, bench.c.name == name))
    return found or insert_row(db, bench, {"kind": kind, "name": name}, who)


def enter_run(db: Connection, facts: RunFacts, who: EntryAuthor) -> int:
    """Enter a run, or update the state of a registered run; return its id.

    Registered calibrations of its recording are assigned to the run. The folder of the run is
    updated, because it may have been moved. A finished run stays finished, even if an older copy of
    its folder states another state.
    """
    sensor_id = enter_sensor(db, facts.sensor, who)
    bench_id = enter_bench(db, facts.kind, facts.bench, who)
    found = db.execute(select(run).where(run.c.key == facts.key)).one_or_none()
    if found is None:
        values = {
            **attributes(facts, "key state folder"),
            "sensor_id": sensor_id,
            "bench_id": bench_id,
            "begun": to_utc(facts.begun),
            "table_address": facts.table,
            "imu_address": facts.imu,
        }
        run_id = insert_row(db, run, values, who)
    elif found.state == _DONE_STATE != facts.state:
        return found.id
    else:
        run_id = found.id
        values = {"state": facts.state, "folder": facts.folder}
        db.execute(update(run).where(run.c.id == run_id).values(values))
    _enter_files(db, run_id, facts, who)
    digests = [sha256 for _, sha256 in facts.files.values()]
    theirs = (
        calibration.c.run_id.is_(None),
        calibration.c.sensor_id == sensor_id,
        calibration.c.recording_sha256.in_(digests),
    )
    of_run = {"measured": to_utc(facts.begun), "measured_from": "run"}
    dated = calibration.c.measured_from == "created"
    db.execute(update(calibration).where(*theirs, dated).values(of_run))
    db.execute(update(calibration).where(*theirs).values(run_id=run_id, bench_id=bench_id))
    return run_id


def _enter_files(db: Connection, run_id: int, facts: RunFacts, who: EntryAuthor) -> None:
    there = {
        row.name: (row.size, row.sha256)
        for row in db.execute(select(file).where(file.c.run_id == run_id))
    }
    new: list[dict[str, Any]] = []
    for name, (size, sha256) in facts.files.items():
        values = {"size": size, "sha256": sha256, **who.columns}
        if name not in there:
            new.append({"run_id": run_id, "name": name, **values})
        elif there[name] != (size, sha256):
            one = (file.c.run_id == run_id, file.c.name == name)
            db.execute(update(file).where(*one).values(values))
    if new:
        db.execute(insert(file), new)


def enter_calibration(
    db: Connection, entered: CalibrationDocument, kind: str, measured: str | None, who: EntryAuthor
) -> int:
    """Enter a calibration with its coefficients; return its id.

    Parameters
    ----------
    db : Connection
    entered : CalibrationDocument
    kind : str
        Kind of bench that the method uses; empty if unknown.
    measured : str or None
        Time of measurement, ISO 8601, if the user states it in addition to [job].
    who : EntryAuthor

    Raises
    ------
    InputError
        If the time of measurement is unknown, or the serial number is that of another sensor.
    """
    there = db.scalar(select(calibration.c.id).where(calibration.c.sha256 == entered.sha256))
    if there is not None:
        return there
    require_same_device(db, entered)
    found = entered.calibration
    sensor_id = enter_sensor(db, found.sensor, who)
    its_run = None
    if entered.recording:
        of_recording = (file.c.sha256 == entered.recording, run.c.sensor_id == sensor_id)
        query = select(run).join(file, file.c.run_id == run.c.id).where(*of_recording)
        its_run = db.execute(query.order_by(run.c.id)).first()
    if its_run is not None:
        bench_id, run_id = its_run.bench_id, its_run.id
        time, source = its_run.begun, "run"
    else:
        name = found.conditions.get("bench", "")
        bench_id = enter_bench(db, kind, name, who) if kind or name else None
        run_id, time, source = None, entered.created, "created"
    stated = measured or found.job.get("measured")
    if stated and (measured or not time.startswith(stated)):  # otherwise, `time` adds the hour
        time, source = to_utc(stated), "stated"
    if not time:
        raise InputError(
            f"{entered.source}: the file does not state when it was measured; add --measured DATE",
            key="--measured",
        )
    values = {
        "sensor_id": sensor_id,
        "bench_id": bench_id,
        "run_id": run_id,
        "measured": time,
        "measured_from": source,
        "method": found.method,
        "estimator": found.estimator,
        "grade": found.verdict.grade if found.verdict else "",
        "recording_sha256": entered.recording,
        "content": entered.text,
        "sha256": entered.sha256,
    }
    new = insert_row(db, calibration, values, who)
    names = found.sensor.coefficients
    columns = (names, found.values.tolist(), found.std.tolist(), entered.units)
    rows = [
        {"calibration_id": new, "place": k, "name": name, "value": value, "std": std, "unit": unit}
        for k, (name, value, std, unit) in enumerate(zip(*columns, strict=True))
    ]
    if rows:
        db.execute(insert(coefficient), rows)
    return new


def require_same_device(db: Connection, entered: CalibrationDocument) -> None:
    """Raise an error if the last calibration of a sensor of this name has another serial number.

    Calibrations of the same recording are ignored, so that a wrong serial number can be corrected.

    Raises
    ------
    InputError
    """
    name, serial = entered.calibration.sensor.name, entered.calibration.job.get("serial number")
    others = (sensor.c.name == name, calibration.c.recording_sha256 != entered.recording)
    query = select(calibration.c.id, calibration.c.content).join(sensor).where(*others)
    newest = db.execute(query.order_by(calibration.c.id.desc()).limit(1)).first()
    if newest is None or serial is None:
        return
    known = serial
    with suppress(ValueError, AttributeError):  # a damaged entry is reported when it is read
        known = json.loads(newest.content).get("job", {}).get("serial number", serial)
    if serial != known:
        raise InputError(
            f"{entered.source}: the serial number is {serial}, but calibration "
            f"#{newest.id} of {name} is of serial number {known}; give one of "
            "them another [sensor] name, or correct [job] serial_number",
            key="[sensor] name",
            names=(serial, known),
        )


def require_possible_date(entered: CalibrationDocument, measured: str | None) -> None:
    """Raise an error if the time stated by the user or [job] is not possible.

    It must not be in the future, and the user must not contradict [job] of the file.

    Raises
    ------
    InputError
    """
    job = entered.calibration.job
    first = job.get("measured", "")
    last = job.get("measured until", first)
    stated = measured or last
    day, wrong = stated[: len("2026-03-01")], ""
    if stated and datetime.fromisoformat(to_utc(stated)) > datetime.now(UTC) + timedelta(days=1):
        wrong = "is in the future"
    elif first and not first <= day <= last:
        wrong = (
            f"contradicts [job] of {entered.source}, measured {' to '.join({first: 0, last: 0})}"
        )
    if wrong:
        place = "--measured" if measured else f"{entered.source}: [job] measured"
        raise InputError(f"{place} {stated} {wrong}", key="--measured")


def state_date(db: Connection, number: int, measured: str) -> None:
    """Set the date stated by the user if the current date comes only from the file.

    Raises
    ------
    InputError
        If the calibration already has another date that was stated earlier or comes from its run.
    """
    query = select(calibration.c.measured, calibration.c.measured_from)
    there = db.execute(query.where(calibration.c.id == number)).one()
    time = to_utc(measured)
    if there.measured == time:
        return
    if there.measured_from != "created":
        source = "stated by the user" if there.measured_from == "stated" else "from its run"
        raise InputError(
            f"--measured: calibration #{number} already has the date {there.measured[:10]} "
            f"({source}), which is not overwritten; calibrate again and import the new file "
            "with --measured: a history then uses it in place of this one, because both come "
            "from the same recording",
            key="--measured",
        )
    new = {"measured": time, "measured_from": "stated"}
    db.execute(update(calibration).where(calibration.c.id == number).values(**new))


def insert_row(db: Connection, table: Table, values: dict[str, Any], who: EntryAuthor) -> int:
    """Insert a row with its author and time, and return its number."""
    result = db.execute(insert(table).values(**values, **who.columns)).inserted_primary_key
    assert result is not None
    return int(result[0])
