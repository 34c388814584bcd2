"""The table of a guided measurement, which is filled in row by row and always saved.

The table is written to disk after each change, and a later session needs nothing else. If a mean
consists of several readings, a second file `NAME.readings.csv` contains the single readings. A new
reading is first written to this file, and a removed reading is first removed from the table. After
an interruption, the readings of a row may therefore be complete although its mean is missing. The
mean is then computed when the table is opened again.
"""

import csv
from collections.abc import Generator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from math import fsum
from pathlib import Path

from inercal.basics.atomic_files import write_text
from inercal.basics.errors import InputError
from inercal.basics.small_files import read_small_file
from inercal.benches.operator_sheet import Sheet, SheetRow
from inercal.pipeline.design.worksheet import rows_as_csv, run_sheet, table_rows
from inercal.runfile import Run

Reading = Mapping[str, float]  # values by column of the table
_STEP, _NUMBER = "step", "reading"  # columns in the file of single readings


@dataclass(eq=False)
class MeasuredRow:
    """One row of the table.

    Parameters
    ----------
    planned : SheetRow
        The setting, and the cells that are known in advance.
    columns : tuple of str
        Columns with measured values.
    cells : dict of str to str
        Cells of all columns in the table, as texts.
    readings : list of Reading
        The single readings, if known.
    """

    planned: SheetRow
    columns: tuple[str, ...]
    cells: dict[str, str]
    readings: list[Reading] = field(default_factory=list[Reading])

    @property
    def complete(self) -> bool:
        """Whether all means of the row are in the table."""
        return all(self.cells[name].strip() for name in self.columns)

    def mean(self) -> dict[str, float]:
        """Return the means of the single readings, by column."""
        n = len(self.readings)
        return {name: fsum(one[name] for one in self.readings) / n for name in self.columns}


def measurement_files(table: Path) -> tuple[Path, Path]:
    """Return the files of a measurement: the table, and the file with single readings."""
    return table, table.with_name(f"{table.stem}.readings.csv")


class MeasurementTable:
    """The table of a measurement, with its rows and its file.

    Parameters
    ----------
    run : Run
    path : Path
        File with the worksheet of this run, or a file that does not exist yet. Rows that are filled
        in are kept.
    count : int
        Number of readings per mean.
    anew : bool
        Whether to begin with an empty table, whatever the file contains.

    Attributes
    ----------
    sheet : Sheet
    rows : list of MeasuredRow
        The rows, in the order of the table.
    left_out : tuple of str
        Steps of the plan that have no row in the table.

    Raises
    ------
    InputError
        The run has no worksheet, the file is another table, or a row is only partly filled in.
    """

    def __init__(self, run: Run, path: Path, count: int, *, anew: bool = False):
        self._count = count
        self.path, self._readings_path = measurement_files(path)
        self._comments: list[str] = []
        self.sheet: Sheet = run_sheet(run)
        names, *cells = table_rows(run, self.sheet)
        self._run, self._names = run, names
        self._columns, self.left_out = names, tuple[str, ...]()
        if not anew and self._readings_path.exists() and not path.exists():
            raise InputError(
                f"{self._readings_path} exists without its table {path}: move it, or start again "
                "with --force",
                file=self._readings_path,
            )
        if anew or not path.exists():
            self.rows = [
                self._row(planned, dict(zip(names, own, strict=True)))
                for planned, own in zip(self.sheet.rows, cells, strict=True)
            ]
        else:
            self.rows = self._read_rows()
            self._read_single_readings()

    @property
    def open_row(self) -> int | None:
        """Index of the first row that is not complete; None if all rows are complete."""
        return next((k for k, row in enumerate(self.rows) if not row.complete), None)

    @property
    def measured(self) -> int:
        """Number of complete rows."""
        return sum(row.complete for row in self.rows)

    def begin(self, notes: Sequence[str] = ()) -> None:
        """Write the table as it is, and remove single readings that belong to another table.

        `notes` about the measurement become comments of the table, unless it has them already.
        """
        new = (f"# {note}" for note in notes)
        self._comments = list(dict.fromkeys([*self._comments, *new]))
        if not any(row.readings for row in self.rows):
            self._readings_path.unlink(missing_ok=True)
        self._write_table()

    def add(self, k: int, readings: Sequence[Reading]) -> bool:
        """Add readings to row `k` and store them; return whether the row is now complete."""
        row = self.rows[k]
        with _unchanged_on_failure(row):
            row.readings = [*row.readings, *readings]
            if self._count > 1:
                self._write_readings()
            if len(row.readings) < self._count:
                return False
            self._fill(row)
            self._write_table()
        return True

    def remove(self, k: int, *, last: bool) -> None:
        """Remove the last reading of row `k`, or all its readings, and empty its means."""
        row = self.rows[k]
        with _unchanged_on_failure(row):
            row.cells = {**row.cells, **dict.fromkeys(row.columns, "")}
            row.readings = row.readings[:-1] if last else []
            self._write_table()
            if self._count > 1 or self._readings_path.exists():
                self._write_readings()

    def _fill(self, row: MeasuredRow) -> None:
        digits = "" if len(row.readings) == 1 else ".12g"
        found = {
            name: format(value, digits) if digits else repr(value)
            for name, value in row.mean().items()
        }
        row.cells = {**row.cells, **found}

    def _row(self, planned: SheetRow, cells: dict[str, str]) -> MeasuredRow:
        return MeasuredRow(planned, self.sheet.entry_columns(planned), cells)

    def _read_rows(self) -> list[MeasuredRow]:
        lines = self._lines(self.path)
        self._comments = [text for _, text in lines if text.startswith("#")]
        header, *found = self._cells(
            self.path, [(number, text) for number, text in lines if text[:1] not in ("", "#")]
        )
        self._columns = [name.strip() for name in header[1]]
        for name in self._names:
            if self._columns.count(name) != 1:
                raise InputError(
                    f"{self.path} is not a worksheet of {self._run.path}: it has no column "
                    f"{name!r}, "
                    "or two of them; name another table with --out, or start again with --force",
                    file=self.path,
                    line=header[0],
                    names=(name,),
                )
        unused = list(self.sheet.rows)
        rows = [self._matched_row(unused, number, cells) for number, cells in found]
        self.left_out = tuple(row.label for row in unused)
        return rows

    def _matched_row(
        self, unused: list[SheetRow], number: int, cells: Sequence[str]
    ) -> MeasuredRow:
        """Match a row of the file with its step, and remove this step from `unused`."""
        given = dict.fromkeys(self._columns, "") | dict(zip(self._columns, cells, strict=False))
        for planned in unused:
            stated = dict(zip(self._names, planned.given, strict=False))
            if len(cells) <= len(self._columns) and all(
                _same_cell(given[name], text) for name, text in stated.items()
            ):
                unused.remove(planned)
                row = self._row(planned, given)
                filled = [name for name in row.columns if given[name].strip()]
                if filled and not row.complete:
                    text = "is only partly filled in; fill in or empty the whole row"
                    label = planned.label
                    raise _line_error(self.path, number, f"{label} {text}", label)
                return row
        raise _line_error(
            self.path,
            number,
            f"{','.join(cells)[:60]!r} is not a row of the worksheet of {self._run.path}; correct "
            "it, name another table with --out, or start again with --force",
        )

    def _read_single_readings(self) -> None:
        """Read the single readings, and add a missing mean if the readings are complete."""
        if not self._readings_path.exists():
            return
        path, by_label = self._readings_path, {row.planned.label: row for row in self.rows}
        lines = [(number, text) for number, text in self._lines(path) if text]
        header, *found = self._cells(path, lines)
        for number, cells in found:
            one = dict(zip(header[1], cells, strict=False))
            row = by_label.get(one.get(_STEP, ""))
            try:
                if row is None:
                    raise ValueError
                row.readings.append({name: float(one[name]) for name in row.columns})
            except (KeyError, ValueError):
                raise _line_error(
                    path,
                    number,
                    f"this reading belongs to no row of {self.path}; remove the line, or start "
                    "again with --force",
                ) from None
        for row in self.rows:
            if not row.complete and len(row.readings) >= self._count:
                self._fill(row)

    def _lines(self, path: Path) -> list[tuple[int, str]]:
        """Return the numbered lines of a file, without trailing spaces."""
        try:
            text = read_small_file(path, "table").decode("utf-8-sig")
        except UnicodeDecodeError:
            raise InputError(
                f"{path} is not UTF-8 text; name another table with --out", file=path
            ) from None
        return [(k, line.strip()) for k, line in enumerate(text.splitlines(), start=1)]

    def _cells(self, path: Path, lines: Sequence[tuple[int, str]]) -> list[tuple[int, list[str]]]:
        """Return the cells in lines; if there are no lines, return an empty header."""
        try:
            found = [(number, next(csv.reader([text]))) for number, text in lines]
        except csv.Error as error:
            raise InputError(
                f"{path} is not a table: {error}; name another table with --out", file=path
            ) from None
        return found or [(1, [])]

    def _write_table(self) -> None:
        rows = [[row.cells[name] for name in self._columns] for row in self.rows]
        comments = "".join(f"{text}\n" for text in self._comments)
        write_text(self.path, comments + rows_as_csv([self._columns, *rows]))

    def _write_readings(self) -> None:
        names = list(dict.fromkeys(name for row in self.rows for name in row.columns))
        lines = [[_STEP, _NUMBER, *names]]
        for row in self.rows:
            for k, one in enumerate(row.readings, start=1):
                cells = [repr(one[name]) if name in one else "" for name in names]
                lines.append([row.planned.label, str(k), *cells])
        write_text(self._readings_path, rows_as_csv(lines))


def _line_error(path: Path, line: int, text: str, *names: str) -> InputError:
    return InputError(f"{path} line {line}: {text}", file=path, line=line, names=names)


@contextmanager
def _unchanged_on_failure(row: MeasuredRow) -> Generator[None]:
    """Restore a row if its change cannot be stored."""
    before = row.cells, row.readings
    try:
        yield
    except BaseException:
        row.cells, row.readings = before
        raise


def _same_cell(found: str, stated: str) -> bool:
    """Return whether two cells agree; a spreadsheet may write 30 as 30.0."""
    if found.strip() == stated:
        return True
    try:
        return float(found) == float(stated)
    except ValueError:
        return False
