"""The bench and the method of `examples/own_bench`, as another package brings them."""

import csv
import json
import os
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import chi2
from tests.base_seeds import evidence
from tests.external_bench import FOLDER, register_example_bench

from inercal.basics.errors import InputError
from inercal.benches import MeanMotion
from inercal.benches.contract import NoReadingOffsets
from inercal.benches.contradicting_rows import contradicting_rows
from inercal.physics.motion import Motion
from inercal.physics.sensors import triad
from inercal.pipeline import calibrate, simulate, simulate_files
from inercal.pipeline.budget import budget
from inercal.pipeline.budget.experiment_from_runfile import experiment_from_run
from inercal.pipeline.design.worksheet import build_worksheet, worksheet_csv
from inercal.recordings import Observations
from inercal.recordings.io.write import write_recording
from inercal.report import write_report
from inercal.runfile import read

# Devices of a test; the band is that of χ², 99.9 % two-sided.
DEVICES = pytest.mark.parametrize("devices", [10, evidence(40)])


@pytest.fixture
def run_file(tmp_path: Path) -> Iterator[Path]:
    with register_example_bench(tmp_path) as path:
        yield path


def recorded(path: Path, seed: int = 1) -> None:
    run = read(path)
    for name, recording in simulate_files(run, seed).items():
        write_recording(recording, run.file(name))


def means(path: Path, seed: int) -> None:
    """Fill the worksheet as an operator does, and let the run file read it."""
    run = read(path)
    made = build_worksheet(run)
    sensor = run.sensor.with_coefficients(*run.truth)
    bench, rng = run.bench, np.random.default_rng(seed)
    steps = run.steps
    drawn = {
        name: np.array(one.value + one.sd * rng.standard_normal())
        for name, one in bench.nuisances(steps, sensor).items()
    }
    motion = run.bench.mean_motion(steps, drawn).motion  # pyright: ignore[reportAttributeAccessIssue]
    c = np.array([run.truth[name] for name in sensor.coefficients])
    read_in = sensor.to_output(sensor.forward(motion, c))
    read_in = read_in + 30e-6 * rng.standard_normal(read_in.shape)
    header, *rows = csv.reader(worksheet_csv(made).splitlines())
    with run.file("sheet.csv").open("w", encoding="utf-8", newline="") as file:
        filled = csv.writer(file)
        filled.writerow(header)
        for row, values in zip(rows, read_in.tolist(), strict=True):
            filled.writerow([*row[:2], *(f"{value:.9f}" for value in values)])
    text = path.read_text(encoding="utf-8")
    for old, new in (
        ('file = "tilt.csv"', 'file = "sheet.csv"\nkind = "means"'),
        ('white = "60 µg/√Hz"\n', ""),
        ('label = "position"\nmarks = "labels"\n', ""),
        ("[method]", '[data.sd]\naccelerometer = "30 µg"\n[method]'),
    ):
        assert old in text
        text = text.replace(old, new)
    path.with_name("means.toml").write_text(text, encoding="utf-8")


def nees(path: Path) -> float:
    found = calibrate(path)
    assert found.verdict.grade in ("consistent", "reservations")
    sensor, truth = found.calibration.sensor, read(path).truth
    error = found.calibration.values - [truth.get(name, 0.0) for name in sensor.coefficients]
    return float(error @ np.linalg.solve(found.calibration.covariance, error)) / len(error)


def require_stated(ratios: list[float]) -> None:
    """Hold the mean NEES of devices with 12 coefficients to the band of χ²."""
    dof = 12 * len(ratios)
    low, high = chi2.ppf([5e-4, 1 - 5e-4], dof) / dof
    assert low < np.mean(ratios) < high


@pytest.mark.slow
@DEVICES
def test_it_is_calibrated_from_a_recording(run_file: Path, devices: int):
    ratios: list[float] = []
    for seed in range(devices):
        recorded(run_file, seed)
        ratios.append(nees(run_file))
    require_stated(ratios)


@pytest.mark.slow
@DEVICES
def test_it_is_calibrated_from_its_worksheet_filled(run_file: Path, devices: int):
    ratios: list[float] = []
    for seed in range(devices):
        means(run_file, seed)
        ratios.append(nees(run_file.with_name("means.toml")))
    require_stated(ratios)


def test_a_violation_of_its_model_is_said(run_file: Path):
    text = run_file.read_text(encoding="utf-8")
    run_file.write_text(
        text.replace('"ax.k0" = "12 mg"', '"ax.k0" = "12 mg"\n"ax.k3" = "2 mg/g³"'),
        encoding="utf-8",
    )
    recorded(run_file)
    verdict = calibrate(run_file).verdict
    assert verdict.grade != "consistent"
    assert verdict.suspect is not None
    assert "k3" in verdict.suspect.name


Rows = list[list[float | str]]


def plate_table(folder: Path, edit: Callable[[Rows], None]) -> Path:
    """Write a run file with a table of means in 16 attitudes, after a change of its rows."""
    rng = np.random.default_rng(3)
    gain = np.diag([1.004, 0.997, 1.002]) + 1e-3 * rng.standard_normal((3, 3))
    bias, rows = 0.01 * rng.standard_normal(3), Rows()
    for plane in ("xz", "yz"):
        for angle in range(0, 360, 45):
            sine, cosine = np.sin(np.radians(angle)), np.cos(np.radians(angle))
            f = np.array([sine * (plane == "xz"), sine * (plane == "yz"), cosine])
            read_in = gain @ f + bias + 3e-5 * rng.standard_normal(3)
            rows.append([plane, float(angle), *read_in.tolist()])
    edit(rows)
    lines = (",".join([row[0], *(f"{x:.6f}" for x in row[1:])]) for row in rows)  # type: ignore
    (folder / "means.csv").write_text("plane,angle,ax,ay,az\n" + "\n".join(lines), "utf-8")
    text = (folder / "tilt.toml").read_text(encoding="utf-8")
    for old, new in (
        ('file = "tilt.csv"', 'file = "means.csv"\nkind = "means"'),
        ('white = "60 µg/√Hz"\n', ""),
        ('label = "position"\nmarks = "labels"\n', ""),
        ("[method]", '[data.sd]\naccelerometer = "30 µg"\n[method]'),
    ):
        text = text.replace(old, new)
    (folder / "means.toml").write_text(text, encoding="utf-8")
    return folder / "means.toml"


def reverse(rows: Rows) -> None:
    rows[2][2] = -float(rows[2][2])


def multiply(rows: Rows) -> None:
    rows[3][4] = 10 * float(rows[3][4])


def exchange(rows: Rows) -> None:
    rows[2][2:], rows[12][2:] = rows[12][2:], rows[2][2:]


def test_a_fit_that_fails_names_the_wrong_row(run_file: Path, tmp_path: Path):
    assert calibrate(plate_table(tmp_path, lambda _: None)).verdict.grade == "consistent"
    with pytest.raises(InputError, match="sign of ax") as caught:
        calibrate(plate_table(tmp_path, reverse))
    assert caught.value.names == ("xz 90",)


@pytest.mark.parametrize(
    ("edit", "rows"), [(multiply, ("xz 135",)), (exchange, ("xz 90", "yz 180"))]
)
def test_rows_that_a_fit_cannot_meet_are_named_as_the_cause(
    run_file: Path, tmp_path: Path, edit: Callable[[Rows], None], rows: tuple[str, ...]
):
    found = calibrate(plate_table(tmp_path, edit)).verdict
    assert found.grade == "unreliable"
    (line,) = (one for one in found.lines if one.startswith("Most likely cause"))
    assert all(row in line for row in rows)


def test_gyros_on_a_bench_of_ones_own_are_compared_with_its_rates():
    """A wheel about z, with three axes of the sensor along it one after the other."""

    class Wheel(NoReadingOffsets):
        def mean_motion(self, steps: Sequence[int], q: object) -> MeanMotion:
            w = np.array([np.eye(3)[k % 3] * (-1) ** k * (1 + k) for k in steps])
            return MeanMotion(Motion(0 * w, w))

    for name in ("parameters", "gravity", "nuisances", "__dataclass_fields__"):
        setattr(Wheel, name, {})
    steps, sensor = range(12), triad("g", "w", "xyz")
    rng = np.random.default_rng(1)
    y = Wheel().mean_motion(steps, {}).w * 1.01 + 0.02 + 1e-4 * rng.standard_normal((12, 3))
    labels = tuple(f"row {k}" for k in steps)

    def found() -> tuple[str, tuple[str, ...]]:
        ones = np.ones(12)
        seen = Observations(
            labels,
            y,
            np.zeros((12, 3, 3)),
            ones,
            np.ones(12, dtype=np.int64),
            ones,
            sensor.channels,
            np.inf,
        )
        return contradicting_rows(seen, sensor, Wheel(), steps)

    assert found() == ("", ())
    y[4] *= -1
    assert found()[1] == ("row 4",)


def test_trials_are_simulated_together(run_file: Path):
    run = read(run_file)
    several = simulate(run, 3, trials=4)
    assert several.data.shape == (4, 16 * 500, 3)
    assert np.ptp(several.data.mean(axis=1), axis=0).min() > 0


def test_its_budget_is_the_covariance_of_its_estimator(run_file: Path):
    run = read(run_file)
    planned = {one.name: one.std for one in build_worksheet(run).expected}
    found = budget(experiment_from_run(run), trials=400)
    # A deviation of 400 draws is known to 3.5 %.
    for spread in (found.stated, found.total.first_order, found.total.monte_carlo):
        assert list(planned.values()) == pytest.approx(spread.tolist(), rel=0.12)


@pytest.mark.slow
def test_it_is_reported(run_file: Path, tmp_path: Path):
    recorded(run_file)
    outcome = calibrate(run_file)
    page = write_report(outcome, tmp_path / "report.html", read(run_file).truth)
    text = page.read_text(encoding="utf-8")
    assert "plane xz at 45°" in text
    assert "zero of the plate" in text


@pytest.mark.slow
def test_the_command_finds_it_by_its_entry_points(tmp_path: Path):
    site, work = tmp_path / "site", tmp_path / "work"
    info = site / "tilt_table-0.dist-info"
    info.mkdir(parents=True)
    work.mkdir()
    shutil.copy(FOLDER / "tilt_table.py", site)
    shutil.copy(FOLDER / "tilt.toml", work)
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: tilt-table\nVersion: 0\n")
    (info / "entry_points.txt").write_text(
        "[inercal.benches]\ntilt_table = tilt_table:KIND\n"
        "[inercal.methods]\ntilt_means = tilt_table:METHOD\n"
    )

    def inercal(*arguments: str) -> str:
        done = subprocess.run(
            [sys.executable, "-m", "inercal", *arguments],
            cwd=work,
            env={**os.environ, "PYTHONPATH": str(site)},
            capture_output=True,
            text=True,
            encoding="utf-8",
            check=False,
        )
        assert done.returncode == 0, done.stderr
        return done.stdout

    inercal("simulate", "tilt.toml")
    told = json.loads(inercal("calibrate", "tilt.toml", "--json"))
    assert told["verdict"]["grade"] == "consistent"
    assert len(told["coefficients"]) == 12
    assert "zero" in inercal("budget", "tilt.toml")
    assert "xz 45" in inercal("plan", "tilt-means", "--run", "tilt.toml")
