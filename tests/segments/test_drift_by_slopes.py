"""Recorded six positions with a drift of any size: errors are as stated, without a guess of it.

The recordings are those of `tests.evidence.cases.hand_recordings`, which know nothing of inercal.
"""

import numpy as np
import pytest
from scipy.special import chdtri
from tests.base_seeds import evidence
from tests.evidence import graded_calibration
from tests.evidence.cases import hand_recordings
from tests.evidence.graded_calibration import GradedCalibration

MG = 9.80665e-3
MOST_BEYOND = 0.07  # of coefficients beyond 2u, in sessions called consistent


def session(drift: float, seed: int, k: int) -> GradedCalibration:
    """Return what inercal says of one session of three axes that drift by `drift` either way."""
    case = hand_recordings.six_position()
    rng = np.random.default_rng([seed, k])
    values = case.draw(rng)
    truth = {name: values[name] for name in case.coefficients}
    for axis in "xyz" if drift else "":
        values[f"a{axis}.drift"] = float(drift * rng.uniform(0.5, 1.0) * rng.choice([-1, 1]))
    return graded_calibration.calibrate_files(dict(case.files(values, rng, None)), truth)


def counted(drift: float, sessions: int, seed: int) -> tuple[float, float, int]:
    """Return mean NEES, share beyond 2u in consistent sessions, and how many are consistent."""
    found = [session(drift, seed, k) for k in range(sessions)]
    quiet = [one for one in found if one.grade == "consistent"]
    beyond = sum(abs(e) > 2 for one in quiet for e in one.errors.values())
    total = sum(len(one.errors) for one in found)
    return float(np.mean([one.nees for one in found])), beyond / total, len(quiet)


@pytest.mark.slow
@pytest.mark.parametrize("sessions", [10, evidence(24)])
def test_a_session_without_a_drift_errs_as_stated(sessions: int):
    nees, _, quiet = counted(0.0, sessions, 3)
    dof = 12 * sessions
    assert float(chdtri(dof, 0.9995)) / dof < nees < float(chdtri(dof, 0.0005)) / dof
    assert quiet >= sessions - 1


@pytest.mark.evidence
@pytest.mark.parametrize("seed", [11, 12])
def test_recorded_six_positions_have_the_nees_of_the_base_case(seed: int):
    nees, _, quiet = counted(0.0, 300, seed)
    band = max(0.05, 3.29 * np.sqrt(2 / (12 * 300)))
    assert nees == pytest.approx(1.0, abs=band)
    assert quiet >= 294


@pytest.mark.evidence
@pytest.mark.parametrize("drift", [0.2 * MG, 0.3 * MG, 0.5 * MG, 1.0 * MG])
def test_a_drift_of_any_size_leaves_errors_as_stated(drift: float):
    nees, beyond, _ = counted(drift, 100, 21)
    assert beyond <= MOST_BEYOND
    assert nees < 1 + 3.29 * np.sqrt(2 / 1200)
