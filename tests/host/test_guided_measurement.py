"""A worksheet filled position by position: typed, piped, undone, left, killed and gone on with."""

import csv
import json
import os
import pty
import signal
import subprocess
import sys
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
from tests.base_seeds import chosen
from tests.host.guided_runs import LABELS, Terminal, lines, measure, readings, six_positions
from tests.program import run_program
from tests.refusals import refused

from inercal.basics.errors import InputError
from inercal.host.guided import measurement_table
from inercal.host.guided.measurement_table import MeasurementTable
from inercal.pipeline import calibrate
from inercal.runfile import read


@pytest.fixture
def run_file(tmp_path: Path) -> Path:
    return six_positions(tmp_path)


def sheet(run_file: Path) -> Path:
    return run_file.with_name("sheet.csv")


def cells(path: Path) -> list[list[str]]:
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.reader(file))


def test_the_table_it_leaves_gives_a_verdict_and_the_coefficients(run_file: Path):
    done = measure(run_file, given=lines(readings(run_file)))
    assert (done.status, done.error) == (0, "")
    assert done.output.endswith(f"next: inercal calibrate {run_file}\n")
    assert [row[0] for row in cells(sheet(run_file))] == ["position", *LABELS]
    outcome = calibrate(run_file)
    assert outcome.verdict.grade == "consistent"
    truth = read(run_file).truth
    calibration = outcome.calibration
    for name, value in zip(calibration.sensor.coefficients, calibration.values, strict=True):
        # 12 coefficients: three standard uncertainties each.
        assert abs(value - truth.get(name, 0.0)) < 3 * calibration.uncertainty(name)


def test_what_to_set_and_the_expected_reading_are_said(run_file: Path):
    told = measure(run_file, given=lines(readings(run_file))).output
    assert "[2/6] label: x_a, set to: −x up" in told
    assert "expected about ax -2.001, ay +0, az +0" in told
    assert "(expected -2.001)" in told


@pytest.mark.parametrize(
    ("count", "left"),
    chosen(
        [*((1, k) for k in range(1, 6)), *((3, k) for k in (1, 2, 3, 8, 13, 17))],
        [(1, 1), (1, 5), (3, 2), (3, 8)],
    ),
)
def test_a_measurement_left_anywhere_ends_as_the_unbroken_one(
    run_file: Path, tmp_path: Path, count: int, left: int
):
    given = lines(readings(run_file, count=count))
    n = ("-n", str(count))
    whole = tmp_path / "whole.csv"
    assert measure(run_file, "--out", whole, *n, given=given).status == 0
    first = measure(run_file, *n, given=given[:left])
    assert first.status == 130
    assert f"inercal measure {run_file}" in first.output
    assert measure(run_file, *n, given=given[left:]).status == 0
    assert sheet(run_file).read_bytes() == whole.read_bytes()


@pytest.mark.parametrize("written", chosen(range(1, 26), (1, 2, 5, 13, 24)))
def test_a_kill_between_any_two_writes_loses_no_accepted_reading(
    run_file: Path, tmp_path: Path, written: int, monkeypatch: pytest.MonkeyPatch
):
    given = lines(readings(run_file, count=3))
    whole = tmp_path / "whole.csv"
    measure(run_file, "--out", whole, "-n", "3", given=given)

    class Killed(BaseException):
        pass

    count, write = 0, measurement_table.write_text

    def write_some(path: Path, text: str) -> Path:
        nonlocal count
        count += 1
        if count > written:
            raise Killed
        return write(path, text)

    with monkeypatch.context() as patch:
        patch.setattr(measurement_table, "write_text", write_some)
        with suppress(Killed):
            measure(run_file, "-n", "3", given=given)
    table = MeasurementTable(read(run_file), sheet(run_file), 3)
    stored = sum(len(row.readings) for row in table.rows)
    # One write for the empty table, one for each reading, one more for each mean.
    assert stored in {max(k, 0) for k in (written - 1 - table.measured, written - table.measured)}
    assert measure(run_file, "-n", "3", given=given[stored:]).status == 0
    assert sheet(run_file).read_bytes() == whole.read_bytes()


@pytest.mark.slow
def test_a_killed_terminal_goes_on_where_it_was(run_file: Path, tmp_path: Path):
    given = lines(readings(run_file))
    whole = tmp_path / "whole.csv"
    measure(run_file, "--out", whole, given=given)
    ours, theirs = pty.openpty()
    with subprocess.Popen(
        [sys.executable, "-m", "inercal", "measure", str(run_file)],
        stdin=theirs, stdout=theirs, stderr=theirs, close_fds=True,
    ) as program:  # fmt: skip
        os.close(theirs)
        told = b""
        for k in range(4):
            while b"az [V]> " not in told.rpartition(b"\n")[2]:
                told += os.read(ours, 4096)
            if k < 3:
                os.write(ours, given[k].encode())
                while f"[{k + 2}/6]".encode() not in told:
                    told += os.read(ours, 4096)
        program.send_signal(signal.SIGKILL)
    os.close(ours)
    assert program.returncode == -signal.SIGKILL
    again = measure(run_file, given=given[3:])
    assert "3 of 6 rows are measured" in again.output
    assert sheet(run_file).read_bytes() == whole.read_bytes()


def test_a_reading_that_the_disk_does_not_take_is_not_counted(
    run_file: Path, monkeypatch: pytest.MonkeyPatch
):
    given, write = lines(readings(run_file, count=2)), measurement_table.write_text
    full = [False, False, True]

    def write_to_full_disk(path: Path, text: str) -> Path:
        if full and full.pop(0):
            raise InputError(f"{path} cannot be written: No space left on device")
        return write(path, text)

    monkeypatch.setattr(measurement_table, "write_text", write_to_full_disk)
    told = measure(run_file, "-n", "2", given=[*given[:2], *given[1:]], typed=True)
    assert told.status == 0
    assert told.output.count("No space left") == 1
    single = run_file.with_name("sheet.readings.csv").read_text(encoding="utf-8").splitlines()
    assert len(single) == 1 + len(given)


class Interrupted(Terminal):
    """Somebody who presses Ctrl-C after the lines."""

    def readline(self, size: int = -1, /) -> str:
        line = super().readline(size)
        if not line:
            raise KeyboardInterrupt
        return line


def test_an_interruption_by_the_keyboard_says_how_to_go_on(
    run_file: Path, monkeypatch: pytest.MonkeyPatch
):
    given = lines(readings(run_file))
    monkeypatch.setattr("sys.stdin", Interrupted("".join(given[:2])))
    done = run_program("measure", run_file)
    assert done.status == 130
    assert f"2 of 6 rows are measured; to go on: inercal measure {run_file}" in done.error
    assert done.error.endswith("inercal: stopped\n")
    assert measure(run_file, given=given[2:]).status == 0


def test_undo_takes_back_the_last_reading_and_repeat_those_of_a_row(run_file: Path):
    good = lines(readings(run_file, count=2))
    given = [good[0], "undo\n", *good[:2], "undo\n", good[1], good[2], "repeat\n", *good[2:4]]
    given += ["repeat\n", *good[2:], "undo\n", good[-1]]
    assert measure(run_file, "-n", "2", given=given).status == 0
    undone = sheet(run_file).read_bytes()
    assert measure(run_file, "-n", "2", "--force", given=good).status == 0
    assert sheet(run_file).read_bytes() == undone
    assert sheet(run_file).with_suffix(".csv.previous").read_bytes() == undone


def test_there_is_nothing_to_take_back_at_the_begin(run_file: Path):
    done = measure(run_file, given=["undo\n"])
    assert done.status == 2
    assert "line 1" in done.error


@pytest.mark.parametrize("accepted", ["keep", "the same"])
def test_a_reading_far_from_an_ideal_sensors_is_asked_for_again(run_file: Path, accepted: str):
    good = lines(readings(run_file))
    wrong = "-2.0 0.0 0.0\n"
    corrected = measure(run_file, given=[wrong, *good])
    assert corrected.status == 0
    assert "ax reads -2, but +2.001 V is expected" in corrected.output
    assert float(cells(sheet(run_file))[1][1]) > 2
    again = "keep\n" if accepted == "keep" else wrong
    kept = measure(run_file, "--force", given=[wrong, again, *good[1:]])
    assert kept.status == 0
    assert cells(sheet(run_file))[1] == ["x_p", "-2.0", "0.0", "0.0"]


def test_a_reading_that_was_not_accepted_is_not_stored(run_file: Path):
    assert measure(run_file, given=["-2.0 0.0 0.0\n"]).status == 130
    assert cells(sheet(run_file))[1] == ["x_p", "", "", ""]


def test_piped_readings_out_of_step_end_it_and_keep_what_was_right(run_file: Path):
    good = lines(readings(run_file))
    done = measure(run_file, given=[*good[:2], *good[3:]])
    assert done.status == 2
    assert "line 4" in done.error
    assert [bool(row[1]) for row in cells(sheet(run_file))[1:]] == [True, True, *[False] * 4]


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("2.0 0.0", "2 numbers, but 3"),
        ("2,0 0,0 0,0", "6 numbers, but 3"),
        ("2.0 0.0 zero", "'zero'"),
        ("2.0 0.0 nan", "'nan'"),
        ("2.0 0.0 1e300", "'1e300'"),
        ("12.0 0.0 0.0", "full_scale"),
        ("", "0 numbers"),
        ("keep", "keep"),
    ],
)
def test_a_line_that_cannot_be_used_is_said(run_file: Path, line: str, words: str):
    good = lines(readings(run_file))
    piped = measure(run_file, given=[good[0], f"{line}\n"])
    assert piped.status == 2
    assert "standard input line 2" in piped.error
    assert words in piped.error
    # Somebody is asked again.
    typed = measure(run_file, given=[f"{line}\n", *good[1:]], typed=True)
    assert typed.status == 0
    assert words in typed.output


def test_lines_after_the_last_reading_are_not_taken(run_file: Path):
    good = lines(readings(run_file))
    assert measure(run_file, given=[*good, good[0]]).status == 2
    before = sheet(run_file).read_bytes()
    assert measure(run_file, given=[]).status == 0
    assert sheet(run_file).read_bytes() == before


def test_the_worksheet_of_plan_is_filled_in_place(run_file: Path, tmp_path: Path):
    table = sheet(run_file)
    assert run_program("plan", run_file, "--out", table).status == 0
    done = measure(table, "--json", given=lines(readings(run_file)))
    assert json.loads(done.output) == {
        "table": str(table),
        "measured": 6,
        "rows": 6,
        "complete": True,
        "next": f"next: inercal calibrate {run_file}",
    }
    assert calibrate(run_file).verdict.grade == "consistent"
    other = tmp_path / "other.csv"
    told = measure(other, "--run", run_file, given=lines(readings(run_file))).output
    assert f'[data] file = "{other.name}"' in told


def test_rows_of_another_order_remarks_and_what_is_filled_stay(run_file: Path):
    table, good = sheet(run_file), readings(run_file)
    filled = ",".join(map(str, good[4]))
    table.write_text(
        f"# on the plate\nposition,ax,ay,az,remark\nz_p,{filled},by hand\nx_a,,,,\nx_p,,,\n",
        encoding="utf-8",
    )
    done = measure(run_file, given=lines([good[1], good[0]]))
    assert done.status == 0
    assert "no row for y_p, y_a, z_a" in done.output
    text = table.read_text(encoding="utf-8")
    assert text.startswith("# on the plate\nposition,ax,ay,az,remark\n")
    assert f"z_p,{filled},by hand" in text
    assert float(cells(table)[3][1]) == good[1][0]


def test_the_scatter_is_shown_and_said_where_it_is_more_than_stated(run_file: Path):
    steady = readings(run_file, count=4)
    steady[1][0] += 0.002
    told = measure(run_file, "-n", "4", given=lines(steady)).output
    s = float(np.std([row[0] for row in steady[:4]], ddof=1))
    assert f"x_p: mean of 4: ax {np.mean([row[0] for row in steady[:4]]):.9g} (s {s:.2g}" in told
    assert told.count("more than three times [data.sd]") == 1


def test_a_column_of_temperature_is_asked_for_too(tmp_path: Path):
    path = six_positions(tmp_path, ("[data.sd]", 'temperature = "T"\n[data.sd]'))
    good = readings(path)
    assert measure(path, given=lines([*row, 23.5] for row in good)).status == 0
    assert cells(sheet(path))[0] == ["position", "ax", "ay", "az", "T"]
    assert calibrate(path).verdict.grade == "consistent"


HAND = 'kind = "means"'
HEAD = Path(__file__).parents[2] / "examples" / "turntable" / "mimu.toml"


@pytest.mark.parametrize(
    ("changes", "options", "where"),
    [
        ([(HAND, 'kind = "recording"')], (), "[data] sd"),
        (
            [(HAND, 'kind = "recording"'), ('[data.sd]\naccelerometer = "20 µg"', "")],
            (),
            "[data] kind",
        ),
        ([('[data.sd]\naccelerometer = "20 µg"', "")], (), "[data.sd] accelerometer"),
        ([('label = "position"\n', "")], (), "[data] label"),
        ([('file = "sheet.csv"', 'file = "sheet.xlsx"')], (), "[data] file"),
        ([('"ax", "ay"', '"ax", "ax"')], (), "'ax'"),
        ([('"ax", "ay", "az"', "2, 3, 4")], (), "by its number"),
        ([], ("--out", "sheet.txt"), "--out"),
        ([], ("--run", "run.toml"), "--run"),
        ([], ("--readings", "0"), "--readings"),
        ([], ("--instrument", "gpib:7"), "gpib:7"),
        ([], ("--instrument", "tcp://127.0.0.1:1"), "tcp://127.0.0.1:1"),
        ([], ("--instrument", "serial:/dev/no-such-port"), "/dev/no-such-port"),
    ],
)
def test_what_cannot_be_measured_is_one_line_and_nothing_is_written(
    tmp_path: Path, changes: list[tuple[str, str]], options: tuple[str, ...], where: str
):
    path = six_positions(tmp_path, *changes)
    done = measure(path, *options, given=["1 2 3\n"])
    assert (done.status, done.output) == (2, "")
    assert where in done.error
    assert [one.name for one in tmp_path.iterdir()] == ["run.toml"]


@pytest.mark.parametrize(
    ("text", "where"),
    [
        ("", "'position'"),
        ("position,ax,ay\n", "'az'"),
        ("position;ax;ay;az\nx_p;;;\n", "'position'"),
        ("position,ax,ay,az\nq_p,,,\n", "line 2"),
        ("position,ax,ay,az\nx_p,,,\nx_p,,,\n", "line 3"),
        ("position,ax,ay,az\nx_p,1.0,,\n", "line 2"),
        ("position,ax,ay,az\nx_p,,,,,\n", "line 2"),
        ("\xff\xfe", "UTF-8"),
    ],
)
def test_a_table_of_something_else_stays_as_it_is(run_file: Path, text: str, where: str):
    table = sheet(run_file)
    table.write_bytes(text.encode("latin-1"))
    done = measure(run_file, given=lines(readings(run_file)))
    assert done.status == 2
    assert where in done.error
    assert table.read_bytes() == text.encode("latin-1")


def test_inputs_and_devices_are_not_written_over(run_file: Path, tmp_path: Path):
    before = run_file.read_bytes()
    (tmp_path / "own.csv").symlink_to(run_file)
    os.mkfifo(tmp_path / "fifo.csv")
    for name in ("own.csv", "fifo.csv"):
        assert measure(run_file, "--out", tmp_path / name, "--force", given=[]).status == 2
    assert run_file.read_bytes() == before


def test_single_readings_without_their_table_are_not_lost(run_file: Path):
    measure(run_file, "-n", "2", given=lines(readings(run_file, count=2))[:3])
    sheet(run_file).unlink()
    assert measure(run_file, "-n", "2", given=[]).status == 2
    damaged = run_file.with_name("sheet.readings.csv")
    with refused(InputError):
        MeasurementTable(read(run_file), sheet(run_file), 2)
    assert damaged.exists()
    assert measure(run_file, "-n", "2", "--force", given=[]).status == 130
    assert not damaged.exists()


def test_a_table_that_several_run_files_name_needs_the_run_file(run_file: Path, tmp_path: Path):
    assert measure(sheet(run_file), given=[]).status == 130
    (tmp_path / "second.toml").write_bytes(run_file.read_bytes())
    assert "--run" in measure(sheet(run_file), given=[]).error
    assert measure(tmp_path / "none.csv", given=[]).status == 2


def test_a_turntable_has_no_worksheet(tmp_path: Path):
    done = measure(HEAD, given=[])
    assert done.status == 2
    assert 'kind = "means"' in done.error or "worksheet" in done.error


def test_help_and_words_in_their_own_case(run_file: Path):
    given = lines(readings(run_file))
    done = measure(run_file, given=["help\n", given[0], "Foo\n"])
    assert all(word in done.output for word in ("undo  ", "repeat  ", "keep  ", "quit  "))
    assert "'Foo'" in done.error


def test_a_finished_table_has_no_others_that_follow(run_file: Path):
    given = lines(readings(run_file))
    assert "wrote" in measure(run_file, given=given).output
    finished = measure(run_file, given=[]).output
    assert "follow" not in finished
    assert "wrote" not in finished


def test_readings_in_si_units_are_suspected(run_file: Path):
    first, *_ = lines(readings(run_file))
    in_si = " ".join(["9.79", *first.split()[1:]])  # 2 V/g: 1 g reads 2 V
    done = measure(run_file, given=[f"{in_si}\n", "quit\n"])
    assert "is it in m/s²?" in done.output
    assert "is it in m/s²?" not in measure(run_file, given=["-2 0 0\n", "quit\n"]).output
