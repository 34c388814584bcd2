"""Level, line and walk of a history: against others' numbers, and over many simulated histories."""

from math import sqrt

import numpy as np
import pytest
from numpy.typing import NDArray

from inercal.calibration.comparison.changes import constancy_test, normalised_errors, trend_verdict
from inercal.calibration.comparison.courses import CourseComparison, compare_courses, fit_course
from inercal.estimation.uncertainty.conformity import expanded_uncertainty

Array = NDArray[np.float64]
TRIALS = 200
# GUM H.3, table H.6: corrections of a thermometer, °C, at temperatures, °C.
TEMPERATURE = np.array(
    [21.521, 22.012, 22.512, 23.003, 23.507, 23.999, 24.513, 25.002, 25.503, 26.010, 26.511]
)
CORRECTION = -1e-3 * np.array([171, 169, 166, 159, 164, 165, 156, 157, 159, 161, 160])


def courses(
    time: Array, values: Array, own: Array, shared: Array | float = 0.0
) -> CourseComparison:
    n = len(time)
    found = compare_courses(time, values, own, np.broadcast_to(shared, (n, n)).copy())
    assert found is not None
    return found


def said(found: CourseComparison | None, values: Array, std: Array) -> str:
    drifts = found is not None and found.drifts
    return trend_verdict(drifts=drifts, constant=constancy_test(values, std))


def test_the_line_is_that_of_the_gum():
    line = courses(TEMPERATURE, CORRECTION, np.full(11, 0.0035**2)).line
    assert (round(line.slope.slope, 5), round(line.slope.std, 5)) == (0.00218, 0.00067)
    at = np.array([20.0, 30.0])
    assert line.evaluate(at).round(4).tolist() == [-0.1712, -0.1494]
    assert (line.expanded(at) / line.factor).round(4).tolist() == [0.0029, 0.0041]
    # 0.0035 °C is what the residuals scatter by: nothing is left for a scatter beside it.
    assert (line.dof, round(line.tau, 4)) == (9, pytest.approx(0, abs=3e-4))
    assert line.factor == pytest.approx(float(expanded_uncertainty(np.ones(1), 9.0)[0]))


def test_a_line_with_weights_is_that_of_numpy():
    rng = np.random.default_rng(5)
    time, std = np.sort(rng.uniform(0, 9, 12)), rng.uniform(0.5, 3.0, 12)
    noise = rng.standard_normal(12)
    values = 3 - 0.7 * time + 0.3 * std * noise  # agrees too well for a scatter
    line = courses(time, values, std**2).line
    (slope, start), covariance = np.polyfit(time, values, 1, w=1 / std, cov="unscaled")
    assert line.tau == 0
    assert line.slope.slope == pytest.approx(slope, rel=1e-9)
    assert line.slope.std == pytest.approx(sqrt(covariance[0, 0]), rel=1e-9)
    zero = np.zeros(1)
    assert line.evaluate(zero)[0] == pytest.approx(start, rel=1e-9)
    u = line.expanded(zero)[0] / line.factor
    assert u == pytest.approx(sqrt(covariance[1, 1]), rel=1e-9)


@pytest.mark.parametrize("size", [0, 1, 2])
def test_fewer_than_three_have_no_line_and_neither_have_those_of_one_time(size: int):
    ones, nothing = np.ones(size), np.zeros((size, size))
    assert compare_courses(np.arange(size, dtype=float), ones, ones, nothing) is None
    assert compare_courses(np.ones(5), np.arange(5.0), np.ones(5), np.zeros((5, 5))) is None


def test_what_all_share_moves_the_level_and_not_the_slope():
    time, values = np.arange(6.0), np.array([0.3, 1.2, 1.9, 3.3, 3.8, 5.2])
    alone, shared = (courses(time, values, np.full(6, 0.04), b).line for b in (0.0, 0.81))
    assert shared.slope == pytest.approx(alone.slope, rel=1e-6)
    at = np.array([2.5])
    assert shared.expanded(at)[0] ** 2 == pytest.approx(
        alone.expanded(at)[0] ** 2 + 4 * 0.81, rel=1e-6
    )
    # A part of another determination is not common: it is in the slope.
    blocks = 0.81 * (np.arange(6)[:, None] // 3 == np.arange(6) // 3)
    assert courses(time, values, np.full(6, 0.04), blocks).line.slope.expanded > 2 * (
        alone.slope.expanded
    )


@pytest.mark.slow
@pytest.mark.parametrize(
    ("tau", "slope", "next_year"), [(0.0, 0.999, 0.995), (1.0, 0.985, 0.975), (3.0, 0.96, 0.95)]
)
def test_slope_and_next_year_of_five_years_are_covered(
    seed: int, tau: float, slope: float, next_year: float
):
    """The note's table: 99.9, 99, 96 % and 100, 98, 95 %."""
    rng = np.random.default_rng([seed, round(tau)])
    time, hits = np.arange(5.0), np.zeros(2)
    for _ in range(TRIALS):
        std = rng.uniform(0.8, 1.2, 5)
        errors = 0.7 * rng.standard_normal() + std * rng.standard_normal(5)
        values = 0.5 * time + errors + tau * rng.standard_normal(5)
        line = fit_course(time, values, std**2, np.full((5, 5), 0.49), slope=True)
        use = 2.5 + tau * rng.standard_normal()
        at = np.array([5.0])
        hits += (
            abs(line.slope.slope - 0.5) < line.slope.expanded,
            abs(line.evaluate(at)[0] - use) < line.expanded(at, next_use=True)[0],
        )
    for share, expected in zip(hits / TRIALS, (slope, next_year), strict=True):
        assert abs(share - expected) < 4 * sqrt(0.04 * 0.96 / TRIALS)


@pytest.mark.slow
def test_a_random_walk_is_seldom_called_a_drift(seed: int):
    """By 2u of a Birge line it is called so in 41 % of five years, and in 57 % of ten."""
    rng = np.random.default_rng(seed)
    for size, most in ((5, 0.13), (10, 0.14)):
        time, called = np.arange(float(size)), 0
        for _ in range(TRIALS // 2):
            walk = np.cumsum(rng.standard_normal(size)) + 0.5 * rng.standard_normal(size)
            called += courses(time, walk, np.full(size, 0.25)).drifts
        assert called / (TRIALS // 2) < most
    # A drift of one standard deviation a year is found all the same, 90 % of ten years.
    found = [
        courses(time, time + rng.standard_normal(10), np.ones(10)).drifts
        for _ in range(TRIALS // 4)
    ]
    assert np.mean(found) > 0.8


def test_four_calibrations_show_no_drift_however_steep():
    steep = 100 * np.arange(4.0)
    assert not courses(np.arange(4.0), steep, np.ones(4)).drifts
    assert courses(np.arange(5.0), 100 * np.arange(5.0), np.ones(5)).drifts


def test_a_walk_is_likelier_where_its_variance_grows_with_time(seed: int):
    rng = np.random.default_rng(seed)
    time = np.arange(40.0)
    walk = courses(time, np.cumsum(rng.standard_normal(40)), np.full(40, 0.01))
    assert walk.best == "walk"
    assert walk.walk.walk == pytest.approx(1, rel=4 * sqrt(2 / 40))
    noise = courses(time, rng.standard_normal(40), np.full(40, 0.01))
    assert noise.best == "level"
    assert noise.level.tau == pytest.approx(1, rel=4 / sqrt(80))


def test_of_two_calibrations_changed_means_that_en_exceeds_one():
    rng = np.random.default_rng(8)
    for _ in range(500):
        std = rng.uniform(0.5, 2.0, 2)
        values = 2 * rng.standard_normal(2)
        en = float(normalised_errors(np.diff(values), np.hypot(std[:1], std[1:]))[0])
        assert said(None, values, std) == ("changed" if abs(en) > 1 else "steady")


def test_of_two_calibrations_what_both_share_is_no_change():
    values, std, shared = np.array([0.0, 2.5]), np.ones(2), np.full((2, 2), 9.0)
    own = constancy_test(values, std, shared)
    assert own.chi2 == pytest.approx(2.5**2 / 2)
    assert own.p_value == pytest.approx(constancy_test(values, std).p_value)


@pytest.mark.parametrize("size", [3, pytest.param(10, marks=pytest.mark.slow)])
def test_of_steady_coefficients_about_one_in_20_is_not_called_so(seed: int, size: int):
    rng = np.random.default_rng(seed)
    time, ones = np.arange(float(size)), np.ones(size)
    found = [
        said(courses(time, values, ones), values, ones)
        for values in rng.standard_normal((TRIALS, size))
    ]
    assert abs(1 - found.count("steady") / len(found) - 0.052) < 4 * sqrt(0.052 * 0.948 / TRIALS)
    assert said(None, np.ones(1), np.ones(1)) == "too few"


def test_a_step_is_a_change_and_a_slope_a_drift():
    time, ones = np.arange(8.0), np.ones(8)
    for values, expected in (
        (np.array([0, 6, 0, 6, 0, 6, 0, 6.0]), "changed"),
        (3 * time, "drifts"),
        (np.zeros(8), "steady"),
    ):
        assert said(courses(time, values, ones), values, ones) == expected


def test_the_unit_of_time_does_not_count():
    rng = np.random.default_rng(6)
    time, values = np.array([0.0, 0.0, 1.0, 2.0, 4.0]), rng.standard_normal(5)
    years, seconds = (courses(time * by, values, np.full(5, 0.1), 0.3) for by in (1.0, 3e-8))
    for name in ("level", "line", "walk", "wandering_line"):
        one, other = getattr(years, name), getattr(seconds, name)
        assert other.slope.slope == pytest.approx(one.slope.slope / 3e-8, rel=1e-6)
        assert other.slope.expanded == pytest.approx(one.slope.expanded / 3e-8, rel=1e-6)
        assert other.walk == pytest.approx(one.walk / 3e-8, rel=1e-6)
    assert years.likelihood == pytest.approx(seconds.likelihood, abs=1e-6)


def test_between_two_times_a_slope_leaves_nothing_to_a_walk():
    found = courses(np.array([0.0, 1.0, 1.0]), np.array([0.1, 0.9, 1.2]), np.ones(3))
    assert found.wandering_line.walk == 0
    assert found.wandering_line.slope == found.line.slope
