"""Recordings, tables of means and marks that cannot be used."""

from tests.bad_inputs.bad_input import BadInput, Change, each_row, swap

CALIBRATE = "calibrate @run.toml --out @ --no-report"
MEANS = "calibrate @means.toml --out @ --no-report"
BY_MARKS = swap('marks = "labels"\nlabel = "label"', 'marks = "m.json"')
BY_TABLE = swap('marks = "labels"\nlabel = "label"', 'marks = "m.csv"')


def named(name: str) -> Change:
    """Have the run file name another recording."""
    return swap('"log.csv"', f'"{name}"')


def other(name: str, content: Change, *words: str) -> BadInput:
    """Return a recording of another format."""
    return BadInput(CALIBRATE, (name, *words), {"run.toml": named(name), name: content})


def log(change: Change, *words: str) -> BadInput:
    """Return a log with a change."""
    return BadInput(CALIBRATE, ("log.csv", *words), {"log.csv": change})


def marks(content: str, *words: str) -> BadInput:
    return BadInput(CALIBRATE, words, {"run.toml": BY_MARKS, "m.json": content})


CASES: dict[str, BadInput] = {
    "a folder as recording": BadInput(CALIBRATE, ("folder",), {"run.toml": named(".")}),
    "a path of Windows": BadInput(
        CALIBRATE, ("C:\\data\\log.csv",), {"run.toml": swap('"log.csv"', "'C:\\data\\log.csv'")}
    ),
    "an address": BadInput(
        CALIBRATE, ("example.org/log.csv",), {"run.toml": named("https://example.org/log.csv")}
    ),
    "a zero in a name": BadInput(CALIBRATE, ("run.toml", "name"), {"run.toml": named("a\\u0000b")}),
    "a star that fits nothing": BadInput(
        CALIBRATE, ("pose_*.csv", "no file"), {"run.toml": named("pose_*.csv")}
    ),
    "the run file as recording": BadInput(
        CALIBRATE, ("run.toml line 2",), {"run.toml": named("run.toml")}
    ),
    "text as npz": other("log.npz", "time,acc_x\n1,2\n", ".npz"),
    "text as Parquet": other("log.parquet", "time,acc_x\n1,2\n", "Parquet"),
    "text as HDF5": other("log.h5", "time,acc_x\n1,2\n", "HDF5"),
    "text as workbook": other("log.xlsx", "time,acc_x\n1,2\n", "workbook"),
    "text as MCAP": other("log.mcap", "time,acc_x\n1,2\n", "bag", ".csv"),
    "text as ULog": other("log.ulg", "time,acc_x\n1,2\n", "ULog"),
    "an empty MCAP": other("log.mcap", b"", "empty"),
    "an empty ULog": other("log.ulg", b"", "empty"),
    "an empty DataFlash": other("log.bin", b"", "empty"),
    "a page of a web server": log("<!DOCTYPE html><html>404</html>\n", "HTML page"),
    "a pointer of Git LFS": log("version https://git-lfs.github.com/spec/v1\nsize 9\n", "Git LFS"),
    "commas, then semicolons": log(
        each_row(lambda k, r: r if k < 800 else [";".join(r)]), "line 802"
    ),
    "a header between tabs": log(lambda text: text.replace(",", "\t", 4), "line 2", "header"),
    "decimal commas between commas": log(
        each_row(lambda _, r: [cell.replace(".", ",") for cell in r]), "line 2", "header"
    ),
    "two labels in the header": log(swap("acc_z,label", "label,label"), "'label'"),
    "a control character in the header": log(swap("acc_x", "acc\x1b[31m_x"), "'acc_x'"),
    "the header again": log(
        each_row(lambda k, r: ["time", "acc_x", "acc_y", "acc_z", "label"] if k == 700 else r),
        "line 702",
    ),
    "a line of words": log(
        each_row(lambda k, r: ["--- logger restarted ---"] if k == 700 else r), "line 702"
    ),
    "all channels constant": log(
        each_row(lambda _, r: [r[0], "0", "0", "1", r[4]]), "ax (column acc_x) reads 0 throughout"
    ),
    "one row": log(lambda text: "\n".join(text.splitlines()[:2]), "one sample"),
    "integers of 30 digits": log(each_row(lambda _, r: [r[0], "9" * 30, *r[2:]]), "reads 1e+30"),
    "dates": log(each_row(lambda _, r: ["2026-11-25", *r[1:]]), "'time'", "2026-11-25"),
    "times of the day that fall": log(
        each_row(lambda k, r: [f"10:{59 - k // 60:02d}:{k % 60:02d}", *r[1:]]), "decreases"
    ),
    "days of a spreadsheet": log(
        each_row(lambda _, r: [repr(45000 + float(r[0]) / 86400), *r[1:]]), "'time'", "time_unit"
    ),
    "nanoseconds since 1970": log(
        each_row(lambda _, r: [str(int(1.7e18 + float(r[0]) * 1e9)), *r[1:]]), 'time_unit = "ns"'
    ),
    "s, then ms": log(
        each_row(lambda k, r: [repr(float(r[0]) * (1000 if k > 900 else 1)), *r[1:]]),
        "sample 900",
        "unit",
    ),
    "falling time": log(
        each_row(lambda _, r: [repr(-float(r[0])), *r[1:]]), "time decreases", "line 3"
    ),
    "units in the cells": log(each_row(lambda _, r: [r[0], r[1] + " g", *r[2:]]), "'acc_x'"),
    "hexadecimal numbers": log(each_row(lambda k, r: [r[0], hex(k), *r[2:]]), "'acc_x'", "0x0"),
    "milli-g as g": log(
        each_row(lambda _, r: [r[0], *(repr(1e3 * float(x)) for x in r[1:4]), r[4]]),
        'unit = "mg"',
    ),
    "labels of nothing": log(each_row(lambda _, r: [*r[:4], "north"]), "x_p", "north"),
    "a label to each row": log(each_row(lambda k, r: [*r[:4], str(k)]), "x_p", "1688 more"),
    "a text of marks": marks("", "m.json", "JSON"),
    "marks in a list": marks("[[0, 100]]", "m.json", "object"),
    "a mark backwards": marks('{"x_p": {"start": 200, "end": 10}}', "mark x_p", "200 to 10"),
    "a mark before the first sample": marks('{"x_p": {"start": -5, "end": 100}}', "mark x_p", "-5"),
    "a mark between samples": marks('{"x_p": {"start": 1.5, "end": 100}}', "m.json", "'x_p'"),
    "a mark of truth values": marks('{"x_p": {"start": true, "end": 100}}', "m.json", "'x_p'"),
    "a mark without its end": marks('{"x_p": {"start": 1}}', "m.json", "'x_p'", "'end'"),
    "a mark twice": marks(
        '{"x_p": {"start": 0, "end": 9}, "x_p": {"start": 20, "end": 90}}', "m.json", "'x_p'"
    ),
    "marks of words": BadInput(
        CALIBRATE, ("m.csv", "'x_p'"), {"run.toml": BY_TABLE, "m.csv": "label,start,end\nx_p,a,9\n"}
    ),
    "marks without rows": BadInput(
        CALIBRATE, ("m.csv", "no data"), {"run.toml": BY_TABLE, "m.csv": "label,start,end\n"}
    ),
    "the log as marks": BadInput(
        CALIBRATE,
        ("log.csv", "'start'"),
        {"run.toml": swap('marks = "labels"', 'marks = "log.csv"')},
    ),
    "a position twice": BadInput(
        MEANS,
        ("positions.csv", "'z_a'"),
        {"positions.csv": lambda text: text + text.splitlines()[-1]},
    ),
    "a position of no plan": BadInput(
        MEANS, ("positions.csv", "'up'"), {"positions.csv": swap("x_p", "up")}
    ),
    "a mean of letters": BadInput(
        MEANS, ("positions.csv line 3", "'acc_x'"), {"positions.csv": swap("x_p,", "x_p,abc")}
    ),
}
