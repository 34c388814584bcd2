"""Read a production line from a folder: a template for run files, and a table of sensors.

::

    line/  run.toml         a run file; "{lot}" in a text is replaced by the column lot
           sensors.csv      id, recording, and further columns; or sensors.parquet
           recordings/…     the recordings: paths, or addresses such as s3://…

If the name of a column contains a dot, such as `bench.gravity`, the column contains the value of
this key for each sensor.
"""

import json
import os
import re
from collections.abc import Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from datetime import datetime
from difflib import get_close_matches
from functools import cached_property
from glob import glob, has_magic
from hashlib import sha256
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

from inercal.basics.errors import InputError
from inercal.basics.small_files import (
    check_columns,
    csv_lines,
    is_file,
    parse_toml,
    read_toml,
    texts_of,
)
from inercal.recordings.io.column_table import file_sha256
from inercal.recordings.io.isolation import Isolation, read_isolated

if TYPE_CHECKING:
    from inercal.runfile import Run

TEMPLATE, TABLES = "run.toml", ("sensors.csv", "sensors.parquet")
ID, RECORDING = "id", "recording"
BARCODE = "barcode"  # column in which a station looks up the sensor
MEASURED = "measured"
GROUPS = ("lot", "station", MEASURED)  # columns that define the groups to compare
_NEEDED = (ID, RECORDING)
_PLACEHOLDER = re.compile(r"\{([A-Za-z_][\w.]*)(:number)?\}")
_DOTTED = re.compile(r"\w+(\.\w+)+")
_PARQUET = Isolation("a Parquet file", libraries=("pyarrow.parquet",), extra="fleet", key="")
_LARGEST_TABLE = 1 << 30  # bytes


@dataclass(frozen=True)
class SensorRow:
    """A row in the table of sensors.

    Parameters
    ----------
    id : str
        Name of the sensor; a name occurs only once in the table.
    recording : str
        Recording of the sensor: a path relative to the line's folder, or an address.
    columns : mapping of str to str
        The other columns, by name.
    """

    id: str
    recording: str
    columns: Mapping[str, str] = field(default_factory=dict[str, str])


@dataclass(frozen=True)
class Line:
    """A production line after reading and checking.

    Parameters
    ----------
    folder : Path
    template : mapping
        The sections of the template run file.
    rows : tuple of SensorRow
    """

    folder: Path
    template: Mapping[str, Any]
    rows: tuple[SensorRow, ...]

    @property
    def path(self) -> Path:
        """Return the path of the template."""
        return self.folder / TEMPLATE

    @cached_property
    def placeholders(self) -> frozenset[str]:
        """Return the columns that the template uses as placeholders."""
        return frozenset(name for name, _ in _PLACEHOLDER.findall(self._template_text))

    def run(self, row: SensorRow, digest: str | None = None) -> "Run":
        """Build and check the run for a sensor.

        Parameters
        ----------
        row : SensorRow
        digest : str, optional
            Digest of the sensor's run file, if it is already known.

        Raises
        ------
        InputError
            See `inercal.runfile.read`. The error is also raised if the value of a cell is not
            possible for its key.
        """
        # Imported here because only workers need the methods.
        from inercal.runfile import from_sections

        sections, digest = self.sections(row), digest or self.digest(row)
        if {ID, RECORDING} & self.placeholders:
            return from_sections(self.path, sections, digest)
        shape = self.shape(row)
        if (alike := self._runs.get(shape)) is None:
            alike = self._runs[shape] = from_sections(self.path, sections, digest)
        return alike.for_sensor(sections, digest)

    def digest(self, row: SensorRow) -> str:
        """Return the SHA-256 hash of the template, of the cells that it uses and of its files.

        A column that neither the template nor the results use does not affect the hash.
        """
        hashed = self._template_hash.copy()
        used = [f"{name}={row.columns[name]}" for name in self._kept if row.columns.get(name)]
        # The recording itself has its own hash.
        place = row.recording if RECORDING in self.placeholders else ""
        texts = self._filled(row) + [
            one
            for name, text in row.columns.items()
            if "." in name
            for one in texts_of(_cell_value(text))
        ]
        named = file_digests(self.folder, texts, leave_out=row.recording)
        hashed.update("\0".join((row.id, place, *used, *named)).encode())
        return hashed.hexdigest()

    def shape(self, row: SensorRow) -> tuple[str, ...]:
        """Return the cells that make run files differ, apart from sensor and recording."""
        return tuple(
            text for name, text in row.columns.items() if "." in name or name in self.placeholders
        )

    @cached_property
    def _runs(self) -> dict[tuple[str, ...], "Run"]:
        """Return the runs that were built, by shape; only the first sensor of each is checked."""
        return {}

    @cached_property
    def _template_text(self) -> str:
        # TOML has dates, but JSON does not.
        return json.dumps(self.template, sort_keys=True, ensure_ascii=False, default=str)

    @cached_property
    def _template_hash(self) -> Any:
        # Files that all sensors share are read only once.
        named = file_digests(self.folder, texts_of(self.template))
        return sha256("\0".join((self._template_text, *named)).encode())

    @cached_property
    def _varying(self) -> tuple[str, ...]:
        """Return the texts in the template that differ from sensor to sensor."""
        return tuple(text for text in texts_of(self.template) if _PLACEHOLDER.search(text))

    @cached_property
    def _used(self) -> tuple[str, ...]:
        return tuple(name for name in self.columns if "." in name or name in self.placeholders)

    @cached_property
    def _kept(self) -> tuple[str, ...]:
        return tuple(name for name in self.columns if name in self._used or name in GROUPS)

    @property
    def columns(self) -> tuple[str, ...]:
        """Return the names of the table's columns, except id and recording."""
        return tuple(self.rows[0].columns) if self.rows else ()

    @property
    def input_files(self) -> set[Path]:
        """Return the resolved paths of the template, the tables, and all files that they name."""
        texts = {TEMPLATE, *TABLES, *texts_of(self.template)}
        for row in self.rows:
            texts |= {row.recording, *row.columns.values(), *self._filled(row)}
        for text in filter(has_magic, tuple(texts)):
            texts.update(glob(text, root_dir=self.folder))
        paths = (os.path.join(self.folder, text) for text in texts)
        return {Path(path).resolve() for path in paths if os.path.isfile(path)}

    def _filled(self, row: SensorRow) -> list[str]:
        """Return the texts in the template that differ from sensor to sensor, for one of them."""
        values = {ID: row.id, RECORDING: row.recording, **row.columns}
        return [_PLACEHOLDER.sub(lambda one: values[one[1]], text) for text in self._varying]

    def sections(self, row: SensorRow) -> dict[str, Any]:
        """Return the sections of a sensor's run file, with placeholders replaced by values.

        The sensor's name is its id, and [data] file is its recording, unless the template states
        these keys with placeholders.

        Raises
        ------
        InputError
            A column refers to a key in a section, but the template has a value in place of the
            section.
        """
        values = {ID: row.id, RECORDING: row.recording, **row.columns}
        filled = cast(dict[str, Any], _fill(self.template, values))
        for section, key, value in (("sensor", "name", row.id), ("data", "file", row.recording)):
            stated: object = filled.setdefault(section, {})
            if isinstance(
                stated, dict
            ):  # the check of the run file rejects a value that is not a section
                cast(dict[str, Any], stated).setdefault(key, value)
        for name, text in row.columns.items():
            if "." in name and text:
                _override(filled, name, text)
        return filled


def read_line(folder: str | Path) -> Line:
    """Read a line's template and its table of sensors.

    Parameters
    ----------
    folder : path

    Raises
    ------
    InputError
        The folder, template or table is missing, a column is missing, an id occurs twice, a cell is
        empty, or a placeholder has no column.
    """
    folder = Path(folder)
    if not folder.is_dir():
        raise InputError(
            f"there is no such folder; a line is a folder with {TEMPLATE} and {TABLES[0]}"
        ).located(folder)
    path = folder / TEMPLATE
    template = read_toml(path, "run file")
    table = next((folder / name for name in TABLES if (folder / name).is_file()), None)
    if table is None:
        raise InputError(f"{folder}: no {' or '.join(TABLES)}", file=folder)
    rows = _read_rows(table)
    line = Line(folder, template, tuple(rows))
    known = {*_NEEDED, *(rows[0].columns if rows else ())}
    if missing := sorted(line.placeholders - known):
        near = get_close_matches(missing[0], sorted(known), n=1)
        raise InputError(
            f"{{{missing[0]}}} is not a column of "
            f"{table.name}{f'; did you mean {near[0]}?' if near else ''}; its columns are "
            f"{', '.join(sorted(known))}",
            names=tuple(missing),
        ).located(path)
    for name in line.columns:
        if "." in name and not _DOTTED.fullmatch(name):
            raise InputError(
                f"column {name!r}: a name with a dot must be a key of the run file, such as "
                "bench.gravity; rename or remove the column",
                names=(name,),
            ).located(table)
    return line


def _read_rows(path: Path) -> list[SensorRow]:
    lines = (
        csv_lines(path, _NEEDED, "table of sensors", _LARGEST_TABLE)
        if path.suffix == ".csv"
        else _parquet_lines(path)
    )
    rows: list[SensorRow] = []
    seen: dict[str, str] = {}
    codes: dict[str, str] = {}
    for where, cells in lines:
        name, recording = cells.pop(ID).strip(), cells.pop(RECORDING).strip()
        if not (name and recording):
            empty = ID if not name else RECORDING
            raise InputError(f"{path}: {where}: column {empty} is empty", file=path, names=(empty,))
        if Path(name).name != name or name == "..":
            raise InputError(
                f"{where}: id {name!r} cannot be used as a file name; remove each /", names=(name,)
            ).located(path)
        if name in seen:
            raise InputError(
                f"{where}: id {name!r} is already used in {seen[name]}; each sensor has one row",
                names=(name,),
            ).located(path)
        seen[name] = where
        _require_time(path, where, cells.get(MEASURED, ""))
        code = cells.get(BARCODE, "")
        if code and (other := codes.setdefault(code, where)) != where:
            raise InputError(
                f"{where}: barcode {code!r} is already used in {other}; give each its own",
                names=(BARCODE,),
            ).located(path)
        rows.append(SensorRow(name, recording, cells))
    if not rows:
        raise InputError(f"{path} contains no sensor", file=path)
    return rows


def _require_time(path: Path, where: str, text: str) -> None:
    try:
        if text:
            datetime.fromisoformat(text)
    except ValueError:
        raise InputError(
            f"{where}: {MEASURED} {text!r} is not a time; write it in ISO 8601, such "
            "as 2026-03-01 or 2026-03-01T14:30:00+01:00",
            names=(MEASURED,),
        ).located(path) from None


def _parquet_lines(path: Path) -> Iterator[tuple[str, dict[str, str]]]:
    names, columns = read_isolated(_PARQUET, path, _parquet_texts)
    check_columns(path, names, _NEEDED)
    for k, cells in enumerate(zip(*columns, strict=True)):
        yield f"row {k + 1}", dict(zip(names, cells, strict=True))


def _parquet_texts(path: Path) -> tuple[list[str], list[list[str]]]:
    """Return the column names of a Parquet file, and its cells as text."""
    pq: Any = import_module("pyarrow.parquet")
    table = pq.read_table(path, use_threads=False)
    cells = (column.to_pylist() for column in table.columns)
    return table.column_names, [["" if one is None else str(one) for one in c] for c in cells]


def _fill(value: object, columns: Mapping[str, str]) -> object:
    """Return a value from the template with its placeholders replaced by the columns."""
    if isinstance(value, dict):
        content = cast(dict[str, object], value)
        return {key: _fill(one, columns) for key, one in content.items()}
    if isinstance(value, list):
        return [_fill(one, columns) for one in cast(list[object], value)]
    if not isinstance(value, str) or "{" not in value:
        return value
    whole = _PLACEHOLDER.fullmatch(value)
    if whole is not None and whole[2]:
        return _number(columns[whole[1]], whole[1])
    return _PLACEHOLDER.sub(lambda found: columns[found[1]], value)


def _number(text: str, column: str) -> float | int:
    try:
        return int(text)
    except ValueError:
        pass
    try:
        return float(text)
    except ValueError:
        raise InputError(f"column {column}: {text!r} is not a number", names=(column,)) from None


def file_digests(folder: Path, texts: Iterable[str], leave_out: str = "") -> list[str]:
    """Return the name and SHA-256 hash of each file in a folder that one of the texts names.

    Parameters
    ----------
    folder : Path
    texts : iterable of str
        Texts in a run file.
    leave_out : str, optional
        A file name to omit.
    """
    found: list[str] = []
    for text in dict.fromkeys(texts):
        if text and text != leave_out and is_file(folder / text):
            with suppress(OSError):  # reported when the file is read for a calibration
                found.append(f"{text}={file_sha256(folder / text)}")
    return found


def _override(sections: dict[str, Any], dotted: str, text: str) -> None:
    *path, key = dotted.split(".")
    section = sections
    for name in path:
        inner: object = section.setdefault(name, {})
        if not isinstance(inner, dict):
            raise InputError(
                f"column {dotted}: [{'.'.join(path)}] is not a section of the template",
                names=(dotted,),
            )
        section = cast(dict[str, Any], inner)
    section[key] = _cell_value(text)


def _cell_value(text: str) -> str | list[Any]:
    """Return the value of a cell for a key: a list, if the cell is one in TOML, or else its text.

    >>> _cell_value('["AccX", "AccY"]'), _cell_value("[bench]")
    (['AccX', 'AccY'], '[bench]')
    """
    if not text.lstrip().startswith("["):
        return text
    try:
        return cast(list[Any], parse_toml(f"list = {text.strip()}", "cell")["list"])
    except InputError:
        return text
