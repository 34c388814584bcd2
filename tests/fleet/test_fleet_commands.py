"""`inercal fleet` as a user calls it."""

import csv
import json
import os
import random
import shutil
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import pandas
import pytest
from tests.base_seeds import chosen
from tests.fleet.lines import make_line, readings, rows_of, write_recording, write_table
from tests.program import run_program
from tests.refusals import refused

import inercal
from inercal.calibration.files import parse
from inercal.fleet import results
from inercal.fleet.latest import latest_results
from inercal.fleet.line import read_line
from inercal.fleet.station import arriving_files, calibrate_arrival, find_row, known_files
from inercal.laboratory.store import Register

pytest.importorskip("pyarrow")
ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def line(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = make_line(tmp_path_factory.mktemp("line"), 6)
    (folder / "recordings" / "S002.npz").write_bytes(b"")
    return folder


@pytest.mark.slow
def test_the_line_of_the_examples_is_calibrated_as_its_page_says(tmp_path: Path):
    folder = Path(shutil.copytree(ROOT / "examples" / "fleet", tmp_path / "fleet"))
    page = (ROOT / "docs" / "how-to" / "fleet.md").read_text(encoding="utf-8")
    assert f"```toml\n{(folder / 'run.toml').read_text(encoding='utf-8')}```" in page
    ended = run_program("fleet", "calibrate", folder)
    assert ended.status == 0
    assert ended.output.splitlines()[0] in page
    rows = rows_of(folder)
    assert [row["grade"] for row in rows] == ["consistent"] * 6
    assert [row["lot"] for row in rows] == ["L1"] * 3 + ["L2"] * 3
    # The fifth states twice the scatter of the others.
    names = rows[0]["coefficients"].split()
    u = [row["std"][names.index("ax.k0")] for row in rows]
    assert u[4] > 1.5 * max(u[:4])


@pytest.mark.slow
def test_a_line_is_calibrated_said_and_exported(line: Path, tmp_path: Path):
    first = run_program("fleet", "calibrate", line, "--json")
    assert first.status == 3  # a sensor has no result
    content = json.loads(first.output)
    assert (content["done"], content["failed"], content["kept"]) == (5, 1, 0)
    again = json.loads(run_program("fleet", "calibrate", line, "--json").output)
    assert (again["kept"], again["tasks"]) == (6, 0)
    said = json.loads(run_program("fleet", "status", line, "--json").output)
    assert said["counts"] == {"consistent": 5, "failed": 1}
    assert [one["sensors"] for one in said["reasons"]] == [["S002"]]
    for suffix in (".csv", ".parquet"):
        table = tmp_path / f"sensors{suffix}"
        assert run_program("fleet", "export", line, table).status == 0
        assert table.is_file()
    with (tmp_path / "sensors.csv").open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    assert [row["id"] for row in rows] == [f"S{k:03d}" for k in range(6)]
    bias, u = float(rows[1]["ax.k0 [µg]"]), float(rows[1]["U(ax.k0) [µg]"])
    assert abs(bias - 1e6 * readings(1)[1][0]) < 2 * u
    assert rows[2]["ax.k0 [µg]"] == ""
    assert len(pandas.read_parquet(line / results.FOLDER)) == 6


@pytest.mark.parametrize("more", [(), ("--sensor", "S001")])
def test_an_edited_export_is_only_overwritten_with_force(
    line: Path, tmp_path: Path, more: tuple[str, ...]
):
    run_program("fleet", "calibrate", line)
    path = tmp_path / "sensors.csv"
    exported = ("fleet", "export", line, path, *more)
    assert run_program(*exported).status == 0
    made = path.read_bytes()
    path.write_bytes(edited := made + b"mine\n")
    assert run_program(*exported).status == 2
    assert path.read_bytes() == edited
    assert run_program(*exported, "--force").status == 0
    assert path.read_bytes() == made


def test_the_calibration_file_of_one_sensor_is_exported(line: Path, tmp_path: Path):
    run_program("fleet", "calibrate", line)
    path = tmp_path / "one.calibration.json"
    assert run_program("fleet", "export", line, path, "--sensor", "S004").status == 0
    assert inercal.load(path).sensor.name == "S004"
    kept = path.read_bytes()
    assert run_program("fleet", "export", line, path, "--sensor", "S002").status == 2
    assert run_program("fleet", "export", line, path, "--sensor", "none").status == 2
    assert path.read_bytes() == kept


@pytest.mark.slow
def test_calibrations_are_entered_once_in_the_register(line: Path, tmp_path: Path):
    register = str(tmp_path / "register.db")
    for _ in range(2):
        ended = run_program("fleet", "calibrate", line, "--register", register, "--json")
        assert json.loads(ended.output)["entered"] == 5
    listed = json.loads(run_program("store", "list", "--register", register, "--json").output)
    assert len(listed["sensors"]) == 5


def test_a_register_is_told_what_it_has_by_hashes(line: Path, tmp_path: Path):
    run_program("fleet", "calibrate", line)
    rows = latest_results(read_line(line), line / results.FOLDER, ("calibration",)).to_pylist()
    texts = [row["calibration"] for row in rows if row["status"] == results.DONE]
    hashes = [json.loads(text)["sha256"] for text in texts]
    with Register(str(tmp_path / "r.db")) as register:
        register.enter_calibrations([parse(texts[0], "S000")])
        assert register.entered_sha256(hashes) == {hashes[0]}


def test_a_template_that_is_no_run_file_is_one_line(tmp_path: Path):
    folder = make_line(tmp_path, 1)
    text = (folder / "run.toml").read_text(encoding="utf-8")
    text = "sensor = 3\n" + text.replace('[sensor]\n[sensor.accelerometer]\nunit = "g"\n', "")
    (folder / "run.toml").write_text(text, encoding="utf-8")
    assert run_program("fleet", "calibrate", folder).status == 2


@pytest.mark.parametrize(
    "options",
    [
        ("--workers", "0"),
        ("--batch", "0"),
        ("--count", "1"),
        ("--scheduler", "here"),
        ("--watch", "no/such/folder"),
    ],
)
def test_an_option_that_is_not_possible_is_one_line(tmp_path: Path, options: tuple[str, ...]):
    folder = make_line(tmp_path, 1)
    assert run_program("fleet", "calibrate", folder, *options).status == 2
    assert not (folder / results.FOLDER).exists()


@pytest.mark.parametrize("verb", ["calibrate", "status"])
def test_a_folder_that_is_no_line_is_one_line(tmp_path: Path, verb: str):
    assert run_program("fleet", verb, tmp_path).status == 2
    assert not list(tmp_path.iterdir())


def test_a_table_that_is_not_ours_is_kept(line: Path, tmp_path: Path):
    path = tmp_path / "table.csv"
    path.write_text("mine\n1\n", encoding="utf-8")
    assert run_program("fleet", "export", line, path).status == 2
    assert path.read_text(encoding="utf-8") == "mine\n1\n"
    assert run_program("fleet", "export", line, tmp_path / "table.txt").status == 2


def test_a_recording_that_arrives_is_judged_when_it_is_complete(tmp_path: Path):
    folder = make_line(tmp_path / "line", 3)
    write_table(
        folder, [(f"S{k}", f"later/{k}.npz", f"0000{k}") for k in range(3)], more=("barcode",)
    )
    inbox = tmp_path / "inbox"
    inbox.mkdir()
    line = read_line(folder)
    polls = 0

    def poll() -> bool:
        nonlocal polls
        polls += 1
        if polls == 1:
            write_recording(inbox / "00001.npz", 1)
            (inbox / ".hidden").write_bytes(b"x")
            (inbox / "other.npz").write_bytes(b"half")
        if polls == 2:
            (inbox / "other.npz").write_bytes(b"half and the rest")
        return polls < 6

    arrived = list(arriving_files(inbox, poll))
    assert [path.name for path in arrived] == ["00001.npz", "other.npz"]
    good, bad = (calibrate_arrival(line, path, folder / results.FOLDER) for path in arrived)
    assert (good.id, good.passed) == ("S1", True)
    assert (bad.id, bad.passed) == ("other", False)
    # Nothing tells the lot and the bench of a sensor that the table lacks.
    assert [(row["id"], row["status"]) for row in rows_of(folder)] == [("S1", "done")]
    assert list(arriving_files(inbox, lambda: False, known_files(line, folder / "fleet"))) == []


@pytest.mark.slow
def test_a_station_prints_pass_and_fail_and_ends_with_their_status(tmp_path: Path):
    folder, inbox = make_line(tmp_path / "line", 1), tmp_path / "inbox"
    write_recording(inbox / "S000.npz", 0)
    watched = ("fleet", "calibrate", folder, "--watch", inbox, "--count", "1")
    ended = run_program(*watched)
    assert (ended.status, ended.output.splitlines()[1].split()[:2]) == (0, ["PASS", "S000:"])
    (inbox / "S000.npz").write_bytes(b"nothing")
    (inbox / "notes.txt").write_text("no recording", encoding="utf-8")
    ended = run_program(*watched)
    assert (ended.status, ended.output.splitlines()[1].split()[:2]) == (3, ["FAIL", "S000:"])


def test_a_station_finds_a_row_by_barcode_and_by_id(tmp_path: Path):
    folder, inbox = make_line(tmp_path / "line", 2), tmp_path / "inbox"
    rows = [(f"S00{k}", f"r/{k}.npz", f"77{k}", tilt) for k, tilt in enumerate(("", "0.3 °"))]
    write_table(folder, rows, ("barcode", "bench.tilt"))
    line = read_line(folder)
    for name in ("S001", "771"):
        write_recording(inbox / f"{name}.npz", 1)
        row = find_row(line, inbox / f"{name}.npz")
        assert row is not None
        assert (row.id, row.columns["bench.tilt"]) == ("S001", "0.3 °")
    write_table(folder, [(f"S00{k}", f"r/{k}.npz", "77") for k in range(2)], ("barcode",))
    with refused(file="sensors.csv", names=("barcode",)):
        read_line(folder)


@pytest.mark.parametrize(
    "options", [("--workers", "1"), ("--register", "r.db"), ("--json",), ("--batch", "2")]
)
def test_an_option_that_a_station_does_not_take_is_refused(
    tmp_path: Path, options: tuple[str, ...]
):
    folder = make_line(tmp_path / "line", 1)
    ended = run_program("fleet", "calibrate", folder, "--watch", tmp_path, *options)
    assert ended.status == 2
    assert options[0] in ended.error


def test_a_station_and_the_line_share_their_results(tmp_path: Path):
    folder = make_line(tmp_path, 2)
    line = read_line(folder)
    for name in ("S000", "S001"):
        result = calibrate_arrival(line, folder / "recordings" / f"{name}.npz", folder / "fleet")
        assert result.passed
    found = json.loads(run_program("fleet", "calibrate", folder, "--json").output)
    assert (found["kept"], found["done"]) == (2, 0)


@pytest.mark.slow
def test_results_of_another_run_file_are_said(tmp_path: Path):
    folder = make_line(tmp_path, 3)
    run_program("fleet", "calibrate", folder)
    text = (folder / "run.toml").read_text(encoding="utf-8")
    (folder / "run.toml").write_text(text.replace("0.1 °", "0.2 °"), encoding="utf-8")
    said = json.loads(run_program("fleet", "status", folder, "--json").output)
    assert (said["counts"], said["outdated"]) == ({"consistent": 3}, 3)
    compared = json.loads(run_program("fleet", "report", folder, "--json").output)
    assert compared["outdated"] == 3


def start_fleet(folder: Path) -> "subprocess.Popen[bytes]":
    command = [sys.executable, "-c", "from inercal.cli.app import main; main()"]
    return subprocess.Popen(
        [*command, "fleet", "calibrate", str(folder), "--workers", "2", "--batch", "2"],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        start_new_session=True,
    )


def child_processes(pid: int) -> list[int]:
    listed = Path(f"/proc/{pid}/task/{pid}/children")
    return [int(one) for one in listed.read_text().split()] if listed.exists() else []


@pytest.fixture(scope="module")
def unbroken_rows(tmp_path_factory: pytest.TempPathFactory) -> list[dict[str, Any]]:
    folder = make_line(tmp_path_factory.mktemp("unbroken"), 24)
    run_program("fleet", "calibrate", folder, "--batch", "2", "--workers", "1")
    return rows_of(folder)


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="processes are found as Linux lists them")
@pytest.mark.parametrize("moment", chosen(range(10), (1,)))
def test_a_fleet_that_is_killed_goes_on_to_the_same_rows(
    tmp_path: Path, unbroken_rows: list[dict[str, Any]], moment: int
):
    """Kill the client, or one of its workers, at a random moment; then run it again."""
    folder = make_line(tmp_path / "killed", 24)
    rng = random.Random(moment)
    process = start_fleet(folder)
    try:
        process.wait(timeout=rng.uniform(0.5, 5.0))
    except subprocess.TimeoutExpired:
        children = child_processes(process.pid)
        victim = process.pid if moment % 2 or not children else rng.choice(children)
        os.kill(victim, signal.SIGKILL)
    process.wait()
    assert run_program("fleet", "calibrate", folder, "--retry-failed").status == 0
    assert rows_of(folder) == unbroken_rows


def test_an_export_never_replaces_what_the_line_reads(line: Path, tmp_path: Path):
    run_program("fleet", "calibrate", line)
    part = next(iter((line / results.FOLDER).glob("*.parquet")))
    for path in (line / "sensors.csv", part, line / "recordings" / "S000.npz"):
        before = path.read_bytes()
        commands = [("export", line, path, "--sensor", "S000")]
        commands += [("export", line, path)] * (path.suffix != ".npz")
        for command in commands:
            ended = run_program("fleet", *command, "--force")
            assert (ended.status, path.read_bytes() == before) == (2, True), ended.error
    files = read_line(line).input_files
    assert {path.name for path in files} == {"run.toml", "sensors.csv"} | {
        f"S{k:03d}.npz" for k in range(6)
    }


def test_a_column_that_is_no_key_is_named_with_the_table(tmp_path: Path):
    folder = make_line(tmp_path, 2)
    rows = [(f"S{k:03d}", f"recordings/S{k:03d}.npz", "1.5") for k in range(2)]
    write_table(folder, rows, ("ax.k0 [µg]",))
    with refused(file="sensors.csv", names=("ax.k0 [µg]",)):
        read_line(folder)
    write_table(folder, rows, ("ax.k0",))
    assert "column ax.k0" in run_program("fleet", "calibrate", folder).error
