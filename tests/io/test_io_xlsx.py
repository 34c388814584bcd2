"""Excel workbooks: the table is found below titles; wrong cells, damage and bombs are refused."""

import sys
import zipfile
from collections.abc import Sequence
from datetime import datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.base_seeds import evidence
from tests.io.log_files import SAMPLES
from tests.io.test_io_bombs import cost
from tests.refusals import refused

from inercal.recordings.io.read import Columns, detect_reader, read_recording, read_table

openpyxl: Any = pytest.importorskip("openpyxl", reason="workbooks need the extra inercal[excel]")
HEADER = ("t", "ax", "label")
ROWS = [(k / 100, k / 3, f"p{k // 20}") for k in range(60)]


def workbook(path: Path, *sheets: Sequence[Sequence[object]]) -> Path:
    book = openpyxl.Workbook()
    book.remove(book.active)
    for k, rows in enumerate(sheets):
        sheet = book.create_sheet(f"run {k + 1}")
        for row in rows:
            sheet.append(row)
    book.save(path)
    return path


def test_numbers_are_read_with_all_digits_and_words_are_labels(tmp_path: Path):
    path = workbook(tmp_path / "a.xlsx", [HEADER, *ROWS])
    found = read_table(path, text=["label"])
    assert found.names == HEADER
    # openpyxl writes 16 digits.
    np.testing.assert_allclose(found.numbers("ax"), [row[1] for row in ROWS], rtol=1e-15)
    assert found.columns["label"].tolist() == [row[2] for row in ROWS]
    assert found.first_line == 2


def test_the_table_is_found_below_a_title_and_settings(tmp_path: Path):
    top = [["Logger 7", None], [], ["serial", 417.0], ["rate", 100.0, "Hz"], []]
    path = workbook(tmp_path / "a.xlsx", [*top, HEADER, *ROWS])
    found = read_table(path)
    assert found.names == HEADER
    assert found.first_line == 7
    assert found.numbers("t").tolist() == [row[0] for row in ROWS]


def test_a_sheet_without_names_has_numbered_columns(tmp_path: Path):
    path = workbook(tmp_path / "a.xlsx", [row[:2] for row in ROWS])
    expected = [row[1] for row in ROWS]
    np.testing.assert_allclose(read_table(path, ["2"]).numbers("2"), expected, rtol=1e-15)


def test_a_sheet_is_chosen_by_name_or_number(tmp_path: Path):
    other = [(t, -x, label) for t, x, label in ROWS]
    path = workbook(tmp_path / "a.xlsx", [HEADER, *ROWS], [HEADER, *other])
    first = read_table(path, ["ax"]).numbers("ax")
    for sheet in (2, "run 2"):
        assert (read_table(path, ["ax"], options={"sheet": sheet}).numbers("ax") == -first).all()
    for sheet in (3, 0, "run 3"):
        with refused(file=path, key="[data] sheet"):
            read_table(path, ["ax"], options={"sheet": sheet})


def test_times_of_day_are_times(tmp_path: Path):
    start = datetime(2026, 11, 25, 14, 0, 0)
    rows = [(start + timedelta(seconds=k / 4), x, label) for k, (_, x, label) in enumerate(ROWS)]
    path = workbook(tmp_path / "a.xlsx", [HEADER, *rows])
    found = read_recording(path, Columns((("ax", "ax", "g"),), time="t"))
    np.testing.assert_allclose(found.time, np.arange(60) / 4, atol=1e-9)


def test_a_recording_in_a_workbook_is_that_of_its_numbers(tmp_path: Path):
    names = ("time", "acc_x", "acc_y", "acc_z")
    rows = np.column_stack([SAMPLES.time, SAMPLES.acc]).tolist()
    path = workbook(tmp_path / "a.xlsx", [names, *rows])
    axes = tuple((f"a{k}", f"acc_{k}", "m/s²") for k in "xyz")
    found = read_recording(path, Columns(axes, time="time"))
    np.testing.assert_allclose(found.data, SAMPLES.acc.astype(float), rtol=1e-15)


@pytest.mark.parametrize(
    ("cell", "text"), [("#DIV/0!", "#DIV/0!"), ("1,5", "1,5"), ("ERR", "ERR"), (None, "")]
)
def test_a_cell_that_is_no_number_is_named_with_its_row(tmp_path: Path, cell: Any, text: str):
    rows: list[Sequence[object]] = [HEADER, *ROWS]
    rows[9] = (0.08, cell, "p0")
    path = workbook(tmp_path / "a.xlsx", rows)
    with refused(line=10, names=("ax",)) as caught:
        read_recording(path, Columns((("ax", "ax", "g"),), time="t"))
    assert text in str(caught.value)
    assert "line 10" in str(caught.value)


@pytest.mark.parametrize(
    "rows", [[], [HEADER], [["a title"]], [["a", "b", "c"], [1.0, 2.0], [1.0, 2.0, 3.0]]]
)
def test_a_sheet_without_a_table_is_refused(tmp_path: Path, rows: list[Any]):
    path = workbook(tmp_path / "a.xlsx", rows)
    with refused(file=path):
        read_table(path)


def test_a_workbook_is_recognised_whatever_its_name(tmp_path: Path):
    path = workbook(tmp_path / "session.csv", [HEADER, *ROWS])
    assert detect_reader(path).name == "xlsx"
    assert read_table(path, ["ax"]).numbers("ax").size == 60


def test_sheets_of_other_programs_are_named(tmp_path: Path):
    old = tmp_path / "a.xls"
    old.write_bytes(b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1" + bytes(600))
    with refused(file=old) as caught:
        read_table(old)
    assert ".xlsx" in str(caught.value)
    other = tmp_path / "a.ods"
    with zipfile.ZipFile(other, "w") as archive:
        archive.writestr("mimetype", "application/vnd.oasis.opendocument.spreadsheet")
    with refused(file=other) as caught:
        read_table(other)
    assert "OpenDocument" in str(caught.value)


@pytest.mark.parametrize("damage", ["cut", "no sheet", "broken", "not xml"])
def test_a_damaged_workbook_is_one_line(tmp_path: Path, damage: str):
    good = workbook(tmp_path / "good.xlsx", [HEADER, *ROWS])
    path = tmp_path / "a.xlsx"
    raw = good.read_bytes()
    if damage == "cut":
        path.write_bytes(raw[: len(raw) // 2])
    elif damage == "broken":
        path.write_bytes(raw[:1500] + bytes(50) + raw[1550:])
    else:
        with zipfile.ZipFile(good) as old, zipfile.ZipFile(path, "w") as new:
            for name in old.namelist():
                if not name.startswith("xl/worksheets/"):
                    new.writestr(name, old.read(name))
                elif damage == "not xml":
                    new.writestr(name, old.read(name)[:-200])
    with refused(file=path) as caught:
        read_table(path)
    assert str(caught.value).startswith("a.xlsx")
    assert len(str(caught.value)) < 250


def test_a_missing_library_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    path = workbook(tmp_path / "a.xlsx", [HEADER, *ROWS])
    monkeypatch.setitem(sys.modules, "openpyxl", None)
    with refused() as caught:
        read_table(path)
    assert "inercal[excel]" in str(caught.value)


def replaced(path: Path, changes: dict[str, bytes]) -> None:
    """Write a workbook of one sheet, some of its parts replaced."""
    good = workbook(path.with_suffix(".good"), [HEADER, *ROWS])
    with (
        zipfile.ZipFile(good) as old,
        zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as new,
    ):
        for name in old.namelist():
            with new.open(name, "w", force_zip64=True) as file:
                file.write(changes.get(name, old.read(name)))
                if changes.get(name) == b"":
                    for _ in range(300):
                        file.write(b" " * (1 << 23))
    good.unlink()


SHEET = b"""<?xml version="1.0"?>
<worksheet xmlns="http://schemas.openxmlformats.org/spreadsheetml/2006/main">
<dimension ref="A1:XFD1048576"/><sheetData>
<row r="1"><c r="A1"><v>1</v></c><c r="B1"><v>2</v></c></row>
<row r="1048576"><c r="A1048576"><v>3</v></c><c r="B1048576"><v>4</v></c></row>
</sheetData></worksheet>"""
LAUGHS = (
    b'<?xml version="1.0"?><!DOCTYPE l [<!ENTITY a "'
    + b"lol" * 1000
    + b'">'
    + b"".join(
        b'<!ENTITY %c "%s">' % (c, b"&%c;" % (c - 1) * 1000) for c in range(ord("b"), ord("g"))
    )
    + b"]><l>&f;</l>"
)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("part", "content", "rows"),
    [
        evidence("xl/worksheets/sheet1.xml", b"", None),
        evidence("xl/styles.xml", b"", None),
        ("xl/worksheets/sheet1.xml", SHEET, 2),
        (
            "xl/worksheets/sheet1.xml",
            SHEET.replace(b'row r="1048576"', b'row r="1000000000000"'),
            None,
        ),
        ("xl/worksheets/sheet1.xml", LAUGHS, None),
        evidence("xl/workbook.xml", LAUGHS, None),
    ],
)
def test_a_bomb_costs_little(tmp_path: Path, part: str, content: bytes, rows: int | None):
    path = tmp_path / "a.xlsx"
    replaced(path, {part: content})
    assert path.stat().st_size < 4_000_000
    assert cost(path, "1")["rows"] == rows
