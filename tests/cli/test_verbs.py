"""What each verb writes and prints."""

import json
from collections.abc import Callable
from dataclasses import replace
from math import sqrt
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.runfile.run_file_texts import FERRARIS, SIX_POSITIONS, run_file

import inercal
from inercal.calibration.files import load, save
from inercal.cli.app import main
from inercal.pipeline import calibrate

DOCUMENTED = {
    "schema",
    "sensor",
    "method",
    "estimator",
    "coefficients",
    "covariance",
    "frame",
    "mount",
    "conditions",
    "provenance",
    "bench_estimates",
    "notes",
    "verdict",
    "shared",
    "validity",
    "sha256",
}


@pytest.fixture
def said(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Callable[..., str]:
    """Run the program within this process; return its standard output."""

    def run(*arguments: str | Path) -> str:
        monkeypatch.setattr("sys.argv", ["inercal", *map(str, arguments)])
        capsys.readouterr()
        with pytest.raises(SystemExit) as stop:
            main()
        printed = capsys.readouterr()
        assert not stop.value.code, printed.err
        # A run on a bench says its events on standard error.
        assert printed.err == "" or arguments[0] == "demo"
        return printed.out

    return run


@pytest.fixture
def run(tmp_path: Path, said: Callable[..., str]) -> Path:
    """Run file beside its simulated recording."""
    path = run_file(tmp_path, SIX_POSITIONS)
    said("simulate", path, "--seed", "4")
    return path


def names(folder: Path) -> set[str]:
    return {path.name for path in folder.iterdir()}


@pytest.mark.slow
def test_calibrate_writes_the_calibration_and_the_report(
    run: Path, tmp_path: Path, said: Callable[..., str]
):
    printed = said("calibrate", run, "--out", tmp_path)
    assert names(tmp_path) == {"run.toml", "log.csv", "run.calibration.json", "run.report.html"}
    assert f"wrote {tmp_path / 'run.calibration.json'}\n" in printed
    found = inercal.load(tmp_path / "run.calibration.json")
    assert found.values == pytest.approx(calibrate(run).calibration.values, rel=1e-12)
    page = (tmp_path / "run.report.html").read_text(encoding="utf-8")
    assert page.lstrip().lower().startswith("<!doctype html>")


def test_calibrate_writes_no_report_where_none_is_wanted(
    run: Path, tmp_path: Path, said: Callable[..., str]
):
    said("calibrate", run, "--out", tmp_path, "--no-report")
    assert names(tmp_path) == {"run.toml", "log.csv", "run.calibration.json"}


def test_a_page_that_cannot_be_drawn_leaves_the_calibration(
    run: Path, tmp_path: Path, said: Callable[..., str], monkeypatch: pytest.MonkeyPatch
):
    def fails(*_: object) -> None:
        raise ZeroDivisionError

    monkeypatch.setattr("inercal.report.write_report", fails)
    with pytest.raises(ZeroDivisionError):
        said("calibrate", run, "--out", tmp_path)
    assert names(tmp_path) == {"run.toml", "log.csv", "run.calibration.json"}


def test_calibrate_prints_one_json_object_with_the_documented_fields(
    run: Path, tmp_path: Path, said: Callable[..., str]
):
    printed: dict[str, Any] = json.loads(
        said("calibrate", run, "--out", tmp_path, "--no-report", "--json")
    )
    path = tmp_path / "run.calibration.json"
    assert set(printed) == DOCUMENTED | {"calibration_file"}
    assert printed.pop("calibration_file") == str(path)
    assert printed == json.loads(path.read_text(encoding="utf-8"))


def test_the_table_holds_each_coefficient_with_twice_its_uncertainty(
    run: Path, tmp_path: Path, said: Callable[..., str]
):
    printed = said("calibrate", run, "--out", tmp_path, "--no-report")
    found = inercal.load(tmp_path / "run.calibration.json")
    rows = [line.split("│")[1:-1] for line in printed.splitlines() if line.startswith("│")]
    assert tuple(row[0].strip() for row in rows) == found.sensor.coefficients
    for row, value, std in zip(rows, found.values, found.std, strict=True):
        name, _, stated, expanded, unit, error = (cell.strip() for cell in row)
        line = found.sensor.coefficient(name)
        assert unit == line.unit
        assert float(expanded) == pytest.approx(2 * std / line.si, rel=0.06)  # two digits
        assert float(stated) == pytest.approx(value / line.si, abs=0.06 * float(expanded))
        truth = {"ax.k0": 0.032 * 9.80665, "ay.k1": -0.005, "az.delta_p": np.radians(22 / 60)}
        assert float(error) == pytest.approx((value - truth.get(name, 0.0)) / std, abs=0.006)


@pytest.mark.parametrize("suffix", ["csv", "npz", "parquet"])
def test_simulate_writes_what_calibrate_reads(
    tmp_path: Path, said: Callable[..., str], suffix: str
):
    if suffix == "parquet":
        pytest.importorskip("pyarrow")
    path = run_file(tmp_path, SIX_POSITIONS, ('"log.csv"', f'"log.{suffix}"'))
    printed = json.loads(said("simulate", path, "--json", "--seed", "7"))
    assert set(printed) == {"recording", "samples", "seconds", "seed", "truth"}
    assert printed["recording"] == str(tmp_path / f"log.{suffix}")
    assert printed["samples"] == 50 * (6 * 4 + 5 * 2)
    assert printed["seconds"] == pytest.approx(34 - 1 / 50)
    assert printed["truth"]["ay.k1"] == pytest.approx(-0.005)
    found = json.loads(said("calibrate", path, "--out", tmp_path, "--no-report", "--json"))
    by_name = {row["name"]: row for row in found["coefficients"]}
    for name, value in printed["truth"].items():
        assert by_name[name]["value"] == pytest.approx(value, abs=4.5 * by_name[name]["std"])


def test_simulate_writes_elsewhere_where_asked(tmp_path: Path, said: Callable[..., str]):
    path = run_file(tmp_path, SIX_POSITIONS)
    said("simulate", path, "--out", tmp_path / "other.npz")
    assert names(tmp_path) == {"run.toml", "other.npz"}


def test_one_seed_writes_the_same_bytes(run: Path, tmp_path: Path, said: Callable[..., str]):
    said("simulate", run, "--seed", "4", "--out", tmp_path / "again.csv")
    said("simulate", run, "--seed", "5", "--out", tmp_path / "other.csv")
    first, again, other = (tmp_path / n for n in ("log.csv", "again.csv", "other.csv"))
    assert first.read_bytes() == again.read_bytes()
    assert first.read_bytes() != other.read_bytes()


def test_apply_corrects_a_recording_to_specific_force_and_rates(
    tmp_path: Path, said: Callable[..., str]
):
    path = run_file(tmp_path, FERRARIS)
    said("simulate", path)
    said("calibrate", path, "--out", tmp_path, "--no-report")
    calibration, out = tmp_path / "run.calibration.json", tmp_path / "corrected.csv"
    printed = json.loads(said("apply", calibration, path, "--out", out, "--json"))
    before = out.read_bytes()
    with pytest.raises(AssertionError):
        said("apply", calibration, path, "--out", out)
    assert out.read_bytes() == before
    said("apply", calibration, path, "--out", out, "--force")
    table = np.genfromtxt(out, delimiter=",", names=True, skip_header=1)  # the mark
    counts = {"samples": table.size, "extrapolated": 0}
    assert printed == {"recording": str(out), **counts, "moved": [], "warnings": []}
    assert table.dtype.names == ("time", "fx", "fy", "fz", "wx", "wy", "wz")
    # x is up first: 4 s at rest. Before, its bias alone was 0.3 m/s² and gy's 0.5 °/s.
    rest = table[:200]
    norm = np.sqrt(rest["fx"] ** 2 + rest["fy"] ** 2 + rest["fz"] ** 2).mean()
    # The slopes of rests of 4 s leave a drift to the middle of the run open, to which k0 refers.
    assert norm == pytest.approx(9.81, abs=3e-3)
    assert [rest[name].mean() for name in ("wx", "wy", "wz")] == pytest.approx([0] * 3, abs=3e-4)
    # A turn about x by 360°, within its declared half a degree, after six holds and six moves.
    start, stop = 50 * (6 * 4 + 6 * 2), 50 * (6 * 4 + 6 * 2 + 2 + 1 + 4)  # two pauses of 1.5 s
    turned = table["wx"][start:stop].sum() / 50
    assert turned == pytest.approx(2 * np.pi, abs=5 * np.radians(0.5))


def test_apply_warns_of_a_calibration_that_is_not_to_be_relied_on(
    tmp_path: Path,
    said: Callable[..., str],
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
):
    path = run_file(tmp_path, FERRARIS)
    said("simulate", path)
    said("calibrate", path, "--out", tmp_path, "--no-report")
    file = tmp_path / "run.calibration.json"
    before = load(file)
    assert before.verdict is not None
    worse = replace(before.verdict, grade="unreliable", reasons=("the fit did not converge",))
    save(replace(before, verdict=worse), file)
    out = tmp_path / "c.csv"
    monkeypatch.setattr(
        "sys.argv", ["inercal", "apply", *map(str, (file, path)), "--out", str(out)]
    )
    with pytest.raises(SystemExit) as stop:
        main()
    assert not stop.value.code
    assert "the fit did not converge" in capsys.readouterr().err
    assert out.exists()


@pytest.mark.slow
def test_report_writes_the_page_alone(run: Path, tmp_path: Path, said: Callable[..., str]):
    page = tmp_path / "page.html"
    printed = json.loads(said("report", run, "--out", page, "--json"))
    assert printed["report"] == str(page)
    assert printed["verdict"]["grade"] == "consistent"
    assert names(tmp_path) == {"run.toml", "log.csv", "page.html"}


@pytest.mark.slow
def test_the_demonstration_finds_its_truth_within_the_stated_uncertainty(
    tmp_path: Path, said: Callable[..., str]
):
    folder = tmp_path / "new" / "demo"
    printed = json.loads(said("demo", "--quick", "--out", folder, "--seed", "1", "--json"))
    files = {"run_file", "log", "journal", "recording", "calibration_file", "report"}
    assert set(printed) == DOCUMENTED | files | {"truth"}
    assert names(folder) == {Path(printed[name]).name for name in files} | {"path.csv"}
    found = inercal.load(printed["calibration_file"])
    truth = np.array([printed["truth"].get(n, 0.0) for n in found.sensor.coefficients])
    error = found.values - truth
    p = error.size
    nees = error @ np.linalg.solve(found.covariance, error) / p
    # χ² with p degrees of freedom over p: four standard deviations either side of 1.
    assert abs(nees - 1) < 4 * sqrt(2 / p)


@pytest.mark.evidence
def test_the_demonstration_says_its_normalised_error(tmp_path: Path, said: Callable[..., str]):
    printed = said("demo", "--quick", "--out", tmp_path)
    (line,) = [line for line in printed.splitlines() if line.startswith("normalised squared error")]
    assert 0 < float(line.split(": ")[1].split(" ")[0]) < 2


def test_plan_says_whose_plan_needs_no_run_file(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    monkeypatch.setattr("sys.argv", ["inercal", "plan", "centrifuge-norm"])
    with pytest.raises(SystemExit) as stop:
        main()
    assert stop.value.code == 2
    assert "multi-position" in capsys.readouterr().err


def test_a_recording_on_a_rate_table_leaves_its_states_as_a_table(
    tmp_path: Path, said: Callable[..., str]
):
    example = Path(__file__).parents[2] / "examples/rate_table/ship_recording.toml"
    path = tmp_path / "ship.toml"
    path.write_text(example.read_text(encoding="utf-8"), encoding="utf-8")
    said("simulate", path)
    printed = said("calibrate", path, "--out", tmp_path, "--no-report")
    assert "ship.states.csv" in printed
    rows = (tmp_path / "ship.states.csv").read_text(encoding="utf-8").splitlines()
    assert rows[0].startswith("mounting,rpm,ax,ay,az,ax_sd")
    assert len(rows) == 1 + 25
