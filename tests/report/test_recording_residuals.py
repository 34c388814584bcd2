"""Residuals of a method that takes a whole recording at once."""

from pathlib import Path

import numpy as np
import pytest
from tests.runs.test_turntable_runs import copy_run, path_with_labels, simulate_recording

from inercal.pipeline import calibrate
from inercal.report import write_report
from inercal.report.traces import residuals_by_step

KEPT = (
    "warm-up",
    "y up",
    "z down",
    "y down",
    "x up",
    "slanted",
    "x+",
    "x-",
    "y+",
    "y-",
    "z+",
    "z-",
    "rest",
)


@pytest.mark.slow
def test_residuals_of_a_whole_recording_are_drawn_by_step(tmp_path: Path):
    run = simulate_recording(
        copy_run(
            tmp_path, ('"turntable_kalman"', '"turntable_trajectory"'), path=path_with_labels(*KEPT)
        )
    )
    outcome = calibrate(run)
    gyros, accelerometers = residuals_by_step(outcome)
    assert gyros.labels == (*KEPT, "moves")
    assert accelerometers.labels == tuple(name for name in KEPT if name[-1] not in "+-")
    for one in (gyros, accelerometers):
        # The means are what coefficients are fitted to.
        assert 0.3 < np.sqrt(np.mean(one.mean**2)) < 1.5
        size = float(np.sum(one.counts[:, None] * one.rms**2) / 3 / one.counts.sum())
        assert 0.7 < size < 1.1
    total = sum(float(np.sum(one.counts[:, None] * one.rms**2)) for one in (gyros, accelerometers))
    assert total <= np.sum(outcome.estimate.whitened**2) * (1 + 1e-9)
    text = write_report(outcome, tmp_path / "page.html").read_text(encoding="utf-8")
    assert "of the whole recording by step" in text
    assert "Each dot is" not in text
