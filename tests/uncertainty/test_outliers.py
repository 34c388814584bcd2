"""Outliers: how many lots without one name any, and how many planted ones are found."""

import numpy as np
import pytest
from tests.base_seeds import evidence

from inercal.basics.arrays import Array
from inercal.estimation.uncertainty.robust import (
    NAMED_BY_CHANCE,
    find_outliers,
    robust_scale,
    squared_distances,
)

SIZES = (20, 50, 200, 1_000)
# Base seeds of the draws that are pooled: one, and in evidence three.
POOLED = [(1,), evidence((1, 2, 3))]


def lot(rng: np.random.Generator, n: int, p: int) -> Array:
    """Correlated coefficients of very different sizes."""
    root = np.linalg.cholesky(0.8 * np.ones((p, p)) + 0.2 * np.eye(p))
    return 100 + rng.normal(size=(n, p)) @ root.T * np.logspace(-3, 3, p)


def named(values: Array) -> list[int]:
    return find_outliers(values, squared_distances(values)[0]).tolist()


def test_outliers_of_unusual_correlation_do_not_hide_one_another():
    """A tenth of the rows differ against the correlation, each column within its usual range.

    Two of them are drawn nearer to the others than the farthest of 2 000 good rows.
    """
    rng = np.random.default_rng(3)
    values = lot(rng, 2_000, 5)
    middle, scale = np.median(values, axis=0), robust_scale(values)
    turned = np.array([1.5, -1.5, 1.5, -1.5, 1.5]) + 0.3 * rng.normal(size=(200, 5))
    values[:200] = middle + scale * turned
    found = named(values)
    assert len(set(range(200)) & set(found)) >= 198
    assert set(found) <= set(range(200))


def test_a_shifted_group_is_named_in_one_coefficient():
    rng = np.random.default_rng(4)
    values = rng.normal(size=(100, 3))
    values[:20, 1] += 12
    assert set(range(20)) <= set(named(values))


def test_constant_and_repeated_columns_name_nobody():
    rng = np.random.default_rng(5)
    one = rng.normal(size=(60, 1))
    assert named(np.hstack([one, one, np.full((60, 1), 7.0)])) == []
    assert named(np.zeros((60, 3))) == []


@pytest.mark.slow
@pytest.mark.parametrize("seeds", POOLED)
@pytest.mark.parametrize("p", [1, 4, 12])
def test_five_of_a_hundred_clean_lots_name_a_sensor(seeds: tuple[int, ...], p: int):
    """Pooled over sizes and base seeds; the band is that of the draws, two-sided 99.9 %."""
    counts, lots = 0, 0
    for seed in seeds:
        for n, repeats in zip(SIZES, (160, 80, 50, 30), strict=True):
            rng = np.random.default_rng((seed, n, p))
            counts += sum(bool(named(lot(rng, n, p))) for _ in range(repeats))
            lots += repeats
    spread = 3.29 * np.sqrt(NAMED_BY_CHANCE * (1 - NAMED_BY_CHANCE) / lots)
    assert counts / lots <= NAMED_BY_CHANCE + spread
    assert counts / lots >= NAMED_BY_CHANCE / 2 - spread


@pytest.mark.slow
@pytest.mark.parametrize("seeds", POOLED)
def test_planted_outliers_of_six_sigma_are_named(seeds: tuple[int, ...]):
    """One coefficient of one or four, and all of twelve, off by 6 standard deviations."""
    found, planted = 0, 0
    for seed in seeds:
        for n, repeats in zip(SIZES, (60, 60, 40, 20), strict=True):
            for p, off in ((1, 1), (4, 1), (12, 12)):
                rng = np.random.default_rng((seed, n, p, 6))
                for _ in range(repeats):
                    values = rng.normal(size=(n, p))
                    values[3, :off] += 6 * rng.choice([-1, 1], off)
                    found += 3 in named(values)
                    planted += 1
    assert found / planted >= 0.95
