"""Sheets of a turntable's paths, by each of its methods."""

from pathlib import Path

import numpy as np
import pytest
from tests.test_turntable_runs import path_of, recorded, run_of

from inercal.design.on_turntable import worksheet
from inercal.errors import NotObserved
from inercal.pipeline import calibrate


@pytest.mark.parametrize("method", ["turntable_discrete", "turntable_trajectory"])
def test_a_path_is_planned_by_the_methods_own_estimator(tmp_path: Path, method: str):
    run = recorded(run_of(tmp_path, ('"turntable_kalman"', f'"{method}"')))
    sheet = worksheet(run)
    assert [one.name for one in sheet.expected] == list(run.sensor.coefficients)
    estimate = calibrate(run).estimate
    stated = np.sqrt(np.diagonal(estimate.covariance)[:24])
    np.testing.assert_allclose([one.std for one in sheet.expected], stated, rtol=0.15)


def test_a_path_that_leaves_directions_open_says_so_by_each_method(tmp_path: Path):
    for method in ("turntable_discrete", "turntable_trajectory"):
        change = ('"turntable_kalman"', f'"{method}"')
        run = run_of(tmp_path, change, path=path_of("warm-up", "y up", "z down"))
        with pytest.raises(NotObserved, match=r"mimu\.toml: (not observed|the data leave)"):
            worksheet(run)
