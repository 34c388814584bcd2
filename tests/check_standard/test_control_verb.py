"""`inercal control` from files, a table and a register; and the keys of a run file."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from tests.check_standard.history import checked_sessions, day
from tests.program import run_program
from tests.refusals import refused
from tests.repeatability.laboratory import MICRO, NAMES, Laboratory
from tests.runfile.key_sweep import example, toml

from inercal.basics.errors import InputError
from inercal.calibration.files import load, save
from inercal.laboratory.store import Register
from inercal.runfile import read

STEP = np.where(np.array(NAMES) == "ax.k0", 400 * MICRO, 0.0)
DAYS = 12


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with calibrations of 12 days, the last two beside the others."""
    folder = tmp_path_factory.mktemp("checks")
    rng = np.random.default_rng(2)
    sessions = checked_sessions(Laboratory(), DAYS, rng, shift=2 * STEP, shifted=(10, 12))
    for k, one in enumerate(sessions):
        dated = replace(one.session.calibration, job={"measured": day(k)})
        save(dated, folder / f"{k:02}.calibration.json")
    return folder


def files(folder: Path) -> list[Path]:
    return sorted(folder.glob("*.calibration.json"))


@pytest.mark.slow
def test_files_of_a_job_are_charted_by_its_day(folder: Path, tmp_path: Path):
    ended = run_program("control", *files(folder), "--reference", "8", "--out", tmp_path, "--json")
    assert ended.status == 0, ended.error
    found = json.loads(ended.output)
    assert found["reference"] == {"days": 8, "until": day(7), "shift": None}
    assert [one["in_control"] for one in found["points"]] == [True, True, False, False]
    assert found["episodes"] == [{"since": day(9), "until": None}]
    assert "ax.k0" in found["points"][2]["signals"]["Shewhart"]
    stored = json.loads((tmp_path / "TRIAD-1.control.json").read_text(encoding="utf-8"))
    assert stored["points"] == found["points"]
    again = ("control", *files(folder), "--reference", "8", "--out", tmp_path)
    assert run_program(*again).status == 2  # nothing is written over
    assert "out of control" in run_program(*again, "--force").output


@pytest.mark.slow
def test_a_register_gives_the_points_of_the_files_and_lists_what_is_doubtful(
    folder: Path, tmp_path: Path
):
    path = str(tmp_path / "r.db")
    with Register(path) as opened:
        for k, file in enumerate(files(folder)):
            opened.enter_calibration(file, measured=day(k))
        other = load(files(folder)[0])
        for name, when in (("JOB-1", 3), ("JOB-2", 10), ("JOB-3", 11)):
            one = replace(other, sensor=replace(other.sensor, name=name), job={})
            opened.enter_calibration(one, measured=f"{day(when)}T12:00:00")
    given = ("--sensor", "TRIAD-1", "--register", path, "--reference", "8")
    found = json.loads(run_program("control", *given, "--json").output)
    of_files = json.loads(
        run_program("control", *files(folder), "--reference", "8", "--json").output
    )
    for one, expected in zip(found["points"], of_files["points"], strict=True):
        assert one["T²"] == pytest.approx(expected["T²"], rel=1e-9)
        assert one["signals"] == expected["signals"]
    assert [one["sensor"] for one in found["doubtful"]] == ["JOB-2", "JOB-3"]
    printed = run_program("control", *given).output
    assert "JOB-2" in printed
    assert "JOB-1" not in printed


@pytest.mark.slow
def test_the_register_dates_by_the_job_and_files_in_any_order_give_the_same(
    folder: Path, tmp_path: Path
):
    path = str(tmp_path / "r.db")
    given = [*files(folder)[5:], *files(folder)[:5]]
    with Register(path) as opened:
        opened.enter_calibrations(given)
        entries = opened.history("TRIAD-1").entries
    assert [one.measured[:10] for one in entries] == [day(k) for k in range(12)]
    assert {one.measured_from for one in entries} == {"stated"}
    ways = (files(folder), given, ("--sensor", "TRIAD-1", "--register", path))
    found = [
        json.loads(run_program("control", *way, "--reference", "8", "--json").output)
        for way in ways
    ]
    episodes = [one["episodes"] for one in found]
    assert episodes[0] == [{"since": day(9), "until": None}]
    assert episodes[1] == episodes[0]
    assert [one["since"][:10] for one in episodes[2]] == [day(9)]


@pytest.mark.parametrize("date", ["2025-11-30", "2026-01-03T10:00:00", "2999-01-01"])
def test_a_stated_date_that_the_job_or_the_clock_contradicts_is_refused(
    folder: Path, tmp_path: Path, date: str
):
    with Register(str(tmp_path / "r.db")) as opened:
        with refused(InputError, key="--measured"):
            opened.enter_calibration(files(folder)[0], measured=date)
        number = opened.enter_calibration(files(folder)[0], measured=f"{day(0)}T12:00:00")
        assert opened.calibration(number).measured[:13] == f"{day(0)}T12"


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ((), "20"),
        (("--reference", "2"), "--reference 2"),
        (("--reference", "8", "--run-length", "1"), "--run-length"),
        (("--reference", "8", "--restart", "monday"), "--restart"),
        (("--reference", "8", "--restart", "2999-01-01"), "--restart 2999-01-01"),
    ],
)
def test_what_cannot_be_charted_is_one_line(folder: Path, options: tuple[str, ...], words: str):
    ended = run_program("control", *files(folder), *options)
    assert ended.status == 2
    assert words in ended.error


def test_files_without_a_date_are_refused(folder: Path, tmp_path: Path):
    path = tmp_path / "0.calibration.json"
    save(replace(load(files(folder)[0]), job={}), path)
    ended = run_program("control", path, *files(folder)[1:], "--reference", "8")
    assert ended.status == 2
    assert "--table" in ended.error


def run_file(folder: Path, **bench: str) -> Path:
    """Return a run file whose [bench] states more."""
    changes = [("bench", key, value) for key, value in bench.items()]
    path = folder / "run.toml"
    path.write_text(toml(example("six_position/run.toml", *changes)), encoding="utf-8")
    return path


@pytest.mark.slow
def test_a_run_file_takes_the_newest_state(folder: Path, tmp_path: Path):
    run_program("control", *files(folder), "--reference", "8", "--out", tmp_path)
    run = read(run_file(tmp_path, check_standard="TRIAD-1.control.json"))
    assert run.check_standard == f"TRIAD-1: out of control on {day(11)}"
    (found,) = [one for one in run.findings if one.what == "check standard"]
    assert found.severity == "warning"
    run_program("control", *files(folder)[:10], "--reference", "8", "--out", tmp_path,
                "--force")  # fmt: skip
    run = read(run_file(tmp_path, check_standard="TRIAD-1.control.json"))
    assert not [one for one in run.findings if one.what == "check standard"]
    for age, words in (("24 h", "[job] measured"), ("-1 h", "negative"), ("1 m", "1 m")):
        stated = {"check_standard": "TRIAD-1.control.json", "check_standard_age": age}
        with refused(InputError, key="[bench] check_standard_age") as refusal:
            read(run_file(tmp_path, **stated))
        assert words in str(refusal.value)


def test_an_age_without_a_check_standard_and_a_file_of_another_kind_are_refused(
    folder: Path, tmp_path: Path
):
    with refused(InputError, key="[bench] check_standard_age"):
        read(run_file(tmp_path, check_standard_age="24 h"))
    for name in ("absent.json", str(files(folder)[0])):
        with refused(InputError, key="[bench] check_standard"):
            read(run_file(tmp_path, check_standard=name))
