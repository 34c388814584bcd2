import numpy as np
from numpy.testing import assert_allclose, assert_array_equal

from inercal.estimation.uncertainty.robust import (
    false_discovery_selection,
    robust_scale,
    squared_distances,
)


def correlated(rng: np.random.Generator, n: int, p: int) -> np.ndarray:
    root = np.linalg.cholesky(0.8 * np.ones((p, p)) + 0.2 * np.eye(p))
    return 100 + rng.normal(size=(n, p)) @ root.T * np.logspace(-3, 3, p)


def test_scale_of_normal_values_is_their_standard_deviation():
    rng = np.random.default_rng(1)
    assert_allclose(robust_scale(3 * rng.normal(size=(50_000, 2))), 3, rtol=0.02)


def test_distances_of_correlated_values_follow_chi_square():
    rng = np.random.default_rng(2)
    distances, shares = squared_distances(correlated(rng, 20_000, 6))
    assert_allclose(shares.sum(axis=1), distances)
    for chance, limit in ((0.5, 5.348), (0.05, 12.592), (0.001, 22.458)):
        error = np.sqrt(chance / 20_000)
        assert abs(np.mean(distances > limit) - chance) < 4 * error


def test_a_column_without_scatter_is_ignored():
    rng = np.random.default_rng(5)
    values = np.column_stack([rng.normal(size=500), np.full(500, 7.0)])
    distances, shares = squared_distances(values)
    assert np.isfinite(distances).all()
    assert_array_equal(shares[:, 1], 0)


def test_false_discovery_selection_of_benjamini_and_hochberg():
    """Their example of 1995, section 4: four of fifteen hypotheses at q = 5 %."""
    tails = np.array([
        0.0001, 0.0004, 0.0019, 0.0095, 0.0201, 0.0278, 0.0298, 0.0344, 0.0459, 0.3240, 0.4262,
        0.5719, 0.6528, 0.7590, 1.0000,
    ])  # fmt: skip
    assert_array_equal(false_discovery_selection(tails), [0, 1, 2, 3])
    assert len(false_discovery_selection(tails[9:])) == 0
