"""The reduced table of a recording on a rate table, and a calibration from it."""

import csv
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from inercal.basics.errors import InputError
from inercal.cli.calibrate_command import run as command
from inercal.physics.plan import Spin
from inercal.pipeline import Outcome, apply_data_columns, calibrate, simulate
from inercal.recordings.io.mean_tables import write_means
from inercal.recordings.io.write import write_recording
from inercal.runfile import Run, read

FOLDER = Path(__file__).parents[2] / "examples" / "rate_table"


def write_states_table(folder: Path) -> tuple[Run, Outcome, Path]:
    """Simulate the example, calibrate it, and write its states."""
    text = (FOLDER / "ship_recording.toml").read_text(encoding="utf-8")
    path = folder / "ship_recording.toml"
    path.write_text(text, encoding="utf-8")
    run = read(path)
    write_recording(apply_data_columns(run, simulate(run, 4)), run.file(run.data.file))
    outcome = calibrate(run)
    states = folder / "ship.states.csv"
    write_means(states, run.kind.tables(run, outcome)["states"])
    means = text.replace('file = "ship_recording.csv"', 'kind = "means"\nfile = "ship.states.csv"')
    # Of means the noise is in the columns of their deviations.
    for line in ('white = "300 µg/√Hz"\n', 'quantisation = "122.0703125 µg"  # one LSB\n'):
        assert line in means
        means = means.replace(line, "")
    (folder / "means.toml").write_text(means, encoding="utf-8")
    return run, outcome, states


def test_states_are_a_table_of_rates_against_three_axes(tmp_path: Path):
    run, outcome, path = write_states_table(tmp_path)
    with path.open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    assert list(rows[0]) == [
        "mounting", "rpm", "ax", "ay", "az", "ax_sd", "ay_sd", "az_sd", "turns", "seconds",
    ]  # fmt: skip
    assert len(rows) == len(run.steps)
    first = [(row["mounting"], round(float(row["rpm"])), int(row["turns"])) for row in rows[:4]]
    assert first[0] == ("XY", 0, 0)
    assert [name[:2] for name in first[1:]] == [("XY", 46), ("XY", 86), ("YX", 0)]
    # 15 s and what of settling was not needed.
    assert 10 <= first[1][2] <= 13
    assert 20 <= first[2][2] <= 24
    for row, turns in ((rows[1], first[1][2]), (rows[2], first[2][2])):
        assert float(row["seconds"]) == pytest.approx(turns * 60 / float(row["rpm"]), abs=0.03)
    # White noise and rounding of an LSB: 300 µg/√Hz, 1/√12 at 50 Hz.
    density = np.hypot(300e-6 * 8192, 1 / np.sqrt(12 * 50))
    for row in rows:
        expected = density / np.sqrt(float(row["seconds"]))
        assert float(row["ay_sd"]) == pytest.approx(expected, rel=0.35)
    turning = [step for step in outcome.steps if isinstance(step, Spin) and step.rate]
    assert sum(row["turns"] != "0" for row in rows) == len(turning)


@pytest.mark.slow
def test_the_table_gives_the_calibration_of_its_recording(tmp_path: Path):
    run, outcome, _ = write_states_table(tmp_path)
    again = calibrate(tmp_path / "means.toml")
    # The table holds no correlations between the axes' noise: without them, the same to rounding.
    covariance = outcome.observations.covariance * np.eye(3)
    alone = replace(outcome.observations, covariance=covariance)
    same = run.method.estimator("joint")(alone, run.sensor, run.bench, outcome.steps, ())
    p = len(run.sensor.coefficients)
    sd = same.std[:p]
    assert (again.estimate.value[:p] - same.value[:p]) / sd == pytest.approx(0, abs=1e-6)
    assert again.estimate.std[:p] == pytest.approx(sd, rel=1e-6)
    off = (again.calibration.values - outcome.calibration.values) / outcome.calibration.std
    assert np.abs(off).max() < 0.3
    assert again.estimate.consistent


def test_a_table_of_means_leaves_no_states():
    run = read(FOLDER / "ship.toml")
    assert not run.kind.tables(run, calibrate(run))


@pytest.mark.slow
def test_states_are_not_written_over_their_recording(tmp_path: Path):
    run, _, states = write_states_table(tmp_path)
    recording = run.file(run.data.file)
    recording.replace(states)
    text = run.path.read_text(encoding="utf-8").replace(recording.name, states.name)
    (tmp_path / "ship.toml").write_text(text, encoding="utf-8")
    before, files = states.read_bytes(), set(tmp_path.iterdir())
    with pytest.raises(InputError):
        command([tmp_path / "ship.toml"], out=tmp_path, with_report=False, register=None)
    assert states.read_bytes() == before
    assert set(tmp_path.iterdir()) == files


@pytest.mark.parametrize(
    ("column", "cell", "place"),
    [
        ("ay_sd", "0", "line 3: column 'ay_sd'"),
        ("ay_sd", "nan", "line 3: column 'ay_sd'"),
        (None, "", "[data.sd] accelerometer"),
    ],
)
def test_invalid_deviations_are_refused(tmp_path: Path, column: str | None, cell: str, place: str):
    _, _, path = write_states_table(tmp_path)
    header, *rows = csv.reader(path.read_text(encoding="utf-8").splitlines())
    if column is None:
        header = [name.replace("_sd", " sd") for name in header]
    else:
        rows[1][header.index(column)] = cell
    with path.open("w", encoding="utf-8", newline="") as file:
        csv.writer(file).writerows([header, *rows])
    with pytest.raises(InputError) as refusal:
        calibrate(tmp_path / "means.toml")
    assert place in str(refusal.value)


@pytest.mark.slow
def test_stated_deviations_override_the_columns(tmp_path: Path):
    write_states_table(tmp_path)
    path = tmp_path / "means.toml"
    text = path.read_text(encoding="utf-8")
    stated = text.replace("[method]", '[data.sd]\naccelerometer = "2 mg"\n\n[method]')
    path.write_text(stated, encoding="utf-8")
    covariance = calibrate(path).observations.covariance
    assert np.sqrt(covariance[:, 0, 0]) == pytest.approx(2e-3 * 9.80665)


@pytest.mark.slow
def test_a_wrong_radius_of_one_mounting_is_to_be_measured_again_there(tmp_path: Path):
    source = Path(__file__).parents[2] / "examples" / "rate_table"
    head, *rows = (source / "ship.csv").read_text(encoding="utf-8").splitlines()
    mounting, az = head.split(",").index("mounting"), head.split(",").index("az")
    for k, row in enumerate(rows):
        cells = row.split(",")
        if cells[mounting] == "ZY":
            cells[az] = str(float(cells[az]) * 1.026)
        rows[k] = ",".join(cells)
    (tmp_path / "ship.csv").write_text("\n".join([head, *rows]), encoding="utf-8")
    shutil.copy(source / "ship.toml", tmp_path)
    verdict = calibrate(tmp_path / "ship.toml").verdict
    assert verdict.suspect is not None
    assert verdict.suspect.name == "seat[ZY]"
    (step,) = (line for line in verdict.lines if line.startswith("Next"))
    assert "ZY" in step
