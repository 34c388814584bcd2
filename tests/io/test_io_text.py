"""Text files that are right, in all the ways that loggers and spreadsheets write them."""

import hashlib
from pathlib import Path

import numpy as np
import pytest
from tests.refusals import refused

from inercal.recordings.io.read import read_table

NUMBERS = [[0.0, 1.5], [0.1, -2.5e-3], [0.2, 3.25]]


@pytest.mark.parametrize(
    ("text", "names"),
    [
        ("t,x\n0,1.5\n0.1,-2.5e-3\n0.2,3.25\n", ("t", "x")),
        ("t,x\r\n0,1.5\r\n0.1,-2.5e-3\r\n0.2,3.25\r\n", ("t", "x")),
        ("t,x\r0,1.5\r0.1,-2.5e-3\r0.2,3.25\r", ("t", "x")),
        ("\ufefft,x\n0,1.5\n0.1,-2.5e-3\n0.2,3.25", ("t", "x")),
        ('"t";"x"\n0;1,5\n0,1;-2,5e-3\n0,2;3,25\n', ("t", "x")),
        ("t;x\n0;1.5\n0.1;-2.5e-3\n0.2;3.25\n", ("t", "x")),
        ("t\tx\n0\t1,5\n0,1\t-2,5e-3\n0,2\t3,25\n", ("t", "x")),
        ("t\tx, m/s²\n0\t1.5\n0.1\t-2.5e-3\n0.2\t3.25\n", ("t", "x, m/s²")),
        ("  0.0e+00  1.5\n 1e-1 -2.5e-3\n 2e-1   3.25\n", ("1", "2")),
        ("0 , 1.5 \n0.1 , -2.5e-3\n0.2 , 3.25\n\n\n", ("1", "2")),
        ("# logger 7\n# 2024\nt,x\n0,1.5\n0.1,-2.5e-3\n0.2,3.25\n", ("t", "x")),
        ("# t x\n0 1.5\n0.1 -2.5e-3\n0.2 3.25\n", ("t", "x")),
        ("% MATLAB\n0 1.5 % start\n0.1 -2.5e-3\n0.2 3.25\n", ("1", "2")),
        (",x\n0,1.5\n0.1,-2.5e-3\n0.2,3.25\n", ("1", "x")),
    ],
)
def test_layouts_are_recognised_from_the_first_lines(
    tmp_path: Path, text: str, names: tuple[str, ...]
):
    path = tmp_path / "log.csv"
    path.write_bytes(text.encode())
    table = read_table(path)
    assert table.names == names
    np.testing.assert_array_equal(np.stack([table.numbers(n) for n in names], -1), NUMBERS)
    assert table.sha256 == hashlib.sha256(text.encode()).hexdigest()


def test_a_column_of_words_is_labels_and_quotes_protect_them(tmp_path: Path):
    path = tmp_path / "log.csv"
    path.write_text('part,x\n"down # 2",1\n"up, slow",2\n"",3\n')
    table = read_table(path)
    assert table.columns["part"].tolist() == ["down # 2", "up, slow", ""]
    assert table.numbers("x").tolist() == [1, 2, 3]


def test_a_quotation_mark_left_open_does_not_swallow_rows(tmp_path: Path):
    path = tmp_path / "log.csv"
    path.write_text('part,x\n"a",1\n"a,2\n"b",3\nb,4\n')
    for wanted in (["x"], ["part", "x"]):
        with refused(file="log.csv"):
            read_table(path, wanted=wanted)
    path.write_text('part,x\n"a",1\n"a,2\nb"c,3\nb,4\n')
    with refused(file="log.csv", line=None, names=()):
        read_table(path, wanted=["x"])


def test_labels_that_look_like_numbers_are_text_on_wish(tmp_path: Path):
    path = tmp_path / "log.csv"
    path.write_text("part,x\n01,1\n2,2\nend,3\n")
    assert read_table(path, text=["part"]).columns["part"].tolist() == ["01", "2", "end"]


def test_a_file_without_a_header_may_begin_with_labels(tmp_path: Path):
    path = tmp_path / "log.txt"
    path.write_text("up 1 2\nup 3 4\n")
    table = read_table(path)
    assert (table.header, table.first_line) == (False, 1)
    assert table.columns["1"].tolist() == ["up", "up"]


def test_words_in_columns_that_nobody_wants_do_no_harm(tmp_path: Path):
    path = tmp_path / "log.csv"
    path.write_text("x,state\n1,4\n2,ERR\n")
    assert read_table(path, wanted=["x"]).columns["x"].tolist() == [1, 2]
    with refused(file="log.csv", line=3, names=["state"]):
        read_table(path)


def test_empty_cells_are_missing_numbers_and_empty_labels(tmp_path: Path):
    path = tmp_path / "log.csv"
    path.write_text("part,x,T\na,1,20\n,2,\nb,,21\n")
    table = read_table(path)
    np.testing.assert_array_equal(table.numbers("x"), [1, 2, np.nan])
    np.testing.assert_array_equal(table.numbers("T"), [20, np.nan, 21])
    assert table.columns["part"].tolist() == ["a", "", "b"]


def test_rows_keep_their_line_numbers_unless_comments_stand_between(tmp_path: Path):
    path = tmp_path / "log.csv"
    path.write_text("# one\n\nt,x\n0,1\n1,2\n\n")
    assert read_table(path).first_line == 4
    path.write_text("t,x\n0,1\n# pause\n1,2\n")
    table = read_table(path)
    assert table.first_line == 0
    assert table.numbers("x").tolist() == [1, 2]


@pytest.mark.parametrize(("row", "column"), [(2, 2), (7, 0), (7, 1), (7, 2)])
@pytest.mark.parametrize("separator", [",", ";", "\t", " ", "|"])
@pytest.mark.parametrize("cell", ["1.#QNAN", "-1.#IND", "1.#INF00", "#WERT!", "#NV", "#N/A"])
def test_an_error_value_is_refused_in_each_column(
    tmp_path: Path, cell: str, separator: str, row: int, column: int
):
    rows = [["t", "x", "y"], *([str(k / 10), "0.5", "-1.5"] for k in range(9))]
    rows[row - 1][column] = cell
    path = tmp_path / "log.csv"
    path.write_text("\n".join(map(separator.join, rows)) + "\n")
    with refused(file="log.csv", line=row) as caught:
        read_table(path)
    assert f"column '{'txy'[column]}': {cell!r} is " in str(caught.value)


def test_real_files_are_read_whole(data_dir: Path):
    annotated = read_table(data_dir / "ferraris_imucal" / "annotated_session.csv")
    assert annotated.columns["part"].shape == (9414,)
    assert annotated.columns["part"][-1] == "z_rot"
    assert read_table(data_dir / "mpu9150_multiposition" / "imu0.log").names == tuple("123456")
    xsens = read_table(data_dir / "xsens_mti_multiposition" / "xsens_acc.mat")
    assert xsens.numbers("2").shape == (51175,)
    assert xsens.numbers("1")[0] == 2.984e-2


@pytest.mark.parametrize("cut", ["-", "1,5e-"])
def test_a_file_cut_within_its_last_number_may_be_truncated(tmp_path: Path, cut: str):
    rows = [f"{k},0;1,5;-0,25" for k in range(8)]
    path = tmp_path / "log.csv"
    for line, text in ((10, [*rows, f"8,0;1,5;{cut}"]), (9, [*rows[1:], f"8,0;1,5;{cut}", *rows])):
        path.write_text("\n".join(["t;x;y", *text]), encoding="utf-8")
        with refused(line=line, names=("y",)) as refusal:
            read_table(path, ["t", "x", "y"])
        assert ("truncated" in str(refusal.value)) == (line == 10)
