"""Variances of random effects against closed forms, and limits of a standard deviation."""

import numpy as np
import pytest

from inercal.estimation.uncertainty.components import scatter_limits, variance_components
from inercal.estimation.uncertainty.repeated_measurements import (
    RandomEffect,
    block_matrix,
    effect_variances,
)


def test_one_value_with_equal_noise_has_the_closed_form():
    rng = np.random.default_rng(1)
    y = 3.0 * rng.standard_normal((8, 1))
    known = block_matrix(np.full((8, 1, 1), 4.0))
    found = effect_variances(y, known, [RandomEffect(np.ones((1, 1)), np.arange(8))])
    assert found.converged
    assert found.variance[0] == pytest.approx(max(np.var(y, ddof=1) - 4.0, 0), rel=1e-5)
    total = found.variance[0] + 4.0
    assert found.covariance[0, 0] == pytest.approx(2 * total**2 / 7, rel=1e-5)


def test_it_is_paule_and_mandel_where_noise_is_equal():
    rng = np.random.default_rng(2)
    y = 2.0 * rng.standard_normal(6)
    known = block_matrix(np.full((6, 1, 1), 1.0))
    effect = RandomEffect(np.ones((1, 1)), np.arange(6))
    found = effect_variances(y[:, None], known, [effect]).variance[0]
    assert found == pytest.approx(variance_components(y, np.ones(6)).within.sd ** 2, rel=1e-5)


def test_days_and_turn_ons_of_a_balanced_design_are_those_of_the_analysis_of_variance():
    rng = np.random.default_rng(3)
    day, turn_on = np.repeat(np.arange(6), 4), np.arange(24)
    y = 5.0 * rng.standard_normal(6)[day] + 2.0 * rng.standard_normal(24)
    means = y.reshape(6, 4).mean(axis=1)
    within = np.var(y.reshape(6, 4), axis=1, ddof=1).mean()
    between = np.var(means, ddof=1) - within / 4
    one = np.ones((1, 1))
    known = block_matrix(np.full((24, 1, 1), 1e-6))
    effects = [RandomEffect(one, day), RandomEffect(one, turn_on)]
    found = effect_variances(y[:, None], known, effects)
    np.testing.assert_allclose(found.variance, [between, within], rtol=1e-4)


def test_scatter_below_the_noise_is_zero_and_has_an_upper_limit():
    rng = np.random.default_rng(4)
    y = 0.1 * rng.standard_normal((5, 1))
    known = block_matrix(np.full((5, 1, 1), 1.0))
    found = effect_variances(y, known, [RandomEffect(np.ones((1, 1)), np.arange(5))])
    assert found.variance[0] == 0
    limits = scatter_limits(0.0, float(found.covariance[0, 0]), 4)
    assert limits.sd == limits.low == 0 < limits.high


def test_units_of_many_orders_do_not_matter():
    rng = np.random.default_rng(5)
    y = rng.standard_normal((7, 2))
    unit = np.array([1e-9, 1e3])
    effects = [RandomEffect(np.eye(2)[:, [k]], np.arange(7)) for k in range(2)]
    one = effect_variances(y, block_matrix(np.tile(0.1 * np.eye(2), (7, 1, 1))), effects)
    other = effect_variances(
        y * unit, block_matrix(np.tile(0.1 * np.diag(unit**2), (7, 1, 1))), effects
    )
    np.testing.assert_allclose(other.variance, one.variance * unit**2, rtol=1e-4)
