"""Sensors that cannot be relied on, and recordings that are used twice, are named."""

import csv
import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from tests.fleet.lines import TEMPLATE, make_line, readings, write_table
from tests.program import run_program

pytest.importorskip("pyarrow")


@pytest.fixture(scope="module")
def line(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a line: the z axis of S001 reads 0.6 of nominal, S003 has the recording of S002."""
    template = TEMPLATE + '[specification.limits]\nbias = "± 100 mg"\n'
    folder = make_line(tmp_path_factory.mktemp("line"), 5, template=template)
    columns, _ = readings(1)
    np.savez(
        folder / "recordings/S001.npz", allow_pickle=False, **columns | {"z": 0.6 * columns["z"]}
    )
    shutil.copyfile(folder / "recordings/S002.npz", folder / "recordings/S003.npz")
    return folder


@pytest.mark.slow
def test_the_outputs_name_a_wrong_scale_factor_and_a_repeated_recording(line: Path, tmp_path: Path):
    made = run_program("fleet", "calibrate", line)
    assert made.status == 3
    page = tmp_path / "page.html"
    report = run_program("fleet", "report", line, "--out", page)
    for text in (made.output, run_program("fleet", "status", line).output, report.output,
                 page.read_text(encoding="utf-8")):  # fmt: skip
        assert all(name in text for name in ("S001 is", "S002 and S003"))
    for verb in ("calibrate", "status", "report"):
        found = json.loads(run_program("fleet", verb, line, "--json").output)
        assert found["unreliable"]["S001"].startswith("the scale factor of the z accelerometer")
        assert (list(found["unreliable"]), found["same_recording"]) == (
            ["S001"],
            [["S002", "S003"]],
        )


def test_the_export_of_one_unreliable_sensor_warns(line: Path, tmp_path: Path):
    run_program("fleet", "calibrate", line)
    for name in ("S000", "S001"):
        ended = run_program("fleet", "export", line, tmp_path / f"{name}.json", "--sensor", name)
        assert (ended.status, "S001" in ended.error) == (0, name == "S001")
    run_program("fleet", "export", line, tmp_path / "table.csv")
    with (tmp_path / "table.csv").open(encoding="utf-8", newline="") as file:
        rows = {row["id"]: row for row in csv.DictReader(file)}
    assert [row["conformity"] for row in rows.values()] == ["pass", "", "", "", "pass"]
    assert "z accelerometer" in rows["S001"]["verdict"]
    assert rows["S002"]["error"] == "calibrated from the same readings as S003"
    assert rows["S003"]["error"] == "calibrated from the same readings as S002"


def test_copies_with_other_times_and_cut_ends_are_found(tmp_path: Path):
    folder = make_line(tmp_path, 5)
    columns, _ = readings(0)
    for name, kept, shift in (("S001", slice(None, -1), 0.0), ("S003", slice(7, None), 1e3)):
        changed = {key: column[kept] for key, column in columns.items()} | {
            "t": columns["t"][kept] + shift
        }
        np.savez(folder / f"recordings/{name}.npz", allow_pickle=False, **changed)
    made = json.loads(run_program("fleet", "calibrate", folder, "--json").output)
    assert (made["done"], made["same_recording"]) == (5, [["S000", "S001", "S003"]])


@pytest.mark.slow
def test_one_recording_may_contain_the_columns_of_several_sensors(tmp_path: Path):
    folder = make_line(tmp_path, 1)
    columns, _ = readings(0)
    path = folder / "recordings/S000.npz"
    np.savez(path, allow_pickle=False, **columns, u=columns["x"] + 0.01)
    text = (folder / "run.toml").read_text(encoding="utf-8").replace('"x", "y"', '"{first}", "y"')
    (folder / "run.toml").write_text(text, encoding="utf-8")
    rows = [(name, "recordings/S000.npz", first) for name, first in (("A", "x"), ("B", "u"))]
    write_table(folder, rows, ("first",))
    made = json.loads(run_program("fleet", "calibrate", folder, "--json").output)
    assert (made["done"], made["same_recording"]) == (2, [])


@pytest.mark.slow
def test_noisy_and_failing_sensors_are_named_and_failures_lower_the_yield(tmp_path: Path):
    white = TEMPLATE.replace('unit = "g"', 'unit = "g"\nwhite = "14 µg/√Hz"')
    folder = make_line(tmp_path, 8, template=white + '[specification.limits]\nbias = "± 60 mg"\n')
    changed = {
        "S003": lambda x: x + np.random.default_rng(3).normal(0, 3e-3, x.size),
        "S005": lambda x: x + 0.2,
        "S006": lambda x: -x,
    }
    for name, change in changed.items():
        columns, _ = readings(int(name[1:]))
        path = folder / "recordings" / f"{name}.npz"
        np.savez(path, allow_pickle=False, **columns | {"x": change(columns["x"])})
    page = tmp_path / "page.html"
    ended = [
        run_program("fleet", "calibrate", folder),
        run_program("fleet", "status", folder),
        run_program("fleet", "report", folder, "--out", page),
    ]
    for text in (*(one.output for one in ended), page.read_text(encoding="utf-8")):
        assert all(name in text for name in changed)
    for verb in ("calibrate", "status", "report"):
        found = json.loads(run_program("fleet", verb, folder, "--json").output)
        assert found["reservations"].keys() >= found["large_u"].keys() == {"S003"}
        assert found["large_u"]["S003"]["ratio"] > 3
        assert found["failing"] == {"S005": "fail"}
    (failed,) = json.loads(run_program("fleet", "status", folder, "--json").output)["reasons"]
    assert failed["reason"].startswith("recordings/S006.npz: ")
    assert (found["yield"][0]["pass"], found["yield"][0]["share"]) == (6, 6 / 8)
    assert found["yield"][0]["without a usable result"] == 1


def test_a_common_station_and_unlisted_recordings_are_named_by_their_paths(tmp_path: Path):
    folder = make_line(tmp_path, 1)
    good = folder / "recordings/S000.npz"
    columns, _ = readings(0)
    rows: list[tuple[str, str, str]] = []
    for k in range(8):
        name = f"days/{k % 2}/S{k:03}.npz"
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(good, path)
        if k < 4:
            np.savez(path, allow_pickle=False, **columns | {"z": np.ones_like(columns["z"])})
        rows.append((f"S{k:03}", name, "AB"[k < 4]))
    shutil.copyfile(good, folder / "days/1/S999.npz")
    write_table(folder, rows, ("station",))
    found = json.loads(run_program("fleet", "calibrate", folder, "--json").output)
    assert found["unlisted"] == ["days/1/S999.npz"]
    (common,) = found["common"]
    assert "station B" in common
    assert "4 of all 8" in common
    reasons = json.loads(run_program("fleet", "status", folder, "--json").output)["reasons"]
    assert sorted(name for one in reasons for name in one["sensors"]) == [
        f"S{k:03}" for k in range(4)
    ]
    printed = run_program("fleet", "status", folder).output
    assert "station B" in printed
    assert "days/1/S999.npz" in printed
    rows[0] = (*rows[0][:2], "")
    write_table(folder, rows, ("station",))
    assert json.loads(run_program("fleet", "calibrate", folder, "--json").output)["common"] == []


def test_the_reason_of_a_failure_names_the_whole_path_and_the_column(tmp_path: Path):
    folder = make_line(tmp_path, 1)
    columns, _ = readings(0)
    path = folder / "day/1/S000.npz"
    path.parent.mkdir(parents=True)
    np.savez(path, allow_pickle=False, **columns | {"z": np.ones_like(columns["z"])})
    write_table(folder, [("S000", "day/1/S000.npz")])
    run_program("fleet", "calibrate", folder)
    (one,) = json.loads(run_program("fleet", "status", folder, "--json").output)["reasons"]
    assert one["reason"].startswith("day/1/S000.npz: az (column z)")


def test_a_reason_that_sensors_share_names_their_recordings(tmp_path: Path):
    folder = make_line(tmp_path, 1)
    missing = ["north/S001.npz", "south/S002.npz"]
    write_table(folder, [("S000", "recordings/S000.npz"), *((Path(m).stem, m) for m in missing)])
    printed = run_program("fleet", "calibrate", folder).output
    (one,) = json.loads(run_program("fleet", "status", folder, "--json").output)["reasons"]
    assert one["sensors"] == ["S001", "S002"]
    for text in (printed, one["reason"]):
        assert all(name in text for name in missing)


def test_a_cut_label_is_a_reservation_and_reasons_beyond_ten_have_a_place(tmp_path: Path):
    folder = make_line(tmp_path, 1)
    columns, _ = readings(0)
    columns["face"][-1] = "z_"
    np.savez(folder / "recordings/S000.npz", allow_pickle=False, **columns)
    names = [f"N{k}" for k in range(12)]
    for k, name in enumerate(names):  # the columns have other lengths in each file
        changed = columns | {"t": columns["t"][k + 1 :]}
        np.savez(folder / f"recordings/{name}.npz", allow_pickle=False, **changed)
    write_table(folder, [(name, f"recordings/{name}.npz") for name in ("S000", *names)])
    lines = run_program("fleet", "calibrate", folder).output.splitlines()
    assert any("S000: usable with reservations: the section 'z_' is not used" in x for x in lines)
    assert any("reasons for missing results; inercal fleet status --json lists all" in x
               for x in lines)  # fmt: skip
