from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from inercal.errors import InputError
from inercal.estimate import Estimate, Gauge, Gaussian, Problem, least_squares, linear_least_squares

Solver = Callable[[Problem], Estimate]
DESIGN = np.array([[1.0, 0.0], [1.0, 1.0], [1.0, 2.0]])
GOOD = Problem(
    ("a", "b"),
    np.zeros(2),
    lambda x: (1 - x @ DESIGN.T, DESIGN),
    np.ones(3),
    np.ones(2),
    observations=("first", "second", "third"),
)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"names": ("a", "a")}, "parameter named twice: a"),
        ({"start": np.zeros(3)}, r"start has shape \(3,\); expected \(2,\) or \(trials, 2\)"),
        ({"start": np.array([0, np.nan])}, "start is not finite"),
        ({"scale": np.array([1.0, 0.0])}, "scale must be 2 finite, positive sizes"),
        ({"wanted": ("c",)}, "wanted: no parameter 'c'; this problem has a, b"),
        ({"priors": (Gaussian.independent(("c",), 0, 1),)}, "prior: no parameter 'c'; .* a, b"),
        ({"gauges": (Gauge("w", ("c",), np.ones((1, 1)), np.ones(1)),)}, "gauge: no parameter 'c'"),
    ],
)
def test_a_malformed_problem_is_refused_in_words(change: dict[str, Any], message: str):
    with pytest.raises(InputError, match=message):
        replace(GOOD, **change)


@pytest.mark.parametrize("solver", [linear_least_squares, least_squares])
@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"noise": np.ones(4)}, r"noise has shape \(4,\); expected standard deviations \(3,\)"),
        ({"noise": np.array([1, 0.0, 1])}, "standard deviation of observation second is not posit"),
        ({"noise": np.ones((3, 3))}, "noise: the covariance is not positive definite"),
        ({"noise": np.array([[1, 2, 0], [0, 1, 0], [0, 0, 1.0]])}, "noise: .* not symmetric"),
        ({"noise": np.diag([1, np.nan, 1])}, "noise: the covariance is not finite"),
        ({"observations": ("one",)}, "1 labels for 3 observations"),
        ({"linearise": lambda x: (np.ones(3), DESIGN.T)}, r"Jacobian has shape \(2, 3\); expected"),
        ({"linearise": lambda x: (np.full(3, np.inf), DESIGN)}, "not finite at the start"),
        (
            {"start": np.zeros((4, 2)), "linearise": lambda x: (np.ones((5, 3)), DESIGN)},
            "numbers of trials differ",
        ),
        (
            {
                "start": np.zeros((4, 2)),
                "linearise": lambda x: (np.ones((4, 3)), np.ones((5, 3, 2))),
            },
            "numbers of trials differ",
        ),
        (
            {
                "gauges": (
                    Gauge("one", ("a",), np.ones((1, 1)), np.ones(1)),
                    Gauge("two", ("a",), np.ones((1, 1)), np.ones(1)),
                )
            },
            "gauges repeat one another: one; two",
        ),
    ],
)
def test_what_only_shows_when_solving_is_refused_in_words(
    solver: Solver, change: dict[str, Any], message: str
):
    with pytest.raises(InputError, match=message):
        solver(replace(GOOD, **change))


def test_priors_and_gauges_are_checked_when_made():
    with pytest.raises(InputError, match=r"prior on a, b: mean \(1,\) and covariance \(2, 2\)"):
        Gaussian(("a", "b"), np.zeros(1), np.eye(2))
    with pytest.raises(InputError, match=r"prior on a: .* not symmetric with a positive diagonal"):
        Gaussian.independent(("a",), 0.0, 0.0)
    with pytest.raises(InputError, match=r"prior on a, b: .* not positive definite"):
        Gaussian(("a", "b"), np.zeros(2), np.array([[1.0, 2.0], [2.0, 1.0]]))
    with pytest.raises(InputError, match="prior on a: a mean is not finite"):
        Gaussian.independent(("a",), np.nan, 1.0)
    with pytest.raises(InputError, match=r"gauge 'w': matrix \(2, 2\) does not fit 1 values"):
        Gauge("w", ("a", "b"), np.eye(2), np.zeros(1))
    with pytest.raises(InputError, match="gauge 'w': its 2 rows are not independent"):
        Gauge("w", ("a", "b"), np.ones((2, 2)), np.zeros(2))


def test_a_covariance_of_very_different_units_is_accepted():
    sd = np.array([1e-12, 1e9])
    covariance = np.outer(sd, sd) * [[1, 0.9], [0.9, 1]]
    assert_allclose(Gaussian(("a", "b"), np.zeros(2), covariance).covariance, covariance)


def test_a_prior_marginal_is_its_block():
    covariance = np.array([[2.0, 0.5, 0.1], [0.5, 3.0, 0.2], [0.1, 0.2, 4.0]])
    prior = Gaussian(("a", "b", "c"), np.array([1.0, 2.0, 3.0]), covariance)
    marginal = prior.marginal(("c", "a", "z"))
    assert marginal is not None
    assert marginal.names == ("a", "c")
    assert_allclose(marginal.mean, [1, 3])
    assert_allclose(marginal.covariance, [[2.0, 0.1], [0.1, 4.0]])
    assert prior.marginal(("z",)) is None


def test_all_parameters_are_wanted_unless_some_are_named():
    assert GOOD.wanted == ("a", "b")
    assert GOOD.nuisances == ()
    assert replace(GOOD, wanted=("b",)).nuisances == ("a",)
