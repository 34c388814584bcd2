"""Sheets of a turntable's paths, by each of its methods."""

from pathlib import Path

import numpy as np
import pytest
from tests.refusals import refused
from tests.runs.test_turntable_runs import copy_run, path_with_labels, simulate_recording

from inercal.basics.errors import NotObserved
from inercal.cli.app import app
from inercal.pipeline import calibrate
from inercal.pipeline.design.turntable_path import turntable_path_sheet


@pytest.mark.slow
@pytest.mark.parametrize("method", ["turntable_discrete", "turntable_trajectory"])
def test_a_path_is_planned_by_the_methods_own_estimator(tmp_path: Path, method: str):
    run = simulate_recording(copy_run(tmp_path, ('"turntable_kalman"', f'"{method}"')))
    sheet = turntable_path_sheet(run)
    assert [one.name for one in sheet.expected] == list(run.sensor.coefficients)
    estimate = calibrate(run).estimate
    stated = np.sqrt(np.diagonal(estimate.covariance)[:24])
    np.testing.assert_allclose([one.std for one in sheet.expected], stated, rtol=0.15)


def test_a_path_that_leaves_directions_open_says_so_by_each_method(tmp_path: Path):
    for method in ("turntable_discrete", "turntable_trajectory"):
        change = ('"turntable_kalman"', f'"{method}"')
        run = copy_run(tmp_path, change, path=path_with_labels("warm-up", "y up", "z down"))
        with refused(NotObserved, file="mimu.toml"):
            turntable_path_sheet(run)


def test_what_a_path_leaves_open_is_a_dash_with_advice(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    run = copy_run(tmp_path, path=path_with_labels("warm-up", "y up", "z down"))
    app(["plan", "turntable-kalman", "--run", str(run.path)], standalone_mode=False)
    printed = capsys.readouterr().out
    assert "40000" not in printed
    assert any(line.split("│")[3].strip() == "—" for line in printed.splitlines() if "gy." in line)
    assert "Turn about each axis of the body" in printed
