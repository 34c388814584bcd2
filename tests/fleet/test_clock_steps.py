"""A fleet whose clock steps by a day between any two steps exports what a calibration gives now."""

import csv
import os
import random
import shutil
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from datetime import datetime, timedelta, tzinfo
from pathlib import Path

import pytest
from tests.fleet.lines import TEMPLATE, make_line, write_recording, write_table
from tests.program import run_program

import inercal
from inercal.basics.parallel import SerialExecutor
from inercal.fleet import batch as batch_module
from inercal.fleet import results
from inercal.fleet.calibration import Counts, calibrate_line
from inercal.fleet.export import export_table
from inercal.fleet.latest import latest_results
from inercal.fleet.line import read_line
from inercal.fleet.station import calibrate_arrival, known_files

pytest.importorskip("pyarrow")
DAY = timedelta(days=1)
STEPS = (timedelta(0), DAY, -DAY)
NAMES = ("S000", "S001", "S002")


class Clock:
    """The clock of whoever calibrates, a day ahead or behind."""

    step = timedelta(0)

    @classmethod
    def now(cls, zone: tzinfo) -> datetime:
        return datetime.now(zone) + cls.step


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> type[Clock]:
    monkeypatch.setattr(batch_module, "datetime", Clock)
    monkeypatch.setattr(Clock, "step", timedelta(0))
    return Clock


def calibrate(folder: Path, retry_failed: bool = False) -> Counts:
    with SerialExecutor() as executor:
        return calibrate_line(read_line(folder), executor, retry_failed=retry_failed)


def exported(folder: Path) -> dict[str, dict[str, str]]:
    export_table(read_line(folder), folder / results.FOLDER, folder / "all.csv")
    with (folder / "all.csv").open(encoding="utf-8", newline="") as file:
        # A line without a calibration has no columns for coefficients.
        return {
            row["id"]: {name: cell for name, cell in row.items() if cell}
            for row in csv.DictReader(file)
        }


def calibrated_anew(folder: Path, where: Path) -> dict[str, dict[str, str]]:
    """Return the table of a copy of a line that has no results yet."""
    shutil.copytree(folder, where, ignore=shutil.ignore_patterns(results.FOLDER, "all.csv"))
    calibrate(where)
    found = exported(where)
    shutil.rmtree(where)
    return found


def change(folder: Path, rng: random.Random) -> None:
    """Do what a user does to a line between two calls."""
    name = rng.choice(NAMES)
    path = folder / "recordings" / f"{name}.npz"
    kind, number = rng.randrange(7), 10 * NAMES.index(name) + 10 + rng.randrange(3)
    if kind < 2:
        text = TEMPLATE.replace("0.1 °", rng.choice(["0.1 °", "0.2 °", "0.3 °"]))
        (folder / "run.toml").write_text(text, encoding="utf-8")
    elif kind == 2:
        write_recording(path, number)
    elif kind == 3 and path.exists():  # a logger without a clock: equal size, equal time
        before = path.stat()
        write_recording(path, number)
        os.utime(path, ns=(before.st_atime_ns, before.st_mtime_ns))
    elif kind == 4:
        path.unlink(missing_ok=True)
    elif kind == 5:
        path.write_bytes(b"damaged")
    else:
        cells = [(one, f"recordings/{one}.npz", rng.choice(["", "0.4 °"])) for one in NAMES]
        write_table(folder, cells, more=("bench.tilt",))


def check_steps(folder: Path, clock: type[Clock], seed: int, steps: int) -> None:
    rng = random.Random(seed)
    line = make_line(folder / "line", len(NAMES))
    calibrate(line)
    for _ in range(steps):
        clock.step = rng.choice(STEPS)
        change(line, rng)
        anew = calibrated_anew(line, folder / "anew")
        for name, row in exported(line).items():
            assert "outdated" in row or row == anew[name]
        clock.step = rng.choice(STEPS)
        calibrate(line, retry_failed=rng.random() < 0.3)
        assert exported(line) == anew


@pytest.mark.slow
def test_an_export_equals_a_new_calibration_or_is_marked(tmp_path: Path, clock: type[Clock]):
    check_steps(tmp_path, clock, 1, steps=4)


@pytest.mark.evidence
@pytest.mark.parametrize("seed", range(2, 42))
def test_exports_equal_new_calibrations_over_many_steps(
    tmp_path: Path, clock: type[Clock], seed: int
):
    check_steps(tmp_path, clock, seed, steps=12)


@pytest.mark.slow
def test_a_corrected_line_is_exported_though_the_clock_was_ahead(
    tmp_path: Path, clock: type[Clock]
):
    folder = make_line(tmp_path / "line", 3)
    clock.step = DAY
    calibrate(folder)
    ahead = exported(folder)
    clock.step = timedelta(0)
    (folder / "run.toml").write_text(TEMPLATE.replace("0.1 °", "0.2 °"), encoding="utf-8")
    told = run_program("fleet", "export", folder, tmp_path / "old.csv")
    assert told.status == 0
    assert "S000, S001, S002: the result is outdated" in told.error
    assert calibrate(folder).done == 3
    corrected = exported(folder)
    assert all(corrected[name] != ahead[name] for name in NAMES)
    assert not any("outdated" in row for row in corrected.values())
    assert calibrate(folder).kept == 3
    # The former template again: its results are there, and nothing is computed.
    (folder / "run.toml").write_text(TEMPLATE, encoding="utf-8")
    assert calibrate(folder).kept == 3
    assert exported(folder) == ahead


@pytest.mark.slow
def test_files_of_an_outdated_result_say_so(tmp_path: Path):
    folder = make_line(tmp_path / "line", 2)
    calibrate(folder)
    write_recording(folder / "recordings" / "S001.npz", 9)
    for name, mark in (("S000", None), ("S001", "its recording has changed since then")):
        path = tmp_path / f"{name}.calibration.json"
        ended = run_program("fleet", "export", folder, path, "--sensor", name)
        assert (ended.status, bool(ended.error)) == (0, mark is not None)
        assert inercal.load(path).provenance.get("outdated") == mark
    made = run_program("fleet", "export", folder, tmp_path / "code", "--to", "python")
    assert "S001: the result is outdated" in made.error
    texts = [(tmp_path / "code" / f"{name}.python.py").read_text("utf-8") for name in NAMES[:2]]
    assert ["OUTDATED: its recording has changed" in text for text in texts] == [False, True]


def test_an_outdated_result_is_not_entered_in_a_register(tmp_path: Path):
    from inercal.fleet.latest import enter_results
    from inercal.laboratory.store import Register

    folder = make_line(tmp_path / "line", 3)
    calibrate(folder)
    write_recording(folder / "recordings" / "S001.npz", 9)
    with Register(str(tmp_path / "register.db")) as register:
        assert enter_results(read_line(folder), folder / results.FOLDER, register) == 2


def test_a_file_that_the_template_names_is_an_input(tmp_path: Path):
    folder = make_line(tmp_path / "line", 2)
    laboratory = folder / "laboratory.toml"
    laboratory.write_text('name = "A"\n', encoding="utf-8")
    (folder / "run.toml").write_text(
        f'{TEMPLATE}[job]\nlaboratory = "laboratory.toml"\ncustomer = "{{id}}.txt"\n', "utf-8"
    )
    before = [read_line(folder).digest(row) for row in read_line(folder).rows]
    (folder / "S001.txt").write_text("B", encoding="utf-8")
    own = [read_line(folder).digest(row) for row in read_line(folder).rows]
    assert [a == b for a, b in zip(before, own, strict=True)] == [True, False]
    laboratory.write_text('name = "B"\n', encoding="utf-8")
    common = [read_line(folder).digest(row) for row in read_line(folder).rows]
    assert [a == b for a, b in zip(own, common, strict=True)] == [False, False]


def test_a_copied_line_keeps_its_results(tmp_path: Path):
    folder = make_line(tmp_path / "line", 2)
    calibrate(folder)
    copy = tmp_path / "copy"
    shutil.copytree(folder, copy, copy_function=shutil.copy)  # with new times
    assert calibrate(copy).kept == 2
    assert exported(copy) == exported(folder)


def test_the_second_recording_of_a_sensor_at_a_station_counts(tmp_path: Path, clock: type[Clock]):
    folder, inbox = make_line(tmp_path / "line", 1), tmp_path / "inbox"
    (folder / "recordings" / "S000.npz").unlink()
    line, out = read_line(folder), folder / results.FOLDER
    values: list[float] = []
    for seed, clock.step in ((1, DAY), (2, -DAY), (3, timedelta(0))):
        write_recording(inbox / f"run{seed}" / "S000.npz", seed)
        assert calibrate_arrival(line, inbox / f"run{seed}" / "S000.npz", out).passed
        (row,) = latest_results(line, out).to_pylist()
        assert (row["status"], row["outdated"]) == ("done", "")
        values.append(row["value"][0])
    assert len(set(values)) == 3
    assert len(known_files(line, out)) == 3  # none arrives again at the next start
    assert calibrate(folder).kept == 1


def numbers(folder: Path) -> Iterator[int]:
    for _ in range(20):
        yield results.open_writer(folder).generation


def test_no_generation_is_taken_twice(tmp_path: Path):
    with ThreadPoolExecutor(4) as pool:
        taken = list(pool.map(lambda _: list(numbers(tmp_path)), range(4)))
    assert all(one == sorted(one) for one in taken)
    assert len({number for one in taken for number in one}) == 80
    assert len(list(tmp_path.iterdir())) == 1
    assert results.open_writer(tmp_path, above=500).generation == 501
