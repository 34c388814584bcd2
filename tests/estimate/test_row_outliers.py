"""Rows judged by the scatter of the others."""

import numpy as np
import pytest
from scipy.stats import chi2

from inercal.estimation.residual_scatter import leave_one_out_factors


@pytest.mark.parametrize("scatter", [1.0, 3.0])
def test_a_row_exceeds_its_bound_as_often_as_stated_however_all_scatter(scatter: float):
    rng = np.random.default_rng(3)
    rows = scatter * rng.standard_normal((400, 24, 2))
    squares = np.array(
        [np.sum((leave_one_out_factors(one)[:, None] * one) ** 2, axis=1) for one in rows]
    )
    for level in (0.05, 0.005):
        assert np.mean(squares > chi2.isf(level, 2)) == pytest.approx(level, rel=0.3)


def test_one_row_that_is_off_stays_off():
    rows = np.random.default_rng(4).standard_normal((24, 2))
    rows[5] = 6.0
    factor = leave_one_out_factors(rows)
    assert factor[5] == 1.0
    assert np.all(factor <= 1.0)


def test_rows_that_agree_are_as_they_are():
    rows = 0.5 * np.random.default_rng(5).standard_normal((24, 2))
    np.testing.assert_array_equal(leave_one_out_factors(rows), 1.0)
    np.testing.assert_array_equal(leave_one_out_factors(rows[:1]), 1.0)
