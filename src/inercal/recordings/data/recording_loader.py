"""Load the recording that a run file names, with the columns that its [data] section describes."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from math import inf
from pathlib import Path
from typing import cast

from inercal.basics.errors import InputError, error_location
from inercal.basics.small_files import is_file
from inercal.basics.units import parse_quantity, si_factor
from inercal.physics.quantities import QUANTITIES
from inercal.physics.section_settings import key_error, si_value
from inercal.physics.sensors import Sensor, output_unit
from inercal.recordings import Finding, Recording, ahead_of_lag
from inercal.recordings.data import DataSection, ReadbackColumn, RunBase
from inercal.recordings.io.file_patterns import is_pattern
from inercal.recordings.io.read import Columns, detect_reader, read_recording
from inercal.recordings.io.section_files import read_sections
from inercal.recordings.io.time_stamps import SAME_RATE

READBACK = "readback"  # key in `DataSection.further_files` for the file with the bench's readback


def load_recording(run: RunBase[DataSection]) -> Recording:
    """Read and audit the run's recording.

    Without a stated full scale, no range of a magnetometer is looked for, because the repeated
    values of a slow one look like the end of a range.

    Raises
    ------
    InputError
        The file cannot be read, or the audit refuses it.
    """
    unlimited = dict.fromkeys(run.sensor.select_axes("m").channels, (-inf, inf))
    return _load(run, unlimited | range_limits(run.sensor))


def load_magnetometers(run: RunBase[DataSection]) -> Recording:
    """Read and audit only the magnetometers of a run, as a separate recording.

    The audit then treats the other axes as if there were no magnetometers.

    Raises
    ------
    InputError
        See `load_recording`.
    """
    return load_recording(of_magnetometers(run))


def of_magnetometers(run: RunBase[DataSection]) -> RunBase[DataSection]:
    """Return a run whose only axes are its magnetometers."""
    assert run.magnetometer is not None
    return replace(run, sensor=run.magnetometer, magnetometer=None)


def _load(run: RunBase[DataSection], limits: Mapping[str, tuple[float, float]]) -> Recording:
    require_distinct_columns(run)
    path = run.file(run.data.file)
    sources: dict[str, str] = {}
    try:
        columns = reader_columns(run)
        sources = {axis: column for axis, column, _ in (*columns.channels, *columns.second)}
        if is_pattern(path):
            if run.data.marks not in ("labels", "found"):
                raise key_error(
                    "[data] marks",
                    'each section has its own file: state marks = "labels"',
                    run.path,
                )
            recording = read_sections(path, columns, limits)
        else:
            recording = read_recording(path, columns, limits, gyro_file(run))
    except InputError as error:
        if str(error).startswith("[data]"):  # from a reader's option; the reader has no run file
            raise error.located(run.path) from None
        if (key := _key_of_column(run.data, error.names)) is not None:
            raise error.located(f"{run.path}: {key}", key=key) from None
        axis = error.names[0] if len(error.names) == 1 else ""
        if (column := sources.get(axis, axis)) != axis:
            named = f": {axis} (column {column}) "
            error.args = (str(error).replace(f": {axis} ", named), *error.args[1:])
        raise
    _require_stated_rate(run, recording)
    recording = apply_axis_signs(run, recording)
    environment = run.environment
    # If the estimator follows the rest, the lag is one of its parameters.
    if environment is None or environment.lag is None or run.method.follows_rest:
        return recording
    return ahead_of_lag(recording, environment.lag.value)


def _require_stated_rate(run: RunBase[DataSection], recording: Recording) -> None:
    """Raise an error if the times contradict the stated rate, which a simulation uses."""
    data, stated = run.data, run.rate_hz
    if stated is None or data.time is None or data.time_unit == "sample":
        return
    require_same_rate(stated, str(data.time), recording.rate_hz, run.path)


def require_same_rate(stated: float, column: str, found: float, path: Path) -> None:
    """Raise an error if the rate that a column of times gives is not about the stated rate, Hz."""
    if abs(found / stated - 1) > SAME_RATE:
        raise key_error(
            "[data] rate",
            f"{stated:.4g} Hz contradicts column {column!r}, whose times give {found:.4g} Hz; "
            "correct the rate or time_unit, or remove rate",
            path,
        )


def _key_of_column(section: DataSection, names: Sequence[str]) -> str | None:
    """Return the key of [data] that names a column; None if no key does."""
    if len(names) != 1:
        return None
    for key in type(section).model_fields:
        value: object = getattr(section, key)
        given = cast("tuple[object, ...]", value) if isinstance(value, tuple) else (value,)
        if names[0] in {unsigned_column(one) for one in given if isinstance(one, str | int)}:
            return f"[data] {key}"
    return None


def require_not_refused(source: str, finding: Finding | None) -> tuple[Finding, ...]:
    """Return a tuple with the finding, or an empty one if there is none.

    Raises
    ------
    InputError
        The finding refuses the data.
    """
    if finding is None:
        return ()
    if finding.severity == "refused":
        raise InputError(f"{source}: {finding.message}", file=source)
    return (finding,)


def unsigned_column(column: str | int) -> str:
    """Return a column's name or number without the sign that reverses it."""
    return str(column).removeprefix("-")


def _columns_by_kind(data: DataSection) -> dict[str, tuple[str | int, ...]]:
    return {kind: getattr(data, one.sensor) for kind, one in QUANTITIES.items()}


def reversed_axes(run: RunBase[DataSection]) -> frozenset[str]:
    """Return the sensor's axes whose columns are stated with a leading "-"."""
    given = _columns_by_kind(run.data)
    return frozenset(
        axis.name
        for kind, columns in given.items()
        for axis, column in zip(
            (axis for axis in run.sensor.axes if axis.measures == kind), columns, strict=False
        )
        if str(column).startswith("-")
    )


def apply_axis_signs(run: RunBase[DataSection], recording: Recording) -> Recording:
    """Return the recording with the readings of reversed axes mirrored about their zero output."""
    back = reversed_axes(run)
    if not back:
        return recording
    data = recording.data.copy()
    for axis in run.sensor.axes:
        if axis.name in back:
            k = recording.channels.index(axis.name)
            data[..., k] = 2 * axis.readout.offset - data[..., k]
    return replace(recording, data=data)


def gyro_file(run: RunBase[DataSection]) -> Path | None:
    """Return the separate file of the gyros; None if there is none.

    If the gyros have their own time column, this may be the accelerometers' file.
    """
    data = run.data
    name = data.gyro_file or (None if data.gyro_time is None else data.file)
    return None if name is None or not run.sensor.select_axes("w").axes else run.file(name)


def range_limits(sensor: Sensor) -> dict[str, tuple[float, float]]:
    """Return the limits of each axis's range in output units, if its full scale is stated."""
    return {
        axis.name: (axis.readout.offset - reach, axis.readout.offset + reach)
        for axis in sensor.axes
        if (reach := axis.readout.full_scale) is not None
    }


def reader_columns(run: RunBase[DataSection]) -> Columns:
    """Return the content of each column of the run's data."""
    data = run.data
    names = _columns_by_kind(data)
    channels: dict[str, tuple[tuple[str, str, str], ...]] = {}
    for kind, given in names.items():
        axes = [axis for axis in run.sensor.axes if axis.measures == kind]
        channels[kind] = tuple(
            (axis.name, unsigned_column(column), axis.readout.unit)
            for axis, column in zip(axes, given, strict=False)
        )
    apart = gyro_file(run) is not None
    label = data.row
    return Columns(
        channels=channels["f"] + channels["w"] * (not apart) + channels["m"],
        second=channels["w"] if apart else (),
        time=None if data.time is None or data.kind == "means" else str(data.time),
        time_unit=data.time_unit if "time_unit" in data.model_fields_set else None,
        rate_hz=_column_rate(run),
        label=None if label is None else str(label),
        temperature=None if data.temperature is None else str(data.temperature),
        thermometer=data.thermometer,
        readback=() if READBACK in data.further_files() else readback_fields(run),
        nonfinite=data.nonfinite,
        modulus=data.counter_modulus,
        signed_bits=data.signed_bits,
        second_time=None if data.gyro_time is None or not apart else str(data.gyro_time),
        options=_data_file_options(run),
    )


def _data_file_options(run: RunBase[DataSection]) -> dict[str, object]:
    """Return the reader options, without those that only the readback file uses."""
    table = run.data.further_files().get(READBACK)
    of_readback = {} if table is None else file_reader_options(run, table)
    names = [name for name in (run.data.file, run.data.gyro_file) if name is not None]
    of_data = [key for name in names for key in file_reader_options(run, name)]
    return {
        key: value
        for key, value in run.reader_options.items()
        if key in of_data or key not in of_readback
    }


def file_reader_options(run: RunBase[DataSection], name: str) -> dict[str, object]:
    """Return the options that a file's reader supports; empty if the file does not exist."""
    if not run.reader_options or not is_file(run.file(name)):
        return {}
    known = detect_reader(run.file(name)).keys
    return {key: value for key, value in run.reader_options.items() if key in known}


def readbacks(run: RunBase[DataSection]) -> tuple[ReadbackColumn, ...]:
    """Return the columns of the quantities that the bench measures.

    Raises
    ------
    InputError
        A unit does not belong to the quantity.
    """
    with error_location(run.path):
        return run.data.readback(run.bench)


def readback_fields(run: RunBase[DataSection]) -> tuple[tuple[str, str, str], ...]:
    """Return name, column and unit of each quantity that the bench measures.

    The unit is "1" because values stay in the units of their columns; use `readback_units` to
    convert.
    """
    return tuple((one.name, one.column, "1") for one in readbacks(run))


def readback_columns(run: RunBase[DataSection]) -> dict[str, str]:
    """Return the columns of the rates, angles and levels that the bench measures, by name."""
    return {one.name: one.column for one in readbacks(run)}


def readback_units(run: RunBase[DataSection]) -> dict[str, float]:
    """Return the SI size of each readback column's unit, negative for a reversed column.

    Raises
    ------
    InputError
        A unit is neither an angular rate nor an angle.
    """
    return {one.name: one.size for one in readbacks(run)}


def require_distinct_columns(run: RunBase[DataSection], *further: str) -> None:
    """Refuse a column that is used for two quantities; `further` adds columns to the readback.

    Raises
    ------
    InputError
        A column is used twice; the message names it.
    """
    kinds = {axis.measures for axis in run.whole_sensor.axes}
    data, readback = run.data, list(readback_columns(run).values())
    used = [unsigned_column(c) for c in (*data.accelerometer, *data.magnetometer * ("m" in kinds))]
    if data.kind == "recording":
        single = (data.time, data.row, data.temperature)
        used += [str(column) for column in single if column is not None]
    if "w" in kinds and data.gyro_file is None:
        used += [unsigned_column(column) for column in data.gyro]
    separate = READBACK in data.further_files()
    for columns in (used, [*further, *readback]) if separate else (used + readback,):
        refuse_repeated_columns(run, columns)


def refuse_repeated_columns(run: RunBase[DataSection], columns: Sequence[str]) -> None:
    """Raise an error if [data] names a column twice in one file."""
    if twice := [column for column, count in Counter(columns).items() if count > 1]:
        raise InputError(
            f"{run.path}: [data] names column {twice[0]!r} for two quantities; name a different "
            "column for each",
            file=run.path,
            key="[data]",
            names=(twice[0],),
        )


def position_name(value: object) -> str:
    """Return the name of a position; whole numbers have no decimals."""
    if isinstance(value, float) and value.is_integer():
        return str(int(value))
    return str(value).strip()


def number_repeated_names(names: Sequence[str]) -> list[str]:
    """Make the name of each row unique: the second "x_p" becomes "x_p (2)"."""
    count: Counter[str] = Counter()
    distinct: list[str] = []
    for name in names:
        count[name] += 1
        distinct.append(name if count[name] == 1 else f"{name} ({count[name]})")
    return distinct


def _column_rate(run: RunBase[DataSection]) -> float | None:
    """Return the sampling rate; None if a time column replaces it."""
    if run.data.kind == "means":
        return 1.0  # the rows have an order, but nothing depends on their times
    stamped = run.data.time is not None and run.data.time_unit != "sample"
    if run.rate_hz is None and not stamped:
        raise key_error(
            "[data] rate",
            'is missing: state the rate, such as rate = "100 Hz", or name the column of times in '
            'the key `time`; for a table of means state kind = "means"',
            run.path,
        )
    return None if stamped else run.rate_hz


def stated_deviations(run: RunBase[DataSection]) -> dict[str, float]:
    """Return the standard deviations of means in the run file by measured quantity, SI.

    Raises
    ------
    InputError
        A value is not positive, or its unit is neither that of the quantity nor that of the output.
    """
    likes = {one.sensor: (one.symbol, one.unit) for one in QUANTITIES.values()}
    deviations: dict[str, float] = {}
    for name, text in run.data.sd.items():
        measures, like = likes[name]
        key = f"[data.sd] {name}"
        where, refusal = f"{run.path}: {key}", partial(InputError, file=run.path, key=key)
        readouts = [a.readout for a in run.whole_sensor.axes if a.measures == measures]
        if not readouts:
            raise refusal(
                f"{where}: the sensor has no {name}; add [sensor.{name}], or remove the key"
            )
        try:
            deviations[measures] = parse_quantity(text, like).value
        except InputError as error:
            # The deviation of an output such as V or LSB may be stated in a unit of this output.
            unit, scale = readouts[0].unit, readouts[0].scale
            if output_unit(unit) is None:
                raise error.located(where, file=run.path, key=key) from None
            try:
                deviations[measures] = si_value(text, unit, where) / si_factor(unit) / abs(scale)
            except InputError:
                raise refusal(
                    f"{where}: {error}, or in the unit of the readings, {unit!r}"
                ) from None
        if deviations[measures] <= 0:
            raise refusal(f"{where}: {text!r} must be positive")
    return deviations
