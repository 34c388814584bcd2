"""The test for one change of a mean: its false alarms, its power, and the change that it names."""

from typing import Any

import numpy as np
import pytest
from scipy import stats

from inercal.estimation.uncertainty.mean_shift import largest_mean_shift

DAYS, SERIES, TRIALS = 20, 6, 3000


def test_steady_series_are_named_at_most_as_often_as_stated(seed: int):
    rng = np.random.default_rng(seed)
    std = np.where(np.arange(DAYS)[:, None] % 3, 1.0, 2.0) * np.ones(SERIES)
    chances = [
        largest_mean_shift(std * rng.normal(size=std.shape), 7 * std**2).probability
        for _ in range(TRIALS)
    ]
    named = int(np.sum(np.array(chances) < 0.01))
    assert stats.binom.cdf(named, TRIALS, 0.001) > 1e-4  # not without power
    assert stats.binom.sf(named - 1, TRIALS, 0.01) > 1e-4


def test_one_place_gives_the_two_sample_t_test():
    rng = np.random.default_rng(1)
    values = rng.normal(size=(DAYS, 1)) + 8.0 * (np.arange(DAYS)[:, None] >= 14)
    found = largest_mean_shift(values, np.ones_like(values))
    expected: Any = stats.ttest_ind(values[14:, 0], values[:14, 0])
    assert (found.column, found.place) == (0, 14)
    assert found.shift == pytest.approx(values[14:].mean() - values[:14].mean())
    assert found.probability == pytest.approx((DAYS - 1) * expected.pvalue)
