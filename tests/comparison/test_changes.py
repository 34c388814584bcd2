"""E_n, the joint test and the line: against others' numbers, and over many seeds."""

from math import sqrt

import numpy as np
import pytest
from numpy.typing import NDArray

from inercal.calibration.comparison.changes import (
    CHANCE_FRACTION,
    chi2_p_value,
    constancy_test,
    joint_test,
    normalised_errors,
)

Array = NDArray[np.float64]
TRIALS = 4000


def within(count: int, trials: int, probability: float) -> bool:
    """Whether a count is within four standard deviations of what is expected, to both sides."""
    return abs(count - trials * probability) < 4 * sqrt(trials * probability * (1 - probability))


def test_where_nothing_changes_one_in_22_exceeds_one(seed: int):
    rng = np.random.default_rng(seed)
    u1, u2 = rng.uniform(0.1, 10, (2, 20_000))
    difference = u2 * rng.standard_normal(20_000) - u1 * rng.standard_normal(20_000)
    found = normalised_errors(difference, np.hypot(u1, u2))
    assert round(CHANCE_FRACTION, 4) == 0.0455
    assert within(int(np.sum(np.abs(found) > 1)), 20_000, CHANCE_FRACTION)
    assert abs(found.mean()) < 4 * 0.5 / sqrt(20_000)  # E_n has a standard deviation of 1/k


def test_errors_that_both_share_make_it_smaller(seed: int):
    rng = np.random.default_rng(seed)
    own, shared = 0.6, 0.8  # u = 1
    first, second = own * rng.standard_normal((2, 20_000)) + shared * rng.standard_normal(20_000)
    found = normalised_errors(second - first, np.full(20_000, 2**0.5))
    # The shared part cancels in the difference: it scatters by 0.6 of what is stated.
    assert float(np.std(found)) == pytest.approx(own / 2, rel=4 / sqrt(40_000))
    assert np.mean(np.abs(found) > 1) < CHANCE_FRACTION / 10


def test_no_uncertainty_at_all_leaves_nothing_to_compare():
    found = normalised_errors(np.array([0.0, 1.0, 1.0]), np.array([0.0, 0.0, 0.5]))
    assert np.isnan(found).tolist() == [True, True, False]
    assert found[2] == 1


def scattered(rng: np.random.Generator, size: int) -> tuple[Array, Array]:
    """Return a covariance and its root."""
    root = rng.standard_normal((size, size)) * 10.0 ** rng.uniform(-6, 3, size)[:, None]
    return root @ root.T, root


def test_the_joint_test_is_as_likely_as_it_says(seed: int):
    rng = np.random.default_rng(seed)
    covariance, root = scattered(rng, 6)
    p = np.array(
        [joint_test(root @ rng.standard_normal(6), covariance).p_value for _ in range(TRIALS)]
    )
    for level in (0.05, 0.5, 0.95):
        assert within(int(np.sum(p < level)), TRIALS, level)


def test_the_joint_test_does_not_depend_on_units():
    rng = np.random.default_rng(4)
    covariance, root = scattered(rng, 5)
    difference = root @ rng.standard_normal(5)
    units = np.array([1e-9, 1.0, 1e6, 3.0, 1e-3])
    first = joint_test(difference, covariance)
    second = joint_test(difference * units, covariance * np.outer(units, units))
    assert second.chi2 == pytest.approx(first.chi2, rel=1e-6)
    expected = difference @ np.linalg.solve(covariance, difference)
    assert first.chi2 == pytest.approx(expected, rel=1e-6)
    assert (first.rank, first.size) == (5, 5)
    assert first.p_value == chi2_p_value(first.chi2, 5)


def test_a_singular_covariance_counts_its_rank(seed: int):
    rng = np.random.default_rng(seed)
    root = rng.standard_normal((5, 3))
    found = [joint_test(root @ rng.standard_normal(3), root @ root.T) for _ in range(TRIALS)]
    assert {(one.rank, one.size) for one in found} == {(3, 5)}
    assert within(sum(one.p_value < 0.05 for one in found), TRIALS, 0.05)


@pytest.mark.parametrize("size", [2, 5, 10])
def test_a_constant_is_found_changed_as_often_as_chance_has_it(seed: int, size: int):
    rng = np.random.default_rng(seed)
    std = rng.uniform(0.5, 2.0, size)
    found = [constancy_test(std * rng.standard_normal(size), std) for _ in range(TRIALS)]
    assert {one.dof for one in found} == {size - 1}
    assert within(sum(one.p_value < CHANCE_FRACTION for one in found), TRIALS, CHANCE_FRACTION)
