"""What a run file says of its data, in the words of `inercal.io`: columns, limits, deviations."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from inercal.data.data_section import DataSection, ReadbackColumn
from inercal.data.source import Source
from inercal.errors import InputError
from inercal.io.read import Columns, detect_reader, read_recording
from inercal.recording import Finding, Recording
from inercal.section_settings import si_value
from inercal.sensors import Sensor
from inercal.units import parse_quantity

READBACK = "readback"  # of `DataSection.further_files`: the file of what a bench reads back


def load_recording(run: Source[DataSection]) -> Recording:
    """Read and audit the run's recording.

    Raises
    ------
    InputError
        It cannot be read, or the audit refuses it.
    """
    recording = read_recording(
        run.file(run.data.file), reader_columns(run), range_limits(run.sensor), gyro_file(run)
    )
    return apply_axis_signs(run, recording)


def require_not_refused(source: str, finding: Finding | None) -> tuple[Finding, ...]:
    """Return a finding, if any, to go with others.

    Raises
    ------
    InputError
        It refuses the data.
    """
    if finding is None:
        return ()
    if finding.severity == "refused":
        raise InputError(f"{source}: {finding.message}")
    return (finding,)


def unsigned_column(column: str | int) -> str:
    """Return a column's name or number without the sign that reverses it."""
    return str(column).removeprefix("-")


def reversed_axes(run: Source[DataSection]) -> frozenset[str]:
    """Return the sensor's axes whose columns are stated with a leading "-"."""
    given = {"f": run.data.accelerometer, "w": run.data.gyro}
    return frozenset(
        axis.name
        for kind, columns in given.items()
        for axis, column in zip(
            (axis for axis in run.sensor.axes if axis.measures == kind), columns, strict=False
        )
        if str(column).startswith("-")
    )


def apply_axis_signs(run: Source[DataSection], recording: Recording) -> Recording:
    """Return the recording with the axes reversed, about their zeros, that the run file says."""
    back = reversed_axes(run)
    if not back:
        return recording
    data = recording.data.copy()
    for axis in run.sensor.axes:
        if axis.name in back:
            k = recording.channels.index(axis.name)
            data[..., k] = 2 * axis.readout.offset - data[..., k]
    return replace(recording, data=data)


def gyro_file(run: Source[DataSection]) -> Path | None:
    """Return the file that holds the gyros alone: none where the method leaves them out."""
    name = run.data.gyro_file
    return None if name is None or not run.sensor.select_axes("w").axes else run.file(name)


def range_limits(sensor: Sensor) -> dict[str, tuple[float, float]]:
    """Return the ends of each axis's range in output units, where its full scale is stated."""
    found: dict[str, tuple[float, float]] = {}
    for axis in sensor.axes:
        if (reach := axis.readout.full_scale) is not None:
            found[axis.name] = (axis.readout.offset - reach, axis.readout.offset + reach)
    return found


def reader_columns(run: Source[DataSection]) -> Columns:
    """Return which column of the run's data is what."""
    data = run.data
    names = {"f": data.accelerometer, "w": data.gyro}
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
        channels=channels["f"] if apart else channels["f"] + channels["w"],
        second=channels["w"] if apart else (),
        time=None if data.time is None or data.kind == "means" else str(data.time),
        time_unit=data.time_unit if "time_unit" in data.model_fields_set else None,
        rate_hz=_column_rate(run),
        label=None if label is None else str(label),
        temperature=None if data.temperature is None else str(data.temperature),
        temperature_unit=data.temperature_unit,
        readback=() if READBACK in data.further_files() else readback_fields(run),
        nonfinite=data.nonfinite,
        modulus=data.counter_modulus,
        options=_data_file_options(run),
    )


def _data_file_options(run: Source[DataSection]) -> dict[str, object]:
    """Return the options of readers, without those that only the readback's own file has."""
    table = run.data.further_files().get(READBACK)
    theirs = {} if table is None or not run.reader_options else file_reader_options(run, table)
    names = [run.data.file, *([] if run.data.gyro_file is None else [run.data.gyro_file])]
    ours = [key for name in names for key in file_reader_options(run, name)] if theirs else []
    return {k: v for k, v in run.reader_options.items() if k in ours or k not in theirs}


def file_reader_options(run: Source[DataSection], name: str) -> dict[str, object]:
    """Return the options that the reader of a file knows; none of a file that is not there."""
    if not run.reader_options or not run.file(name).exists():
        return {}
    known = detect_reader(run.file(name)).keys
    return {key: value for key, value in run.reader_options.items() if key in known}


def readbacks(run: Source[DataSection]) -> tuple[ReadbackColumn, ...]:
    """Return the columns in which the bench states something of itself.

    Raises
    ------
    InputError
        A unit that is none of such a quantity.
    """
    try:
        return run.data.readback(run.bench)
    except InputError as error:
        raise error.located(run.path) from None


def readback_fields(run: Source[DataSection]) -> tuple[tuple[str, str, str], ...]:
    """Return name, column and unit of what a bench reads back.

    In units of their columns, "1": `readback_units` makes them SI.
    """
    return tuple((one.name, one.column, "1") for one in readbacks(run))


def readback_columns(run: Source[DataSection]) -> dict[str, str]:
    """Return the columns in which a bench states rates, angles and levels, by readback."""
    return {one.name: one.column for one in readbacks(run)}


def readback_units(run: Source[DataSection]) -> dict[str, float]:
    """Return the SI size of one unit of each of these columns, negative of one that is reversed.

    Raises
    ------
    InputError
        A unit that is not an angular rate or an angle.
    """
    return {one.name: one.size for one in readbacks(run)}


def require_distinct_columns(run: Source[DataSection], *further: str) -> None:
    """Refuse a column that is named for two things; `further` are columns beside the readback.

    Raises
    ------
    InputError
        Naming it.
    """
    kinds = {axis.measures for axis in run.sensor.axes}
    data, beside = run.data, list(readback_columns(run).values())
    used = [unsigned_column(column) for column in data.accelerometer]
    if "w" in kinds and data.gyro_file is None:
        used += [unsigned_column(column) for column in data.gyro]
    own = READBACK in data.further_files()
    files = (used, [*further, *beside]) if own else (used + beside,)
    twice = [column for one in files for column, count in Counter(one).items() if count > 1]
    if twice:
        raise InputError(f"{run.path}: [data] names column {twice[0]!r} for two things")


def position_name(value: object) -> str:
    """Return a position's name; a whole number as it is written."""
    if isinstance(value, float) and value.is_integer():
        return str(int(value))
    return str(value).strip()


def number_repeated_names(names: Sequence[str]) -> list[str]:
    """Return a name for each row of names that may return, such as "x_p (2)"."""
    count: Counter[str] = Counter()
    found: list[str] = []
    for name in names:
        count[name] += 1
        found.append(name if count[name] == 1 else f"{name} ({count[name]})")
    return found


def _column_rate(run: Source[DataSection]) -> float | None:
    """Return the rate that times the samples: none where a column of time does."""
    if run.data.kind == "means":
        return 1.0  # rows follow one another; nothing depends on when
    stamped = run.data.time is not None and run.data.time_unit != "sample"
    if run.rate_hz is None and not stamped:
        raise InputError(
            f'{run.path}: [data] rate is missing, such as "100 Hz"; or name the time column, '
            'time = "…" (and time_unit); a table of means is kind = "means"'
        )
    return None if stamped else run.rate_hz


def stated_deviations(run: Source[DataSection]) -> dict[str, float]:
    """Return the standard deviations of means that the run states, SI, by what axes measure.

    Raises
    ------
    InputError
        One that is not positive, or in another unit than the quantity's or the output's.
    """
    likes = {"accelerometer": ("f", "m/s²"), "gyro": ("w", "rad/s")}
    found: dict[str, float] = {}
    for name, text in run.data.sd.items():
        measures, like = likes[name]
        key = f"{run.path}: [data.sd] {name}"
        readouts = [axis.readout for axis in run.sensor.axes if axis.measures == measures]
        try:
            found[measures] = parse_quantity(text, like).value
        except InputError as error:
            # Of an output in V or LSB the deviation may be stated as it stands in the file.
            if not readouts or readouts[0].unit not in ("V", "LSB"):
                raise InputError(f"{key}: {error}") from None
            found[measures] = si_value(text, readouts[0].unit, key) / abs(readouts[0].scale)
        if found[measures] <= 0:
            raise InputError(f"{key}: {text!r} must be positive")
    return found
