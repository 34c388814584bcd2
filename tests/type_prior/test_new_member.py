"""The prediction of a new member of a population, against Student's t and by coverage."""

from itertools import product

import numpy as np
import pytest
from scipy import stats
from tests.base_seeds import chosen
from tests.type_prior.populations import Array, draw

from inercal.estimation.uncertainty.new_member import (
    left_out_p_values,
    predict_new_member,
    scatter_correlation,
)

Y = np.array([1.0, 2.0, 4.0, 3.0, 7.0])
K = 2.0  # U = K sd
P = 0.9545


def test_exact_measurements_give_students_t():
    found = predict_new_member(Y, np.zeros((5, 5)))
    width = stats.t.ppf((1 + P) / 2, 4) * np.std(Y, ddof=1) * np.sqrt(1 + 1 / 5)
    assert found.mean == pytest.approx(np.mean(Y))
    assert K * found.sd == pytest.approx(width, rel=1e-6)
    assert found.dof == pytest.approx(4, rel=1e-4)
    assert found.between_sensors == pytest.approx(np.std(Y, ddof=1), rel=1e-6)
    # The variance of the mean is 1/N of that between members.
    assert found.mean_share == pytest.approx(1 / 6, rel=1e-6)


def test_reml_agrees_with_a_search_of_the_restricted_likelihood():
    rng = np.random.default_rng(4)
    s2 = np.exp(rng.standard_normal(8))
    y = 2 * rng.standard_normal(8) + np.sqrt(s2) * rng.standard_normal(8)

    def restricted(t2: float) -> float:
        w = 1 / (t2 + s2)
        m = w @ y / w.sum()
        return float(np.log(t2 + s2).sum() + np.log(w.sum()) + w @ (y - m) ** 2)

    grid = np.linspace(0, 40, 400_001)
    best = grid[np.argmin([restricted(t2) for t2 in grid[::100]]) * 100]
    assert predict_new_member(y, np.diag(s2)).between_sensors ** 2 == pytest.approx(best, abs=0.02)


def test_an_error_of_the_bench_widens_the_mean_but_is_no_scatter():
    alone = predict_new_member(Y, 0.1 * np.eye(5))
    together = predict_new_member(Y, 0.1 * np.eye(5) + 400.0)
    assert together.between_sensors == pytest.approx(alone.between_sensors, rel=1e-5)
    assert together.mean == pytest.approx(alone.mean, abs=1e-6)
    assert K * together.sd > K * 20.0 > 5 * alone.sd
    assert together.mean_share > 0.5 > alone.mean_share


def test_members_that_agree_better_than_their_uncertainty_keep_a_scatter():
    """REML gives 0 here, but the new member may still differ from the mean."""
    found = predict_new_member(np.array([0.1, -0.1, 0.0]), np.eye(3))
    assert found.between_sensors == 0
    assert found.sd > np.sqrt(1 / 3)


def test_units_do_not_matter():
    covariance = np.diag([1.0, 2.0, 1.0, 0.5, 1.0])
    one, small = predict_new_member(Y, covariance), predict_new_member(1e-9 * Y, 1e-18 * covariance)
    assert small.sd == pytest.approx(1e-9 * one.sd)
    assert small.dof == pytest.approx(one.dof, rel=1e-6)


def test_p_values_of_exact_measurements_are_those_of_deleted_residuals():
    others = Y[:4]
    t = (Y[4] - others.mean()) / (others.std(ddof=1) * np.sqrt(1 + 1 / 4))
    found = left_out_p_values(Y, np.zeros((5, 5)))
    assert found[4] == pytest.approx(2 * stats.t.sf(t, 3), rel=1e-4)
    far = left_out_p_values(np.array([0.0, 1e-3, -1e-3, 1.0]), np.zeros((4, 4)))
    t = (1 - 0) / (1e-3 * np.sqrt(1 + 1 / 3))
    assert far[3] == pytest.approx(2 * stats.t.sf(t, 2), rel=0.01)


def coverage(n: int, scatter: float, shared: float, draws: int, seed: int) -> float:
    """Return how often ± U contains a new sensor; the measurements have the size 1."""
    rng = np.random.default_rng([seed, n])
    inside = 0
    for _ in range(draws):
        made = draw(rng, n, np.array([scatter]), np.ones(1), shared=shared)
        covariance = np.diag(made.own[:, 0, 0]) + made.shared[0] ** 2
        found = predict_new_member(made.values[:, 0], covariance)
        inside += abs(made.new[0, 0] - found.mean) < K * found.sd
    return inside / draws


def band(draws: int, p: float = P) -> float:
    """Return half of the two-sided 99.9 % sampling band of a share."""
    return float(stats.norm.isf(0.0005) * np.sqrt(p * (1 - p) / draws))


@pytest.mark.slow
@pytest.mark.parametrize("n", [3, 10])
def test_a_new_sensor_lies_within_u_in_95_percent_of_a_small_sample(n: int):
    assert coverage(n, 2.0, 0.0, 60, 1) > P - band(60)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("n", "scatter"), chosen(product((3, 5, 10, 30), (4.0, 1.0)), [(3, 4.0), (5, 1.0), (30, 1.0)])
)
def test_a_new_sensor_lies_within_u_in_93_to_97_percent(n: int, scatter: float):
    """Also where measurements are as uncertain as the sensors scatter."""
    draws = 1000
    found = coverage(n, scatter, 0.0, draws, 2)
    assert min(0.93, P - band(draws)) < found < max(0.97, P + band(draws))


def correlation_of(values: Array) -> float:
    return float(np.asarray(np.corrcoef(values.T))[0, 1])


def test_correlations_of_exact_values_are_shrunk_as_stated():
    rng = np.random.default_rng(1)
    made = draw(rng, 6, np.array([2.0, 3.0]), np.array([1e-4, 1e-4]), correlation=0.6)
    scatter = np.std(made.values, axis=0, ddof=1)
    observed = correlation_of(made.values)
    (_, found), _ = scatter_correlation(made.values, made.own, scatter)[0]
    assert found == pytest.approx(observed * (6 - 1) / (6 + 2), rel=1e-3)


def test_many_sensors_show_their_correlation_in_spite_of_correlated_errors():
    rng = np.random.default_rng(2)
    made = draw(rng, 400, np.array([2.0, 3.0]), np.array([2.0, 3.0]), correlation=0.7)
    found, _ = scatter_correlation(made.values, made.own, np.array([2.0, 3.0]))
    # Errors with a correlation of -0.5 make the observed correlation near 0.1.
    assert abs(correlation_of(made.values)) < 0.25
    assert float(found[0, 1]) == pytest.approx(0.7, abs=0.12)


def test_the_covariance_of_the_mean_is_that_of_weighted_least_squares():
    own = np.array([np.eye(2) * s for s in (1.0, 2.0, 4.0)])
    _, of_mean = scatter_correlation(np.zeros((3, 2)), own, np.zeros(2))
    assert of_mean == pytest.approx(np.eye(2) / (1 + 1 / 2 + 1 / 4))


def test_correlations_of_a_coefficient_that_hardly_scatters_stay_definite():
    rng, scatter = np.random.default_rng(1), np.array([10.0, 1.0, 5.0])
    for _ in range(10):
        made = draw(rng, 30, scatter, np.array([2.0, 5.0, 5.0]), correlation=0.5)
        found, _ = scatter_correlation(made.values, made.own, scatter)
        assert np.array_equal(found, found.T)
        assert np.linalg.eigvalsh(found).min() > 0
