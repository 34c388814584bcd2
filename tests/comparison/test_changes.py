"""E_n, the joint test and the line: against others' numbers, and over many seeds."""

from math import sqrt

import numpy as np
import pytest
from numpy.typing import NDArray

from inercal.comparison.changes import (
    CHANCE_FRACTION,
    chi2_p_value,
    constancy_test,
    fit_drift_line,
    joint_test,
    normalised_errors,
    trend_verdict,
)

Array = NDArray[np.float64]
TRIALS = 4000
# GUM H.3, table H.6: corrections of a thermometer, °C, at temperatures, °C.
TEMPERATURE = np.array(
    [21.521, 22.012, 22.512, 23.003, 23.507, 23.999, 24.513, 25.002, 25.503, 26.010, 26.511]
)
CORRECTION = -1e-3 * np.array([171, 169, 166, 159, 164, 165, 156, 157, 159, 161, 160])


def within(count: int, trials: int, probability: float) -> bool:
    """Whether a count is within four standard deviations of what is expected, to both sides."""
    return abs(count - trials * probability) < 4 * sqrt(trials * probability * (1 - probability))


def test_the_line_is_that_of_the_gum():
    found = fit_drift_line(TEMPERATURE, CORRECTION, np.full(11, 0.0035))
    assert found is not None
    assert (round(found.slope, 5), round(found.slope_std, 5)) == (0.00218, 0.00067)
    values, stds = found.evaluate(np.array([20.0, 30.0]))
    assert values.round(4).tolist() == [-0.1712, -0.1494]
    assert stds.round(4).tolist() == [0.0029, 0.0041]
    # s = 0.0035 °C is what the residuals scatter by: χ² is near its degrees of freedom
    assert found.dof == 9
    assert found.chi2 == pytest.approx(9, rel=0.03)
    assert found.birge == 1


def test_a_line_with_weights_is_that_of_numpy():
    rng = np.random.default_rng(5)
    time, std = np.sort(rng.uniform(0, 9, 12)), rng.uniform(0.5, 3.0, 12)
    values = 3 - 0.7 * time + std * rng.standard_normal(12)
    found = fit_drift_line(time, values, std)
    assert found is not None
    (slope, start), covariance = np.polyfit(time, values, 1, w=1 / std, cov="unscaled")
    assert found.slope == pytest.approx(slope, rel=1e-12)
    assert found.slope_std / found.birge == pytest.approx(sqrt(covariance[0, 0]), rel=1e-12)
    value, at_start = found.evaluate(np.array(0.0))
    assert float(value) == pytest.approx(start, rel=1e-12)
    assert float(at_start) / found.birge == pytest.approx(sqrt(covariance[1, 1]), rel=1e-12)


@pytest.mark.parametrize("size", [0, 1, 2])
def test_fewer_than_three_have_no_line_and_neither_have_those_of_one_time(size: int):
    ones = np.ones(size)
    assert fit_drift_line(np.arange(size, dtype=float), ones, ones) is None
    assert fit_drift_line(np.ones(5), np.arange(5.0), np.ones(5)) is None


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


def test_slope_and_value_err_by_what_they_state_and_have_no_bias(seed: int):
    rng = np.random.default_rng(seed)
    errors: list[tuple[float, float]] = []
    beyond = 0
    for _ in range(TRIALS):
        time, std = np.sort(rng.uniform(0, 5, 8)), rng.uniform(0.5, 2.0, 8)
        found = fit_drift_line(time, 4 - 1.5 * time + std * rng.standard_normal(8), std)
        assert found is not None
        truth = 4 - 1.5 * found.time
        stated = found.value_std / found.birge, found.slope_std / found.birge
        errors.append(((found.value - truth) / stated[0], (found.slope + 1.5) / stated[1]))
        beyond += abs(found.slope + 1.5) > 2 * found.slope_std
    apart = np.array(errors)
    assert np.all(np.abs(apart.mean(axis=0)) < 4 / sqrt(TRIALS))
    assert np.all(np.abs(apart.std(axis=0) - 1) < 4 / sqrt(2 * TRIALS))
    # Scaled where χ² is beyond its bound by chance, they exceed U a little less often.
    assert 0.8 * CHANCE_FRACTION < beyond / TRIALS < 1.2 * CHANCE_FRACTION


def test_where_points_scatter_more_than_stated_the_line_is_scaled(seed: int):
    rng = np.random.default_rng(seed)
    time = np.arange(10.0)
    apart: list[float] = []
    for _ in range(TRIALS):
        found = fit_drift_line(time, 4 * rng.standard_normal(10), np.ones(10))
        assert found is not None
        assert found.birge == pytest.approx(sqrt(found.chi2 / 8)) or found.birge == 1
        apart.append(found.slope / found.slope_std)
    # Student's t of 8 degrees of freedom has the variance 8/6, and the kurtosis 4.5.
    assert float(np.mean(np.square(apart))) == pytest.approx(8 / 6, rel=4 * sqrt(3.5 / TRIALS))


@pytest.mark.parametrize("size", [2, 5, 10])
def test_a_constant_is_found_changed_as_often_as_chance_has_it(seed: int, size: int):
    rng = np.random.default_rng(seed)
    std = rng.uniform(0.5, 2.0, size)
    found = [constancy_test(std * rng.standard_normal(size), std) for _ in range(TRIALS)]
    assert {one.dof for one in found} == {size - 1}
    assert within(sum(one.p_value < CHANCE_FRACTION for one in found), TRIALS, CHANCE_FRACTION)


def test_of_two_calibrations_changed_means_that_en_exceeds_one():
    rng = np.random.default_rng(8)
    for _ in range(500):
        std = rng.uniform(0.5, 2.0, 2)
        values = 2 * rng.standard_normal(2)
        en = float(normalised_errors(np.diff(values), np.hypot(std[:1], std[1:]))[0])
        said = trend_verdict(
            fit_drift_line(np.arange(2.0), values, std), constancy_test(values, std)
        )
        assert said == ("changed" if abs(en) > 1 else "steady")


@pytest.mark.parametrize("size", [3, 10])
def test_of_steady_coefficients_about_one_in_13_is_not_called_so(seed: int, size: int):
    rng = np.random.default_rng(seed)
    time, ones = np.arange(float(size)), np.ones(size)
    said = [
        trend_verdict(fit_drift_line(time, values, ones), constancy_test(values, ones))
        for values in rng.standard_normal((TRIALS, size))
    ]
    assert 0.06 < 1 - said.count("steady") / TRIALS < 0.095
    assert trend_verdict(None, constancy_test(np.ones(1), np.ones(1))) == "too few"


def test_a_step_is_a_change_and_a_slope_a_drift():
    time, ones = np.arange(8.0), np.ones(8)
    for values, expected in (
        (np.array([0, 6, 0, 6, 0, 6, 0, 6.0]), "changed"),
        (3 * time, "drifts"),
        (np.zeros(8), "steady"),
    ):
        assert (
            trend_verdict(fit_drift_line(time, values, ones), constancy_test(values, ones))
            == expected
        )
