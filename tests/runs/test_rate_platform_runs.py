"""Run files on a rate platform, from their examples: results, verdicts and plans."""

import shutil
from pathlib import Path

import numpy as np
import pytest
from tests.refusals import refused

from inercal.basics.errors import InercalError
from inercal.basics.keys import CoefficientName
from inercal.basics.units import format_value_and_uncertainty
from inercal.calibration.explanation import NEXT
from inercal.pipeline import calibrate, simulate_files
from inercal.pipeline.advisor import large_uncertainties
from inercal.pipeline.design.worksheet import build_worksheet
from inercal.recordings.io.write import write_recordings
from inercal.report import write_report
from inercal.runfile import read

ROOT = Path(__file__).parents[2]


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return Path(shutil.copytree(ROOT / "examples" / "rate_platform", tmp_path / "made"))


def changed(path: Path, *pairs: tuple[str, str]) -> Path:
    text = path.read_text(encoding="utf-8")
    for old, new in pairs:
        assert old in text
        text = text.replace(old, new)
    path.write_text(text, encoding="utf-8")
    return path


def test_the_page_shows_what_the_gyros_give(folder: Path):
    outcome = calibrate(folder / "gyros.toml")
    assert outcome.verdict.grade == "consistent"
    calibration = outcome.calibration
    text = (ROOT / "docs/how-to/rates-and-poses.md").read_text(encoding="utf-8")
    for name in calibration.sensor.coefficients:
        if name.startswith("gx"):
            si = calibration.sensor.coefficient(name).si
            cells = format_value_and_uncertainty(
                calibration.value(name) / si, 2 * calibration.uncertainty(name) / si
            )
            (line,) = (
                one
                for one in text.splitlines()
                if one.startswith(f"┃ {name} ") or one.startswith(f"│ {name} ")
            )
            assert [cell.strip() for cell in line.split("│")[3:5]] == list(cells)


def test_one_wrong_digit_that_no_residual_shows_makes_sizes_implausible(folder: Path):
    changed(folder / "gyros.csv", ("49.969", "44.969"))
    outcome = calibrate(folder / "gyros.toml")
    assert outcome.estimate.consistent
    assert outcome.verdict.warned == ("size",)
    assert outcome.verdict.grade == "reservations"


def test_a_row_that_was_pasted_twice_is_named(folder: Path):
    table = folder / "gyros.csv"
    lines = table.read_text(encoding="utf-8").splitlines(keepends=True)
    table.write_text("".join((*lines[:3], *lines[2:])), encoding="utf-8")
    verdict = calibrate(folder / "gyros.toml").verdict
    assert (verdict.grade, verdict.warned) == ("reservations", ("copies",))
    assert not any("…" in line for line in verdict.lines)


def test_rows_of_few_digits_may_be_equal(folder: Path):
    table = folder / "gyros.csv"
    head, *lines = table.read_text(encoding="utf-8").splitlines()
    cells = [line.split(",") for line in lines]
    coarse = [",".join((*row[:3], *(f"{float(x):.2f}" for x in row[3:]))) for row in cells]
    table.write_text("\n".join((head, *coarse)), encoding="utf-8")
    assert len({",".join(line.split(",")[3:]) for line in coarse}) < len(coarse)
    assert "copies" not in calibrate(folder / "gyros.toml").verdict.warned


@pytest.mark.slow
def test_an_imu_in_rates_and_poses_is_consistent_and_reported(folder: Path, tmp_path: Path):
    outcome = calibrate(folder / "imu.toml")
    assert outcome.verdict.grade == "consistent"
    page = write_report(outcome, tmp_path / "report.html").read_text(encoding="utf-8")
    assert "ppm of full scale" in page
    sd = {n: outcome.calibration.uncertainty(n) for n in outcome.calibration.sensor.coefficients}
    # Scale factors are no better than the rate of the table, misalignments than a setting.
    assert min(sd[f"g{a}.scale"] for a in "xyz") > 5e-4
    assert max(sd[f"a{a}.k1"] for a in "xyz") < 1e-4


@pytest.mark.slow
def test_one_term_that_is_left_out_is_named(folder: Path):
    stated = 'also = ["nonlinearity", "asymmetry"]\n'
    path = changed(folder / "gyros.toml", (stated, 'also = ["scale2", "asymmetry"]\n'))
    outcome = calibrate(path)
    assert outcome.verdict.grade == "unreliable"
    assert outcome.verdict.suspect is not None
    assert CoefficientName(outcome.verdict.suspect.name).term == "scale3"


def test_three_terms_that_are_left_out_are_no_single_cause(folder: Path):
    path = changed(folder / "gyros.toml", ('also = ["nonlinearity", "asymmetry"]\n', ""))
    verdict = calibrate(path).verdict
    assert verdict.grade == "unreliable"
    assert verdict.suspect is None
    assert verdict.best is not None
    assert CoefficientName(verdict.best.name).term in ("scale3", "scale_prime", "scale2")
    assert verdict.best.remaining_p_value < 0.01


def test_a_wrong_reading_is_named_with_its_row(folder: Path):
    table = folder / "gyros.csv"
    lines = table.read_text(encoding="utf-8").splitlines()
    cells = lines[8].split(",")
    # Of the gyro across the axis: that about it has as many coefficients as rates.
    lines[8] = ",".join([*cells[:3], f"{float(cells[3]) + 0.02:.7f}", *cells[4:]])
    table.write_text("\n".join(lines) + "\n", encoding="utf-8")
    outcome = calibrate(folder / "gyros.toml")
    assert outcome.verdict.grade == "unreliable"
    assert outcome.verdict.suspect is not None
    assert outcome.verdict.suspect.name == "y +50 °/s"


@pytest.mark.slow
def test_the_plan_expects_what_the_table_gives(folder: Path):
    path = changed(
        folder / "gyros.toml",
        ('name = "rates_and_poses"', 'name = "rates_and_poses"\npositions = 3'),
    )
    expected = {one.name: one.std for one in build_worksheet(read(path)).expected}
    found = calibrate(folder / "gyros.toml").calibration
    for name, sd in expected.items():
        assert found.uncertainty(name) == pytest.approx(sd, rel=0.05)  # δ of 17′ times a setting


@pytest.mark.slow
def test_a_recording_of_accelerometers_in_poses_needs_no_gyros(folder: Path):
    text = """[sensor.accelerometer]
unit = "g"
white = "50 µg/√Hz"
[sensor.truth]
"ax.k0" = "3 mg"
"az.k1" = "0.1 %"
[bench]
kind = "rate_platform"
gravity = "9.81 m/s² ± 0.1 mm/s²"
setting = "0.02 °"
attitude = "0.02 °"
mounting = "0.1 °"
[data]
file = "log.npz"
rate = "20 Hz"
label = "label"
marks = "labels"
accelerometer = ["ax", "ay", "az"]
[method]
name = "rates_and_poses"
attitudes = "tilted"
rates = []
positions = 3
seconds = "10 s"
"""
    path = folder / "poses.toml"
    path.write_text(text, encoding="utf-8")
    run = read(path)
    write_recordings({run.file(name): made for name, made in simulate_files(run, 1).items()})
    outcome = calibrate(run)
    assert outcome.verdict.grade == "consistent"
    calibration = outcome.calibration
    names = calibration.sensor.coefficients
    error = calibration.values - [run.truth.get(name, 0.0) for name in names]
    assert np.all(np.abs(error) < 5 * np.array([calibration.uncertainty(n) for n in names]))


@pytest.mark.slow
def test_an_uncertainty_that_hides_the_scale_factors_is_named(folder: Path):
    path = folder / "gyros.toml"
    run = read(path)
    expected = run.bench.nuisances(run.kind.observe(run).steps, run.sensor)
    assert large_uncertainties(run, expected) == ""
    changed(path, ('rate_scale = "5 ppm"', 'rate_scale = "100 %"'), ("also =", "# also ="))
    with refused(InercalError) as error:
        calibrate(path)
    assert "[bench] rate_scale" in str(error.value)


def test_means_that_scatter_less_than_stated_lead_to_the_stated_deviation(folder: Path):
    text = (folder / "gyros.toml").read_text(encoding="utf-8")
    (line,) = (one for one in text.splitlines() if one.startswith('gyro = "'))
    changed(folder / "gyros.toml", (line, 'gyro = "1 °/s"'))
    outcome = calibrate(folder / "gyros.toml")
    (step,) = (one for one in outcome.verdict.lines if one.startswith(NEXT))
    assert "[data.sd]" in step
