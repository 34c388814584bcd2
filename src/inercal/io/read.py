"""Tables and recordings from files of any known kind."""

import os
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from inercal.errors import InputError
from inercal.io.audit import Nonfinite, accept, audit
from inercal.io.npz import read_npz
from inercal.io.parquet import read_parquet
from inercal.io.table import Table, open_error
from inercal.io.text import read_text
from inercal.recording import Array, Recording
from inercal.units import factor, to_si

_Reader = Callable[[Path, Collection[str] | None, Collection[str]], Table]
_BY_CONTENT: dict[bytes, _Reader] = {b"PK\x03\x04": read_npz, b"PAR1": read_parquet}
_BY_SUFFIX: dict[str, _Reader] = {".npz": read_npz, ".parquet": read_parquet, ".pq": read_parquet}
_GZIP = b"\x1f\x8b"


@dataclass(frozen=True)
class Columns:
    """Which column of a file is what.

    Parameters
    ----------
    channels : tuple of (axis, column, unit)
        One for each axis of the sensor, in its order; the unit is that of the column.
    time : str or None
        Column of time stamps; None where samples come at `rate_hz`.
    time_unit : str
        Unit of the time column; "sample" for a counter.
    rate_hz : float or None
        Samples per second, where there is no time column or where it counts samples.
    label : str or None
        Column that names the section of each sample.
    temperature, temperature_unit : str
        Column of temperature, or None.
    readback : tuple of (name, column, unit)
        What the bench said of itself.
    nonfinite : "refuse" or "drop"
        What to do with rows that hold NaN or infinity.

    Raises
    ------
    InputError
        A unit is none, `rate_hz` is missing or needless, or a column is used twice.
    """

    channels: tuple[tuple[str, str, str], ...]
    time: str | None = None
    time_unit: str = "s"
    rate_hz: float | None = None
    label: str | None = None
    temperature: str | None = None
    temperature_unit: str = "°C"
    readback: tuple[tuple[str, str, str], ...] = ()
    nonfinite: Nonfinite = "refuse"

    def __post_init__(self) -> None:
        for _, _, unit in self.channels:
            factor(unit)
        counted = self.time is None or self.time_unit == "sample"
        if counted and self.rate_hz is None:
            reason = "there is no time column" if self.time is None else "time counts samples"
            raise InputError(f"rate_hz is needed: {reason}")
        if not counted and self.rate_hz is not None:
            raise InputError(
                f"rate_hz and a time column in {self.time_unit!r} are both stated: keep one"
            )
        if self.rate_hz is not None and not 0 < self.rate_hz < np.inf:
            raise InputError(f"rate_hz is {self.rate_hz:g}; it must be positive")
        columns = [column for _, column, _ in self.channels]
        for column in columns:
            if columns.count(column) > 1:
                raise InputError(f"column {column!r} is given to more than one channel")

    @property
    def names(self) -> tuple[str, ...]:
        """The columns of the file that are used."""
        single = (self.time, self.label, self.temperature)
        many = (column for _, column, _ in (*self.channels, *self.readback))
        return tuple(dict.fromkeys([*(name for name in single if name is not None), *many]))


def read_table(
    path: str | os.PathLike[str],
    wanted: Collection[str] | None = None,
    text: Collection[str] = (),
) -> Table:
    """Read a table: text of any layout, .npz or Parquet, told by content and then by suffix.

    Parameters
    ----------
    path : path-like
        The file.
    wanted : collection of str or None
        Columns to return; None for all.
    text : collection of str
        Columns to return as text even where they look like numbers.

    Raises
    ------
    InputError
        One line: what is wrong, where, and what is possible.
    """
    path = Path(path)
    try:
        if path.is_dir():
            raise InputError(f"{path} is a folder; name a file in it")
        if path.exists() and not path.is_file():
            raise InputError(f"{path} is no regular file; it is read more than once")
        with path.open("rb") as file:
            head = file.read(4)
        if head.startswith(_GZIP):
            raise InputError(f"{path.name} is compressed with gzip: unpack it first")
        reader = _BY_CONTENT.get(head) or _BY_SUFFIX.get(path.suffix.lower(), read_text)
        return reader(path, wanted, text)
    except OSError as error:
        raise open_error(path, error) from error


def read_recording(
    path: str | os.PathLike[str],
    columns: Columns,
    limits: Mapping[str, tuple[float, float]] | None = None,
) -> Recording:
    """Read a recording and audit it.

    Parameters
    ----------
    path : path-like
        The file.
    columns : Columns
        Which column is what.
    limits : mapping of channel to (lowest, highest), optional
        See `inercal.io.audit.audit`.

    Raises
    ------
    InputError
        The file cannot be read, or the audit refuses the recording.
    """
    table = read_table(path, columns.names, () if columns.label is None else (columns.label,))
    data = np.stack([table.numbers(column) for _, column, _ in columns.channels], axis=-1)
    labels = None if columns.label is None else table.columns[columns.label].astype(np.str_)
    temperature = None
    if columns.temperature is not None:
        celsius = table.numbers(columns.temperature)
        temperature = to_si(celsius, columns.temperature_unit, like="K")
    recording = Recording(
        time=_time(table, columns, len(data)),
        data=data,
        channels=tuple(axis for axis, _, _ in columns.channels),
        units=tuple(unit for _, _, unit in columns.channels),
        labels=labels,
        temperature=temperature,
        readback={
            name: to_si(table.numbers(column), unit, like=unit)
            for name, column, unit in columns.readback
        },
        source=table.source,
        sha256=table.sha256,
        first_row=table.first_line,
    )
    return accept(audit(recording, columns.nonfinite, limits))


def _time(table: Table, columns: Columns, n: int) -> Array:
    """Return the time of each sample, (n,), s."""
    counter = (
        np.arange(n, dtype=np.float64) if columns.time is None else table.numbers(columns.time)
    )
    if columns.rate_hz is not None:
        return counter / columns.rate_hz
    return counter * factor(columns.time_unit, like="s")
