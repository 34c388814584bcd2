"""Run lengths and limits of charts: against tables, and over simulated runs without inercal."""

from math import sqrt

import numpy as np
import pytest
from tests.base_seeds import sampled

from inercal.estimation.uncertainty.control_charts import (
    chart_limit,
    chart_limits,
    chart_values,
    cusum_limit,
    cusum_run_length,
    cusum_sums,
    in_control_run_length,
    wider_limit,
)


@pytest.mark.parametrize(
    ("limit", "weight", "size", "length"),
    [
        (9.0, 1.0, 1, 370.4),  # Shewhart
        (2.860**2, 0.2, 1, 371),  # EWMA, Lucas and Saccucci
        (30.10, 1.0, 12, 370),  # T²
        (47.76, 1.0, 24, 370),
        (27.87, 0.1, 12, 370),  # MEWMA
        (45.15, 0.1, 24, 370),
        (8.66, 0.1, 2, 200),  # Lowry and others 1992, p = 2
        (12.73, 0.1, 4, 200),
    ],
)
def test_run_lengths_are_those_of_tables(limit: float, weight: float, size: int, length: float):
    assert in_control_run_length(limit, weight, size) == pytest.approx(length, rel=0.015)
    assert chart_limit(length, weight, size) == pytest.approx(limit, rel=0.004)


def test_limits_grow_with_the_run_length_and_with_few_degrees_of_freedom():
    limits = [chart_limit(length, 0.2, 3) for length in (50.0, 370.0, 1e4, 1e6)]
    assert limits == sorted(limits)
    assert wider_limit(9.0, 1, 1e9) == pytest.approx(9.0, rel=1e-6)
    # Of 20 sessions: 3.53 S with the mean's own error.
    assert sqrt(wider_limit(9.0, 1, 19) * (1 + 1 / 20)) == pytest.approx(3.53, abs=0.005)


def single_run_lengths(shift: float, weight: float, limit: float, seed: int, runs: int) -> float:
    """Return the mean run length of an EWMA, λ = 1 of a Shewhart chart: without inercal."""
    rng = np.random.default_rng([seed, round(10 * shift), round(100 * weight)])
    w, length, alive = np.zeros(runs), np.zeros(runs), np.ones(runs, dtype=bool)
    bound = limit * sqrt(weight / (2 - weight))
    while alive.any():
        w = (1 - weight) * w + weight * (shift + rng.standard_normal(runs))
        length += alive
        alive &= np.abs(w) < bound
    return float(length.mean())


@pytest.mark.parametrize(
    ("weight", "limit", "lengths"),
    [(1.0, 3.0, (370, 155, 44, 6.3)), (0.2, 2.860, (371, 36, 9.8, 3.6))],
)
def test_run_lengths_of_shifts_are_those_of_the_table(
    seed: int, weight: float, limit: float, lengths: tuple[float, ...]
):
    runs = 2000
    for shift, expected in zip((0.0, 0.5, 1.0, 2.0), lengths, strict=True):
        found = single_run_lengths(shift, weight, limit, seed, runs)
        assert found == pytest.approx(expected, rel=0.02 + 4.5 / sqrt(runs))


def test_charts_signal_where_the_statistics_of_the_textbook_do():
    rng = np.random.default_rng(3)
    n, p = 50, 3
    root = rng.standard_normal((p, p))
    covariance = root @ root.T
    d = rng.standard_normal((n, p)) @ root.T
    nothing = np.zeros((n, p, p))
    found = chart_values(d, np.broadcast_to(covariance, (n, p, p)), nothing)
    np.testing.assert_allclose(found.shewhart, d / np.sqrt(np.diag(covariance)))
    np.testing.assert_allclose(found.t2, np.sum(d * np.linalg.solve(covariance, d.T).T, axis=1))
    w, single = np.zeros(p), np.zeros(p)
    for t in range(n):  # MEWMA in the original units (Lowry and others 1992)
        w = 0.9 * w + 0.1 * d[t]
        single = 0.8 * single + 0.2 * d[t] / np.sqrt(np.diag(covariance))
        assert found.mewma[t] == pytest.approx(w @ np.linalg.solve(covariance * 0.1 / 1.9, w))
        np.testing.assert_allclose(found.lasting[t], single / sqrt(0.2 / 1.8))
    anew = chart_values(d, np.broadcast_to(covariance, (n, p, p)), nothing, [20])
    np.testing.assert_allclose(
        anew.mewma[20:],
        chart_values(d[20:], np.broadcast_to(covariance, (n - 20, p, p)), nothing[20:]).mewma,
    )


@pytest.mark.slow
@pytest.mark.parametrize(("seed", "runs"), sampled(150, 400))
def test_the_error_of_the_reference_does_not_average_in_the_charts(seed: int, runs: int):
    """The error of the mean of m points is common to all later points: w keeps all of it."""
    rng = np.random.default_rng(seed)
    n, m = 60, 10
    last = []
    for _ in range(runs):
        d = rng.standard_normal((n, 2)) - rng.standard_normal(2) / sqrt(m)
        one = np.broadcast_to(np.eye(2), (n, 2, 2))
        found = chart_values(d, one, one / m)
        last.append([*found.lasting[-1], found.mewma[-1]])
    at_end = np.array(last)
    assert np.mean(at_end[:, :2] ** 2) == pytest.approx(1, abs=4.5 * sqrt(2 / (2 * runs)))
    assert np.mean(at_end[:, 2]) == pytest.approx(2, abs=4.5 * sqrt(4 / runs))


def test_several_charts_share_the_rate_of_false_signals():
    known = chart_limits(370.0, np.full(12, np.inf), np.inf)
    assert known.joint_run_length == 4 * 370
    assert known.single_run_length == 4 * 12 * 370
    assert in_control_run_length(float(known.lasting[0]), 0.2, 1) == pytest.approx(
        4 * 12 * 370, rel=0.01
    )
    assert in_control_run_length(known.t2, 1.0, 12) == pytest.approx(4 * 370, rel=0.01)
    assert in_control_run_length(known.mewma, 0.1, 12) == pytest.approx(4 * 370, rel=0.01)
    few = chart_limits(370.0, np.full(12, 19.0), 171.0)
    assert (few.shewhart > known.shewhart).all()
    assert few.t2 > known.t2


def test_cusum_run_lengths_are_those_of_the_table():
    found = [cusum_run_length(4.774, shift) for shift in (0.0, 0.5, 1.0, 2.0)]
    assert found == pytest.approx([370, 35, 9.9, 3.9], rel=0.02)
    assert cusum_limit(370.4) == pytest.approx(4.774, abs=0.005)


@pytest.mark.slow
def test_a_cusum_limit_grows_with_the_run_length_and_with_few_degrees_of_freedom():
    limits = [cusum_limit(length) for length in (50.0, 370.0, 1e4, 1e6)]
    assert limits == sorted(limits)
    assert cusum_limit(370.4, 1e7) == pytest.approx(cusum_limit(370.4), rel=1e-2)
    assert cusum_limit(370.4, 19.0) > cusum_limit(370.4, 57.0) > cusum_limit(370.4)


def test_cusum_sums_are_those_of_page_and_restart():
    z = np.array([[1.0], [2.0], [-3.0], [0.2], [4.0]])
    up, down = cusum_sums(z, np.zeros_like(z))
    assert up[:, 0] == pytest.approx([0.5, 2.0, 0.0, 0.0, 3.5])
    assert down[:, 0] == pytest.approx([0.0, 0.0, 2.5, 1.8, 0.0])
    again, _ = cusum_sums(z, np.zeros_like(z), [1])
    assert again[:2, 0] == pytest.approx([0.5, 1.5])
    # A reference that is known less well has a larger allowance.
    wide, _ = cusum_sums(z, np.full_like(z, 0.2))
    assert wide[0, 0] == pytest.approx(0.5 - 1.645 * 0.2)


@pytest.mark.slow
def test_a_cusum_of_estimated_references_seldom_signals_too_early(seed: int):
    """Of references of 20 points nine in ten have the run length, or a longer one."""
    rng = np.random.default_rng(seed)
    labs, m, length = 200, 20, 50.0
    limit = cusum_limit(length, m - 1.0)
    found = np.zeros(labs)
    for lab in range(labs):
        mean, s = rng.standard_normal() / sqrt(m), sqrt(rng.chisquare(m - 1) / (m - 1))
        z = (rng.standard_normal((400, 40)) - mean) / s
        up, down = cusum_sums(z, np.full_like(z, sqrt(1 / m)))
        beyond = np.maximum(up, down) > limit
        first = np.where(beyond.any(axis=0), beyond.argmax(axis=0) + 1, 400)
        found[lab] = first.mean()
    assert np.quantile(found, 0.1) > 0.75 * length
