"""Tests of innovations by groups: quiet for white noise, loud for what its sum of squares hides."""

import numpy as np
import pytest
from scipy.stats import kstest

from inercal.estimation import innovations

GROUPS, EACH, M = 30, 200, 3
GROUP = np.repeat(np.arange(GROUPS), EACH)


def p_values(standard: np.ndarray) -> list[float]:
    z = innovations.group_innovations(standard, GROUP)
    return [one.p_value for one in innovations.mean_and_whiteness_tests(z, "means", "whiteness")]


def test_p_values_of_white_noise_are_uniform():
    rng = np.random.default_rng(5)
    found = np.array([p_values(rng.standard_normal((GROUP.size, M))) for _ in range(300)])
    for column in found.T:
        assert kstest(column, "uniform").pvalue > 1e-3


def test_few_groups_have_no_more_small_p_values_than_they_should():
    rng = np.random.default_rng(12)
    for g in (8, 11):
        made = [
            innovations.mean_and_whiteness_tests(rng.standard_normal((g, M)), "", "")[1].p_value
            for _ in range(4000)
        ]
        assert np.mean(np.array(made) < 1e-2) < 1e-2 + 3.3 * np.sqrt(1e-2 / 4000)


def test_whiteness_takes_every_pair_of_neighbours():
    for g in (8, 9):
        z = np.random.default_rng(g).standard_normal((g, M))
        (_, made) = innovations.mean_and_whiteness_tests(z, "", "")
        padded = np.concatenate([z, np.zeros((1, M))])
        variance = sum(np.sum((z[i - 1] + padded[i + 1]) ** 2) for i in range(1, g, 2))
        assert made.statistic == pytest.approx(np.sum(z[:-1] * z[1:]) ** 2 / variance, rel=1e-12)


def test_a_bias_of_half_a_deviation_in_one_group_of_thirty_is_seen():
    standard = np.random.default_rng(6).standard_normal((GROUP.size, M))
    before = p_values(standard)[0]
    standard[GROUP == 4] += 0.5
    after = p_values(standard)[0]
    assert before > 0.01
    assert after < 1e-6
    # The sum of squares does not see it.
    assert np.sum(standard**2) / standard.size == pytest.approx(1.0, abs=0.05)


def test_groups_that_hang_together_are_seen():
    rng = np.random.default_rng(8)
    slow = np.zeros((GROUPS, M))
    for k in range(1, GROUPS):
        slow[k] = 0.9 * slow[k - 1] + np.sqrt(1 - 0.81) * rng.standard_normal(M)
    standard = np.sqrt(0.2) * rng.standard_normal((GROUP.size, M))
    standard += np.sqrt(0.8 / EACH) * slow[GROUP]
    assert p_values(standard)[1] < 1e-3


def test_epochs_without_a_group_or_an_observation_are_left_out():
    standard = np.ones((6, 2))
    standard[1] = np.nan
    z = innovations.group_innovations(standard, np.array([0, 0, 0, -1, 2, 2]))
    np.testing.assert_allclose(z, np.sqrt(2) * np.ones((2, 2)))


def test_an_innovation_that_was_not_observed_is_no_number():
    made = innovations.standardised_innovations(np.array([[2.0, 0.0]]), np.array([[4.0, 0.0]]))
    assert made[0, 0] == 1.0
    assert np.isnan(made[0, 1])


def test_means_of_residuals_of_a_fit_are_chi_squared():
    rng = np.random.default_rng(9)
    design = rng.standard_normal((GROUP.size, 12)) + 3 * rng.standard_normal((GROUPS, 12))[GROUP]
    prior = np.eye(12)  # each was known to ± 1, and is drawn so
    covariance = np.asarray(np.linalg.inv(design.T @ design + prior), dtype=float)
    slope = innovations.group_innovations(design, GROUP)
    found: list[float] = []
    for _ in range(300):
        x = rng.standard_normal(12)
        y = design @ x + rng.standard_normal(GROUP.size)
        residual = y - design @ (covariance @ (design.T @ y))
        z = innovations.group_innovations(residual[:, None], GROUP).ravel()
        made = innovations.residual_mean_test(z, slope, covariance, "means")
        assert made.dof == GROUPS
        found.append(made.p_value)
    assert kstest(found, "uniform").pvalue > 1e-3
