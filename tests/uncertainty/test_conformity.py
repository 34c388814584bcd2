import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.special import ndtri

from inercal.basics.errors import InputError
from inercal.estimation.uncertainty.conformity import (
    RESULTS,
    DecisionRule,
    conformance_probability,
    expanded_uncertainty,
    joint_conformance_probability,
    judge,
)

LOWER, UPPER = np.array(-1.0), np.array(1.0)


def results(rule: DecisionRule, values: list[float], u: float) -> list[str]:
    value = np.array(values)
    found = judge(value, LOWER, UPPER, rule.guard(np.full(value.shape, u)))
    return [RESULTS[k] for k in found]


def test_guard_bands_divide_the_values_of_ilac_g8():
    values = [-1.3, -1.15, -0.9, -0.7, 0.79, 0.85, 1.0, 1.2, 1.21]
    assert results(DecisionRule(), values, 0.1) == [
        "fail", "conditional fail", "conditional pass", "pass", "pass", "conditional pass",
        "conditional pass", "conditional fail", "fail",
    ]  # fmt: skip


def test_simple_acceptance_has_two_results():
    values = [-1.01, -1.0, 0.99, 1.0001]
    assert results(DecisionRule("simple"), values, 0.1) == ["fail", "pass", "pass", "fail"]


def test_a_limit_on_one_side_leaves_the_other_side_free():
    value, guard = np.array([-1e9, 0.7, 0.9]), np.full(3, 0.2)
    assert_array_equal(judge(value, np.array(-np.inf), UPPER, guard), [0, 0, 1])


@pytest.mark.parametrize(("factor", "risk"), [(1.0, 0.02275), (0.83, 0.0485), (1.5, 0.00135)])
def test_risk_on_the_acceptance_limit(factor: float, risk: float):
    """ILAC-G8:09/2019, table 1: below 2.5 % for w = U; ISO 14253-1:2017: below 5 % for .83 U."""
    u = np.array(0.01)
    value = UPPER - DecisionRule(factor=factor).guard(u)
    assert_allclose(1 - conformance_probability(value, u, LOWER, UPPER), risk, rtol=2e-3)


def test_expanded_uncertainty_of_few_degrees_of_freedom():
    """GUM, table G.2, 95.45 %."""
    dof = np.array([2, 4, 6, 9, 12, 18, np.inf])
    stated = [4.53, 2.87, 2.52, 2.32, 2.23, 2.15, 2.0]
    assert_allclose(expanded_uncertainty(np.ones(7), dof), stated, atol=5e-3)


def test_acceptance_limits_of_95_percent_with_students_distribution():
    """One limit, t(.95): 1.645 u; 1.83, 2.13 and 2.92 u with 9, 4 and 2 degrees of freedom."""
    k, dof = np.array([1.645, 1.833, 2.132, 2.920]), np.array([np.inf, 9, 4, 2])
    found = conformance_probability(1 - 1e-3 * k, np.array(1e-3), LOWER, UPPER, dof)
    assert_allclose(found, 0.95, atol=1e-4)


def test_probability_far_beyond_a_limit_keeps_its_digits():
    found = conformance_probability(np.array([-9.0, 9.0]), np.array(1.0), LOWER, UPPER)
    assert_allclose(found, 6.22e-16, rtol=1e-3)


def test_probability_without_uncertainty_is_0_or_1():
    found = conformance_probability(np.array([0.0, 1.0, 2.0]), np.array(0.0), LOWER, UPPER)
    assert_array_equal(found, [1, 1, 0])


@pytest.mark.parametrize(("rho", "whole"), [(0.0, 0.786), (0.5, 0.884), (1.0, 0.99)])
def test_24_coefficients_that_each_conform_with_99_percent(rho: float, whole: float):
    covariance = rho * np.ones((24, 24)) + (1 - rho) * np.eye(24)
    no, limit = np.full(24, -np.inf), np.full(24, ndtri(0.99))
    found = joint_conformance_probability(np.zeros(24), covariance, no, limit)
    assert_allclose(found, whole, atol=1e-3)


def test_joint_probability_agrees_with_counted_draws():
    rng = np.random.default_rng(5)
    root = rng.normal(size=(6, 6))
    covariance, value = root @ root.T, rng.normal(size=6)
    lower, upper = value - rng.uniform(1, 6, 6), value + rng.uniform(1, 6, 6)
    lower[0], upper[1] = -np.inf, np.inf
    drawn = value + rng.normal(size=(200_000, 6)) @ root.T
    counted = np.mean(((drawn >= lower) & (drawn <= upper)).all(axis=1))
    found = joint_conformance_probability(value, covariance, lower, upper)
    assert_allclose(found, counted, atol=3 * np.sqrt(counted / 200_000))


def test_joint_probability_of_exact_coefficients():
    covariance = np.diag([0.0, 1.0])
    lower, upper = np.array([-1.0, -1.0]), np.array([1.0, 1.0])
    inside = joint_conformance_probability(np.zeros(2), covariance, lower, upper)
    assert_allclose(inside, 0.6827, atol=1e-4)
    assert joint_conformance_probability(np.array([2.0, 0.0]), covariance, lower, upper) == 0


@pytest.mark.parametrize(
    ("name", "factor"), [("guarded", 0.0), ("guarded", np.inf), ("simple", 0.5)]
)
def test_factor_that_means_nothing_is_refused(name: str, factor: float):
    with pytest.raises(InputError, match="factor"):
        DecisionRule(name, factor)  # type: ignore[arg-type]
