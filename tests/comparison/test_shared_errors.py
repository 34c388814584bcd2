"""Errors that two calibrations share cancel in their difference: simulated without inercal."""

import numpy as np
import pytest
from tests.repeatability.laboratory import KIND, Laboratory, draw
from tests.repeatability.sessions import sessions_of

from inercal.calibration.comparison import compare

UNCHANGED = Laboratory(turn_on=(0, 0, 0), mount=0)
PAIRS = 400


@pytest.mark.parametrize("stated", [True, False], ids=["stated", "not stated"])
def test_pairs_without_a_change(stated: bool):
    """Of the note: χ² 12.0 of 12 and 4.6 % of |E_n| > 1; without the statement 9.4 and 0.3 %."""
    chi2, beyond = np.zeros(PAIRS), np.zeros(12)
    for k in range(PAIRS):
        drawn = draw(UNCHANGED, 2, np.random.default_rng([1, k]))
        first, second = (one.calibration for one in sessions_of(drawn, stated=stated))
        compared = compare(first, second)
        assert compared.joint_test is not None
        chi2[k] = compared.joint_test.chi2
        beyond += np.abs(compared.normalised_errors) > 1
    share = beyond[KIND == 2].mean() / PAIRS
    if stated:
        assert chi2.mean() == pytest.approx(12.0, abs=4 * np.sqrt(24 / PAIRS))
        assert share == pytest.approx(0.046, abs=0.02)
    else:
        assert chi2.mean() == pytest.approx(9.4, abs=1)
        assert share < 0.01


def test_what_is_shared_in_full_leaves_no_uncertainty_to_divide_by():
    drawn = draw(Laboratory(own=(1e-9, 1e-9, 1e-9)), 2, np.random.default_rng(1))
    first, second = (one.calibration for one in sessions_of(drawn))
    compared = compare(first, second)
    assert np.all(compared.difference_std > 0)
