"""Text as loggers and spreadsheets write it: lines above the table, and what misled readers."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.program import run_program
from tests.refusals import refused

from inercal.pipeline import calibrate
from inercal.recordings.io.read import Columns, read_recording, read_table
from inercal.runfile import read

ROOT = Path(__file__).parents[2]
N = 60
LINES = [f"{k / 100},{k % 7},{k % 5}" for k in range(N)]
TABLE = "\n".join(["t,x,y", *LINES]) + "\n"
COLUMNS = Columns((("x", "x", "g"), ("y", "y", "g")), time="t")
PREAMBLES: dict[str, tuple[str, str]] = {
    "settings": ("Logger 7 v1.2\nserial,417\nstarted,2026-11-25,14:00\nrate,100,Hz\n\n", TABLE),
    "a title": ("A title\n", TABLE),
    "a title as wide as the table": ("Logger 7,,,\nserial 4\n", TABLE),
    "words as wide": ("one\nDevice,IMU,7\nrange,16,g\n", TABLE),
    "other separator": ("device;IMU 7\nrate;100\n", TABLE),
    "tabs": ("device,IMU 7\nrate,100\n", TABLE.replace(",", "\t")),
    "semicolons": ("device,IMU 7\n", TABLE.replace(",", ";").replace(".", ",")),
    "spaces": ("IMU\nrecorded by hand in the laboratory\n", TABLE.replace(",", "  ")),
    "sep": ("sep=,\n", TABLE),
    "sep of another": ("SEP=;\n", TABLE.replace(",", ";").replace(".", ",")),
    "sep and settings": ("sep=,\nserial,417\n", TABLE),
    "comments": ("% one\n% two, with words\n", TABLE),
    "comments before settings": ("# one\nserial,417\n", TABLE),
    "words": ("LogMyIMU\nstarted\n", TABLE),
    "words above semicolons": ("LogMyIMU\nstarted\n", TABLE.replace(",", ";")),
    "words above tabs": ("LogMyIMU\nstarted\n", TABLE.replace(",", "\t")),
    "words above spaces": ("LogMyIMU\nstarted\n", TABLE.replace(",", " ")),
    "as many words as a line": ("Log my IMU\nstarted at noon\n", TABLE.replace(",", "; ")),
}


@pytest.mark.parametrize("name", PREAMBLES)
@pytest.mark.parametrize("mark", ["", "\ufeff"])
@pytest.mark.parametrize("ending", ["\n", "\r\n"])
def test_the_header_is_found_below_lines_of_the_logger(
    tmp_path: Path, name: str, mark: str, ending: str
):
    before, table = PREAMBLES[name]
    path = tmp_path / "log.csv"
    path.write_bytes((mark + before + table).replace("\n", ending).encode())
    found = read_recording(path, COLUMNS)
    np.testing.assert_allclose(found.time, np.arange(N) / 100)
    assert found.data.tolist() == [[k % 7, k % 5] for k in range(N)]
    assert found.first_row == before.count("\n") + 2


@pytest.mark.parametrize("separator", [",", ";", "\t"])
def test_names_with_blanks_and_units_are_found_below_words(tmp_path: Path, separator: str):
    path = tmp_path / "log.csv"
    names = ("millis", "aX (g)", "bat V")
    rows = [f"{k},{k / 8},4.1".replace(",", separator) for k in range(N)]
    path.write_text("\n".join(["LogMyIMU", "started", separator.join(names), *rows]))
    found = read_table(path)
    assert found.names == names
    assert found.columns["aX (g)"].tolist() == [k / 8 for k in range(N)]


@pytest.mark.parametrize("first", ["volts", "free\nfall", "1.5"])
def test_a_file_of_one_column_keeps_it(tmp_path: Path, first: str):
    path = tmp_path / "log.csv"
    path.write_text("\n".join([first, *(str(k / 8) for k in range(N))]))
    assert len(read_table(path).names) == 1


@pytest.mark.slow
def test_the_parser_of_long_files_starts_below_them_too(tmp_path: Path):
    path = tmp_path / "log.csv"
    rows = "".join(f"{k / 100},{k % 7},{k % 5}\n" for k in range(400_000))
    path.write_text("serial,417\n\nt,x,y\n" + rows)
    found = read_recording(path, COLUMNS)
    assert found.data[-1].tolist() == [399_999 % 7, 399_999 % 5]
    assert found.first_row == 4


def test_lines_are_skipped_on_wish(tmp_path: Path):
    path = tmp_path / "log.csv"
    path.write_text("1,2,3\n4,5,6\n" + TABLE)
    with refused():
        read_recording(path, COLUMNS)
    columns = Columns(COLUMNS.channels, time="t", options={"skip": 2})
    assert read_recording(path, columns).first_row == 4
    path.write_text("\n".join(["9 9 9", *LINES]) + "\n")
    assert read_table(path, options={"skip": 1}).names == ("1", "2", "3")


@pytest.mark.parametrize(
    ("skip", "data"),
    [(-1, {"key": "[data] skip"}), (1000, {}), ("2", {"key": "[data] skip"})],
)
def test_a_skip_that_is_not_possible_is_refused(tmp_path: Path, skip: Any, data: dict[str, Any]):
    path = tmp_path / "log.csv"
    path.write_text(TABLE)
    with refused(**data):
        read_table(path, options={"skip": skip})


def changed(line: int, text: str) -> str:
    lines = TABLE.splitlines()
    lines[line - 1] = text
    return "\n".join(lines) + "\n"


COMMAS = TABLE.replace(".", ",")
MISLEADING: dict[str, tuple[bytes, dict[str, Any], str]] = {
    "decimal commas": (COMMAS.encode(), {"line": 2}, "decimal commas"),
    "decimal commas and dates": (
        ("t,x,y\n" + "2026-11-23 03:10:09,0,17,-0,20\n" * N).encode(),
        {"line": 2},
        "decimal commas",
    ),
    "dates of another form": (
        "\n".join(["t,x,y", *(f"23.11.2026 03:10:{k % 60:02}.5,1,2" for k in range(N))]).encode(),
        {"names": ("t",)},
        "ISO 8601",
    ),
    "quoted decimal commas": (
        "\n".join(["t,x,y", *(f'{k / 100},"{k},5",{k}' for k in range(N))]).encode(),
        {"names": ("x",)},
        "decimal point",
    ),
    "error of a sheet": (changed(9, "0.07,#DIV/0!,2").encode(), {"line": 9}, "#DIV/0!"),
    "error at the end": (changed(9, "0.07,1,#N/A").encode(), {"line": 9}, "#N/A"),
    "error in the first row": (changed(2, "0.00,#VALUE!,2").encode(), {"line": 2}, "#VALUE!"),
    "error among words": (changed(9, '0.07,"#REF!",2').encode(), {"line": 9}, "#REF!"),
    "far too large": (changed(9, "0.07,1e300,2").encode(), {"line": 9}, "1e+100"),
    "far too large a time": (changed(9, "1e300,1,2").encode(), {"line": 9}, "1e+100"),
    "commas": (changed(9, ",,").encode(), {"line": 9}, "line 9"),
    "commas after blank lines": (
        changed(9, "\n\n,,").encode(),
        {"line": 11},
        "line 11",
    ),
    "utf-16": (TABLE.encode("utf-16"), {}, "UTF-16"),
    "utf-16 without mark": (TABLE.encode("utf-16-le"), {}, "UTF-16"),
    "utf-16 big": (TABLE.encode("utf-16-be"), {}, "UTF-16"),
    "latin-1": (changed(1, "t,x,y °").encode("latin-1"), {"line": 1}, "UTF-8"),
}


@pytest.mark.parametrize("name", MISLEADING)
def test_what_misleads_is_named_by_its_cause(tmp_path: Path, name: str):
    content, data, word = MISLEADING[name]
    path = tmp_path / "log.csv"
    path.write_bytes(content)
    with refused(file="log.csv", **data) as caught:
        read_recording(path, COLUMNS)
    assert word in str(caught.value)
    assert len(str(caught.value)) < 250


def test_the_verb_says_the_same_in_one_line_with_status_2(tmp_path: Path):
    run = tmp_path / "run.toml"
    text = (
        '[sensor.accelerometer]\nunit = "g"\n[bench]\ngravity = "9.81 m/s²"\n[data]\n'
        'file = "log.csv"\ntime = "t"\naccelerometer = ["x", "y", "z"]\n[method]\n'
        'name = "six_position"\n'
    )
    (tmp_path / "log.csv").write_text(
        "t,x,y,z\n" + "".join(f"{k / 100},1e300,{k % 5},0\n" for k in range(200))
    )
    for raw, word in (
        (text.encode(), "1e+100"),
        (text.encode("utf-8-sig"), "1e+100"),
        (text.encode("utf-16"), "UTF-16"),
        (text.encode("latin-1"), "UTF-8"),
    ):
        run.write_bytes(raw)
        done = run_program("calibrate", run, "--no-report", "--out", tmp_path)
        assert (done.status, done.output) == (2, "")
        assert word in done.error


def test_a_row_of_means_after_blank_lines_is_named_by_its_line(tmp_path: Path):
    example = ROOT / "examples" / "six_position"
    lines = (example / "positions.csv").read_text(encoding="utf-8").splitlines()
    lines[3:3] = ["", "", "", ",,,"]
    (tmp_path / "positions.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
    (tmp_path / "run.toml").write_bytes((example / "run.toml").read_bytes())
    with refused(line=7) as caught:
        calibrate(tmp_path / "run.toml")
    assert "line 7" in str(caught.value)


def test_a_run_file_with_the_mark_of_windows_is_read(tmp_path: Path):
    text = (ROOT / "examples" / "six_position" / "run.toml").read_text(encoding="utf-8")
    path = tmp_path / "run.toml"
    path.write_text(text, encoding="utf-8-sig")
    assert read(path).method.name == "six_position"
