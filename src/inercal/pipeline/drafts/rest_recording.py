"""Read a recording of a sensor at rest without a run file, as `init` does.

Columns, units and rate are found as in `init`. The unit of a gyro cannot be found from readings at
rest. It is therefore taken from the column names or the format, or the user states it.

If signed counts were written as unsigned numbers, the columns get their signs back.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, get_args

import numpy as np

from inercal.basics.arrays import Array
from inercal.basics.errors import InputError
from inercal.benches.stated_axes import axis_letters
from inercal.physics.section_settings import key_error, si_value
from inercal.physics.sensors.axis import Readout
from inercal.pipeline.drafts.clock_keys import RATE_QUESTION, clock_keys
from inercal.pipeline.drafts.column_names import is_other_quantity
from inercal.pipeline.drafts.column_roles import ColumnRoles, recognise_columns
from inercal.pipeline.drafts.column_values import without_unusable
from inercal.pipeline.drafts.draft_entries import DraftKey
from inercal.pipeline.drafts.magnetometer_keys import named_magnetometer, named_unit
from inercal.pipeline.drafts.readouts import guess_accelerometer
from inercal.pipeline.drafts.stated_keys import (
    stated_columns,
    stated_options,
    stated_thermometer,
    stated_triad,
    stated_values,
)
from inercal.recordings import Finding, Recording
from inercal.recordings.io.audit import NonfinitePolicy
from inercal.recordings.io.column_table import Column, Table
from inercal.recordings.io.isolation import MOST_VALUES_KEY
from inercal.recordings.io.read import detect_reader, read_recording, read_table
from inercal.recordings.io.readers import known_options
from inercal.recordings.io.table_recording import Columns
from inercal.recordings.io.table_start import may_be_number
from inercal.recordings.io.wrapped_numbers import are_counts, signed_counts, unsigned_bits
from inercal.recordings.samples import TIME_UNIT
from inercal.recordings.segments.magnetic_means import new_value_rows
from inercal.recordings.temperature import first_impossible
from inercal.runfile.schema import ReadoutSection
from inercal.runfile.sensor_builder import READING_UNITS, SCALE_EXAMPLES, build_readout

_GROWS = 0.9  # share of the steps of a time or a counter that are positive
_MOST_TEXTS = 4  # columns of text
_FEWEST_WORDS = 0.01  # share of the cells of a column that is no damaged column of numbers


def read_log_table(log: Path, options: Mapping[str, object] | None = None) -> Table:
    """Read all columns of a log; columns that begin with numbers but contain words are text.

    Raises
    ------
    InputError
        If the file cannot be read, or if very few cells of a column are not numbers.
    """
    texts: dict[str, InputError] = {}
    while True:
        try:
            table = read_table(log, text=tuple(texts), options=options)
        except InputError as error:
            column = error.names[0] if error.names else ""
            if not column or column in texts or error.line is None or len(texts) == _MOST_TEXTS:
                raise
            texts[column] = error
            continue
        for column, error in texts.items():
            cells = [cell for cell in table.columns[column].tolist() if cell]
            if sum(not may_be_number(cell) for cell in cells) < _FEWEST_WORDS * len(cells):
                raise error
        return table


def sign_columns(table: Table, stated: object = None) -> tuple[Table, tuple[DraftKey, ...]]:
    """Return the table with signed readings, and the key of [data] that reads them so.

    Columns that grow, such as times and counters, stay as they are.

    Parameters
    ----------
    table : Table
    stated : object
        The bits that the user states; None to find them from the values.

    Raises
    ------
    InputError
        The stated value is not a number of bits.
    """
    numbers = {
        name: column.astype(np.float64)
        for name, column in table.columns.items()
        if column.dtype.kind != "U"
    }
    numbers = {n: x for n, x in numbers.items() if np.sum(np.diff(x) > 0) < _GROWS * x.size}
    if stated is not None and (not isinstance(stated, int) or not 8 <= stated <= 32):
        raise InputError(f"data.signed_bits: {stated!r} is not 8 to 32", key="data.signed_bits")
    found = {name: unsigned_bits(values) for name, values in numbers.items()}
    bits = stated if stated is not None else next(filter(None, found.values()), None)
    if bits is None:
        return table, ()
    signed: dict[str, Column] = {
        name: signed_counts(values, bits)
        for name, values in numbers.items()
        if are_counts(values, bits)
    }
    seen = [name for name, one in found.items() if one == bits]
    reason = f"{', '.join(seen)} read only near 0 and near {2**bits - 1}" if seen else "as stated"
    signed_table = replace(table, columns={**table.columns, **signed}, block=None)
    return signed_table, (DraftKey("data", "signed_bits", bits, reason),)


_COUNTS = "LSB"
_FRESH = 0.9  # share of samples with new values
_TOO_LONG = MOST_VALUES_KEY  # key of the error for a file that is too large
_KEYS = (
    *(f"data.{name}" for name in ("accelerometer", "gyro", "magnetometer", "time",
                                  "time_unit", "rate",
                                  "counter_modulus", "signed_bits",
                                  "temperature", "temperature_unit", "temperature_scale",
                                  "temperature_zero", "allow_temperature", "nonfinite")),
    *(f"sensor.{kind}.{name}" for kind in READING_UNITS for name in ("unit", "scale", "offset")),
)  # fmt: skip


def read_rest_recording(log: Path, stated: Mapping[str, str]) -> Recording:
    """Read the accelerometers, gyros and magnetometers of a log in SI units, with the temperature.

    Parameters
    ----------
    log : Path
        File in any readable format.
    stated : mapping of str to str
        Values by run-file key: "data.rate", "data.gyro", "sensor.gyro.unit", "sensor.gyro.scale",
        ….

    Raises
    ------
    InputError
        If a key has no effect, if there is no sensor column, if a unit or the rate is not known, or
        if the audit refuses the recording.
    """
    require_used_keys(stated)
    try:
        table = read_log_table(log, stated_options(stated_values(stated), log))
        layout = rest_layout(log, table, stated)
        recording = read_recording(log, layout.columns)
    except InputError as error:
        if error.key != _TOO_LONG:
            raise
        raise InputError(
            "the file is damaged, or too long to be read at once. A log of any length can be "
            "analysed if it is plain text, Parquet, .npz or HDF5 and all its columns are numbers, "
            "with the time in seconds: convert it, or give a part of it",
            key=_TOO_LONG,
        ).located(log) from error
    unit = layout.columns.time_unit
    if "data.time_unit" not in stated and unit not in (None, "s", "sample"):
        text = (
            f"column {layout.columns.time} was read in {unit}, as its steps or its name suggest; "
            "state another unit with --set data.time_unit"
        )
        note = Finding("note", TIME_UNIT, text)
        recording = replace(recording, findings=(*recording.findings, note))
    return in_si(recording, layout.readouts, layout.units)


@dataclass(frozen=True)
class RestLayout:
    """The columns of a log, and the conversion of its channels to SI units.

    Parameters
    ----------
    columns : Columns
    readouts : list of Readout
        Readout of each channel.
    units : list of str
        SI unit of each channel.
    """

    columns: Columns
    readouts: list[Readout]
    units: list[str]


def rest_layout(log: Path, table: Table, stated: Mapping[str, str]) -> RestLayout:
    """Find the layout of a log from its table or its first rows.

    Raises
    ------
    InputError
        If a key has no effect, if there is no sensor column, or if a unit or the rate is not known.
    """
    values = stated_values(stated)
    table, signs = sign_columns(without_unusable(table), values.get("data.signed_bits"))
    columns = stated_columns(values, table, second_file=False)
    roles = recognise_columns(table, detect_reader(log).name, columns, incomplete=True)
    # An empty list states that a triad is not wanted.
    roles = replace(roles, triads={kind: names for kind, names in roles.triads.items() if names})
    roles = _with_magnetometers(log, table, roles, values)
    if not roles.triads:
        raise InputError(
            f"no accelerometers or gyros were recognised among {', '.join(table.names)}: "
            f"{_what_to_state(table, roles)}",
            key="data.accelerometer",
        ).located(log)
    readouts = {kind: _readout(log, table, roles, kind, values) for kind in roles.triads}
    channels = tuple(
        (f"{kind[0]}{axis}", column, readouts[kind].unit)
        for kind, names in roles.triads.items()
        for axis, column in zip(axis_letters(names) or range(1, len(names) + 1), names, strict=True)
    )
    kinds = [kind for kind, names in roles.triads.items() for _ in names]
    return RestLayout(
        replace(
            _columns(log, table, roles, channels, stated, values),
            signed_bits=next((one.value for one in signs), None),
            options=stated_options(values, log),
        ),
        [readouts[kind] for kind in kinds],
        [READING_UNITS[kind] for kind in kinds],
    )


def _with_magnetometers(
    log: Path, table: Table, roles: ColumnRoles, values: Mapping[str, Any]
) -> ColumnRoles:
    """Return the roles with magnetometers that the user states, or whose names state a unit."""
    stated = stated_triad("magnetometer", values, table)
    used = {*roles.single.values(), *(name for each in roles.triads.values() for name in each)}
    free = [n for n in table.names if n not in used and table.columns[n].dtype.kind != "U"]
    named = named_magnetometer(free) if table.header else ()
    names = stated.get("magnetometer", named)
    unit = named_unit(names[0]) if names else None
    if not names or not (stated or unit):
        return roles
    if repeats_values(table.stack(names)):
        if not stated:
            return roles
        raise InputError(
            f"{', '.join(names)} repeat their values, so their samples are not independent; give "
            "a log with one row for each value, or omit data.magnetometer",
            key="data.magnetometer",
        ).located(log)
    units = roles.units if unit is None else {**roles.units, "magnetometer": unit}
    return replace(roles, triads={**roles.triads, "magnetometer": names}, units=units)


def repeats_values(readings: Array) -> bool:
    """Return whether magnetometers, (n, 3), have a new value in less than nine of ten samples."""
    return float(np.mean(new_value_rows(readings))) < _FRESH


def _what_to_state(table: Table, roles: ColumnRoles) -> str:
    """Return the options that a log without known column names needs, with its own names."""
    clock = roles.single.get("time")
    readings: list[str] = []
    for name, column in table.columns.items():
        if column.dtype.kind == "U" or name in roles.single.values() or is_other_quantity(name):
            continue
        if np.all(np.diff(table.numbers(name)) > 0):
            clock = clock or name
        else:
            readings.append(name)
    if not readings:
        return "these columns are none; give a recording of accelerometers or gyros"
    pairs = [("data.accelerometer", ",".join(readings[:3]) or "ax,ay,az"),
             ("data.gyro", ",".join(readings[3:6]) or "gx,gy,gz"),
             ("sensor.gyro.unit", "°/s")]  # fmt: skip
    if clock is not None and "time" not in roles.single:
        pairs += [("data.time", clock), ("data.time_unit", "s")]
    options = " ".join(f'--set "{key}={value}"' for key, value in pairs)
    return (
        f"state which columns they are and the gyros' unit, such as {options}; or give the run "
        "file that names them, with this recording as its [data] file"
    )


def in_si(recording: Recording, readouts: list[Readout], units: list[str]) -> Recording:
    """Convert the readings of all channels to SI units.

    Parameters
    ----------
    recording : Recording
        Recording in output units, with one channel for each readout.
    readouts : list of Readout
    units : list of str
        SI unit of each channel.
    """
    offsets = np.array([one.offset for one in readouts])
    scales = np.array([one.scale for one in readouts])
    return replace(recording, data=(recording.data - offsets) / scales, units=tuple(units))


def require_used_keys(stated: Mapping[str, str]) -> None:
    """Raise an error for a stated key that has no effect in a noise analysis."""
    possible = (*_KEYS, *(f"data.{name}" for name in known_options()))
    unused = [key for key in stated if key not in possible]
    if unused:
        raise InputError(
            f"--set {unused[0]}: this key has no effect in a noise analysis; possible: "
            f"{', '.join(possible)}",
            key=unused[0],
        )


def _readout(
    log: Path, table: Table, roles: ColumnRoles, kind: str, values: Mapping[str, Any]
) -> Readout:
    key = f"sensor.{kind}"
    scale, offset = values.get(f"{key}.scale"), values.get(f"{key}.offset", 0.0)
    if isinstance(offset, bool) or not isinstance(offset, int | float):
        raise InputError(f"{key}.offset: {offset!r} is not a number", key=f"{key}.offset")
    unit = values.get(f"{key}.unit", roles.units.get(kind) if scale is None else _COUNTS)
    if unit is None and kind == "accelerometer":
        names = roles.triads[kind]
        mean = np.array([[float(np.mean(table.numbers(name))) for name in names]])
        guess = guess_accelerometer(mean, None)
        unit = None if guess.scale or not guess.certain else guess.unit
    if unit is None:
        example = {"gyro": "rad/s", "magnetometer": "µT"}.get(kind, "m/s²")
        counts = SCALE_EXAMPLES[kind].format("LSB")
        raise InputError(
            f'the unit of the {kind}s is unknown: state it with --set "{key}.unit={example}", or '
            f'for counts with --set "{key}.scale={counts}"',
            key=f"{key}.unit",
        ).located(log)
    keys = {"unit": str(unit), "scale": scale, "offset": float(offset)}
    return build_readout(kind, ReadoutSection.model_validate(keys))[0]


def _columns(
    log: Path,
    table: Table,
    roles: ColumnRoles,
    channels: tuple[tuple[str, str, str], ...],
    stated: Mapping[str, str],
    values: Mapping[str, Any],
) -> Columns:
    _, clock = clock_keys(table, roles, stated)
    keys = {one.key: one.value for one in clock}
    counted = keys.get("time_unit") == "sample" or "time" not in keys
    if counted and "data.rate" not in stated:
        asked = next((one.ask for one in clock if one.key == "rate"), "")
        raise InputError(
            'the sampling rate is unknown: state it with --set "data.rate=100 Hz"'
            + asked.removeprefix(RATE_QUESTION),
            key="data.rate",
        ).located(log)
    policy = values.get("data.nonfinite", "refuse")
    if policy not in get_args(NonfinitePolicy):
        raise key_error(
            "data.nonfinite", f"{policy!r} can be {', '.join(get_args(NonfinitePolicy))}"
        )
    unit = str(values.get("data.time_unit", keys.get("time_unit", "s")))
    dates = "time" in keys and table.columns[roles.single["time"]].dtype.kind == "U"
    warm = roles.single.get("temperature")
    thermometer = stated_thermometer(values, warm)
    named = [key for key in stated if "temperature" in key]
    if warm is not None and not named:
        kelvin = thermometer.kelvin(table.numbers(warm))
        # These are raw counts that nobody asked for and that the noise analysis does not need.
        warm = warm if first_impossible(kelvin) is None else None
    return Columns(
        channels=channels,
        time=roles.single.get("time") if "time" in keys else None,
        time_unit=None if dates or "time" not in keys else unit,
        rate_hz=si_value(stated["data.rate"], "Hz", "data.rate") if counted else None,
        temperature=warm,
        thermometer=thermometer,
        nonfinite=policy,
        modulus=values.get("data.counter_modulus", keys.get("counter_modulus")),
    )
