"""The demonstration over twenty seeds: its uncertainties are as large as its errors.

python -m pytest -m evidence -s tests/host/test_demonstration_consistency.py
"""

from pathlib import Path

import numpy as np
import pytest

from inercal.host.demonstration import demo

SEEDS = range(20)


@pytest.mark.evidence
def test_twenty_demonstrations_err_as_they_say(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    nees, verdicts = list[float](), list[str]()
    for seed in SEEDS:
        shown = demo(tmp_path / f"{seed}", seed)
        groups = shown.outcome.estimate.groups
        nis = [one.chi2 / one.dof for one in groups]
        nees.append(shown.nees)
        verdicts.append(shown.outcome.verdict.grade)
        with capsys.disabled():
            print(f"\nseed {seed}: NEES {shown.nees:.2f}, NIS {nis}, {verdicts[-1]}", end="")
        assert all(0.9 < one < 1.1 for one in nis)
        assert not any(
            "uncertainties too large" in line for line in shown.outcome.calibration.notes
        )
    assert 0.80 < np.mean(nees) < 1.21
    assert verdicts.count("consistent") >= 19
