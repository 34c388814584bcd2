"""Rows with words in them, rows of units, and lines above a table that a spreadsheet padded."""

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest
from tests.refusals import refused

from inercal.recordings.io.read import read_table

N = 70
NUMBERS = np.round(np.random.default_rng(5).normal(size=(N, 6)) * 9, 3)
NAMES = ("ax", "ay", "az", "gx", "gy", "gz")
PLAIN = tuple("123456")


def joined(separator: str) -> Callable[[Sequence[float]], str]:
    return lambda row: separator.join(map(str, row))


def named(between: str, separator: str) -> Callable[[Sequence[float]], str]:
    return lambda row: separator.join(
        f"{name}{between}{x}" for name, x in zip(NAMES, row, strict=True)
    )


def arrived(inner: Callable[[Sequence[float]], str], form: str) -> Callable[[Sequence[float]], str]:
    return lambda row: form.format(f"10:11:{abs(row[0]):06.3f}") + inner(row)


def two_groups(row: Sequence[float]) -> str:
    return f"acc: {joined(' ')(row[:3])} gyr: {joined(' ')(row[3:])}"


GROUPS = ("acc_x", "acc_y", "acc_z", "gyr_x", "gyr_y", "gyr_z")
FORMS: dict[str, tuple[str, Callable[[Sequence[float]], str], tuple[str, ...]]] = {
    "serial monitor": ("", arrived(joined(","), "{} -> "), PLAIN),
    "serial monitor, tabs": ("", arrived(joined("\t"), "{} -> "), PLAIN),
    "brackets": ("", arrived(joined(" "), "[{}] "), PLAIN),
    "serial monitor with a header": (
        "10:11:22.9 -> " + ",".join(NAMES) + "\n",
        arrived(joined(","), "{} -> "),
        NAMES,
    ),
    "plotter, commas": ("", named(":", ","), NAMES),
    "plotter, comma and space": ("", named(": ", ", "), NAMES),
    "plotter, spaces": ("", named(":", " "), NAMES),
    "plotter, tabs": ("", named(":", "\t"), NAMES),
    "equals signs": ("", named("=", ";"), NAMES),
    "plotter in the monitor": ("", arrived(named(":", " "), "{} -> "), NAMES),
    "plotter below prose": ("Calibrating...\nrate: 100\n", named(":", ","), NAMES),
    "groups": ("", two_groups, GROUPS),
    "prefix": ("", lambda row: "a/g:\t" + joined("\t")(row), PLAIN),
    "prefix, spaces": ("", lambda row: "a/g: " + joined(" ")(row), PLAIN),
    "prefix below prose": (
        "Initializing...\nTesting device connections...\nMPU6050 connection successful\n",
        lambda row: "a/g:\t" + joined("\t")(row),
        PLAIN,
    ),
    "prefix below a header": (
        "\t".join(NAMES) + "\n",
        lambda row: "a/g:\t" + joined("\t")(row),
        NAMES,
    ),
    "numbers below prose": ("Initializing I2C...\nsensor found\n", joined(","), PLAIN),
    "comments of C": ("// a title\n// ax ay\n", joined(","), PLAIN),
    "units below the header": (
        ",".join(NAMES) + "\nm/s^2,m/s^2,m/s^2,deg/s,deg/s,deg/s\n",
        joined(","),
        NAMES,
    ),
    "units in brackets": (
        "\t".join(NAMES) + "\n(g)\t(g)\t(g)\t(dps)\t(dps)\t(dps)\n",
        joined("\t"),
        NAMES,
    ),
    "device, names, kinds and units": (
        "IMU\tIMU\tIMU\tIMU\tIMU\tIMU\n" + "\t".join(NAMES) + "\nCAL\tCAL\tCAL\tRAW\tRAW\tRAW\n"
        "m/(s^2)\tm/(s^2)\tm/(s^2)\tno units\tno units\tno units\n",
        joined("\t"),
        NAMES,
    ),
    "padded": (
        "sep=,\ntag:,sensor A,,,,\nrate,60,,,,\n,,,,,\nwith (mag),,,,,\n" + ",".join(NAMES) + "\n",
        joined(","),
        NAMES,
    ),
    "padded, with units": (
        "tag;A;;;;\n;;;;;\n" + ";".join(NAMES) + "\ng;g;g;dps;dps;dps\n",
        joined(";"),
        NAMES,
    ),
    "quoted separator": ('"sep=\t"\n' + "\t".join(NAMES) + "\n", joined("\t"), NAMES),
}


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("ending", ["\n", "\r\n"])
def test_rows_are_read_without_their_words(tmp_path: Path, form: str, ending: str):
    before, write, names = FORMS[form]
    path = tmp_path / "log.txt"
    text = before + "".join(write(row) + "\n" for row in NUMBERS.tolist())
    path.write_bytes(text.replace("\n", ending).encode())
    table = read_table(path)
    assert table.names == names
    for k, name in enumerate(names):
        assert table.numbers(name).tolist() == NUMBERS[:, k].tolist()
    assert table.line(0) == before.count("\n") + 1


def test_a_row_with_other_words_is_refused_by_its_line(tmp_path: Path):
    path = tmp_path / "log.txt"
    rows = [named(":", ",")(row) for row in NUMBERS.tolist()]
    for wrong in ("bx" + rows[60][2:], rows[60].rpartition(",")[0], "restarted"):
        path.write_text("\n".join([*rows[:60], wrong, *rows[61:]]) + "\n", encoding="utf-8")
        with refused(file="log.txt", line=61):
            read_table(path)


@pytest.mark.parametrize("rows", [30, N])
def test_a_last_row_that_is_cut_off_is_refused_by_its_line(tmp_path: Path, rows: int):
    for before, write, _ in FORMS.values():
        lines = [write(row) for row in NUMBERS[:rows].tolist()]
        cut = lines[-1][: len(lines[-1]) // 2]
        path = tmp_path / "log.txt"
        path.write_text(before + "\n".join([*lines[:-1], cut]), encoding="utf-8")
        with refused(file="log.txt", line=before.count("\n") + rows):
            read_table(path)


@pytest.mark.parametrize("names", ["ax,ay,az", "t x y a b c", "time", "1,2,3\n4,5,6\nax,ay,az"])
def test_a_header_that_does_not_fit_is_not_taken_for_prose(tmp_path: Path, names: str):
    path = tmp_path / "log.csv"
    rows = "\n".join(joined(",")(row) for row in NUMBERS.tolist())
    path.write_text(f"{names}\n{rows}\n", encoding="utf-8")
    with refused(file="log.csv"):
        read_table(path)


def test_a_column_of_words_that_change_stays_a_column(tmp_path: Path):
    path = tmp_path / "log.csv"
    rows = [f"p{k // 10},10:11:{k % 60:02d},{x}" for k, x in enumerate(NUMBERS[:, 0])]
    path.write_text("\n".join(["pose,clock,x", *rows]) + "\n", encoding="utf-8")
    table = read_table(path)
    assert table.names == ("pose", "clock", "x")
    assert table.columns["clock"][1] == "10:11:01"
