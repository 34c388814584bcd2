import numpy as np
from numpy.testing import assert_allclose
from scipy import stats
from tests.refusals import refused

from inercal.estimation import Problem, least_squares

DESIGN = np.vander(np.linspace(-1, 1, 20), 3, increasing=True)


def fit(sd: float, trials: int = 200):
    y = sd * np.random.default_rng(4).normal(size=(trials, 20))
    problem = Problem(
        ("a", "b", "c"),
        np.zeros(3),
        lambda x: (y - x @ DESIGN.T, DESIGN),
        np.ones(20),
        np.ones(3),
        wanted=("a", "c"),
    )
    return least_squares(problem)


def test_birge_ratio_is_one_within_the_bound_and_the_root_of_reduced_chi2_beyond():
    estimate = fit(1.2)
    bound = stats.chi2.ppf(0.95, 17)
    inside = estimate.chi2 <= bound
    assert inside.any()
    assert not inside.all()
    assert_allclose(estimate.birge[inside], 1.0)
    assert_allclose(estimate.birge[~inside], np.sqrt(estimate.chi2[~inside] / 17))
    np.testing.assert_array_equal(estimate.consistent, inside)
    assert_allclose(estimate.p_value, stats.chi2.sf(estimate.chi2, 17))
    plain = np.sqrt(np.diagonal(estimate.covariance, axis1=-2, axis2=-1))
    assert_allclose(estimate.std, estimate.birge[:, None] * plain)


def test_five_percent_of_good_fits_are_called_inconsistent():
    rejected = np.mean(~fit(1.0, trials=20_000).consistent)
    assert abs(rejected - 0.05) < 4 * np.sqrt(0.05 * 0.95 / 20_000)


def test_without_degrees_of_freedom_there_is_nothing_to_judge():
    exact = least_squares(
        Problem(("a",), np.zeros(1), lambda x: (3 - x, np.eye(1)), np.ones(1), np.ones(1))
    )
    assert exact.dof == 0
    assert exact.birge == 1.0
    assert exact.p_value == 1.0


def test_selection_keeps_values_with_their_covariance():
    estimate = fit(1.0)
    part = estimate.select(("c", "a"))
    assert part.names == ("c", "a")
    assert part.wanted == ("a", "c")
    assert_allclose(part.value, estimate.value[:, [2, 0]])
    assert_allclose(part.covariance, estimate.covariance[:, [2, 0]][:, :, [2, 0]])
    assert_allclose(part.correlation[:, 0, 1], estimate.correlation[:, 2, 0])
    with refused(names=("d",)):
        estimate.select(("d",))


def test_correlation_is_that_of_the_covariance():
    estimate = fit(1.0)
    assert_allclose(np.diagonal(estimate.correlation, axis1=-2, axis2=-1), 1.0)
    inverse = np.linalg.inv(DESIGN.T @ DESIGN)
    assert_allclose(
        estimate.correlation[0, 0, 2], inverse[0, 2] / np.sqrt(inverse[0, 0] * inverse[2, 2])
    )
