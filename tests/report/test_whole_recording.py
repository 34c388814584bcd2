"""Residuals of a method that takes a whole recording at once."""

from pathlib import Path

import numpy as np
from tests.test_turntable_runs import path_of, recorded, run_of

from inercal.pipeline import calibrate
from inercal.report import write_report
from inercal.report.whole import by_step

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


def test_residuals_of_a_whole_recording_are_drawn_by_step(tmp_path: Path):
    run = recorded(
        run_of(tmp_path, ('"turntable_kalman"', '"turntable_trajectory"'), path=path_of(*KEPT))
    )
    outcome = calibrate(run)
    gyros, accelerometers = by_step(outcome)
    assert gyros.labels == (*KEPT, "moves")
    assert accelerometers.labels == tuple(name for name in KEPT if name[-1] not in "+-")
    for one in (gyros, accelerometers):
        # The means are what coefficients are fitted to.
        assert 0.3 < np.sqrt(np.mean(one.mean**2)) < 1.5
        size = float(np.sum(one.members[:, None] * one.rms**2) / 3 / one.members.sum())
        assert 0.7 < size < 1.1
    total = sum(float(np.sum(one.members[:, None] * one.rms**2)) for one in (gyros, accelerometers))
    assert total <= np.sum(outcome.estimate.whitened**2) * (1 + 1e-9)
    text = write_report(outcome, tmp_path / "page.html").read_text(encoding="utf-8")
    assert "Residuals of the whole recording" in text
    assert "Each dot is" not in text
