from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose
from tests.refusals import refused

from inercal.estimation import Gauge, Gaussian, Problem, least_squares

SKEW = np.array([[1, 2, 0], [0, 1, 0], [0, 0, 1.0]])
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
    ("change", "key", "names"),
    [
        ({"names": ("a", "a")}, "names", "a"),
        ({"start": np.zeros(3)}, "start", ""),
        ({"start": np.array([0, np.nan])}, "start", "b"),
        ({"scale": np.array([1.0, 0.0])}, "scale", ""),
        ({"wanted": ("c",)}, "wanted", "c"),
        ({"priors": (Gaussian.independent(("c",), 0, 1),)}, "prior", "c"),
        ({"gauges": (Gauge("w", ("c",), np.ones((1, 1)), np.ones(1)),)}, "gauge", "c"),
    ],
)
def test_a_malformed_problem_is_refused_by_its_argument(
    change: dict[str, Any], key: str, names: str
):
    with refused(key=key, names=names):
        replace(GOOD, **change)


@pytest.mark.parametrize(
    ("change", "key", "names"),
    [
        ({"noise": np.ones(4)}, "noise", ()),
        ({"noise": np.array([1, 0.0, 1])}, "noise", ("second",)),
        ({"noise": np.ones((3, 3))}, "noise", ()),
        ({"noise": np.ones(3), "correlated": True}, "noise", ()),
        ({"noise": np.ones((3, 3)), "correlated": True}, "covariance", ()),  # singular
        ({"noise": SKEW, "correlated": True}, "covariance", ()),
        ({"noise": np.diag([1, np.nan, 1]), "correlated": True}, "covariance", ()),
        ({"observations": ("one",)}, "observations", ()),
        ({"linearise": lambda x: (np.ones(3), DESIGN.T)}, "linearise", ()),
        ({"linearise": lambda x: (np.full(3, np.inf), DESIGN)}, "linearise", ()),
        (
            {"start": np.zeros((4, 2)), "linearise": lambda x: (np.ones((5, 3)), DESIGN)},
            "start",
            (),
        ),
        (
            {
                "start": np.zeros((4, 2)),
                "linearise": lambda x: (np.ones((4, 3)), np.ones((5, 3, 2))),
            },
            "start",
            (),
        ),
        (
            {
                "gauges": (
                    Gauge("one", ("a",), np.ones((1, 1)), np.ones(1)),
                    Gauge("two", ("a",), np.ones((1, 1)), np.ones(1)),
                )
            },
            "gauge",
            ("one", "two"),
        ),
    ],
)
def test_what_only_shows_when_solving_is_refused_by_its_argument(
    change: dict[str, Any], key: str, names: tuple[str, ...]
):
    with refused(key=key, names=names):
        least_squares(replace(GOOD, **change))


def test_priors_and_gauges_are_checked_when_made():
    with refused(key="mean", names=("a", "b")):
        Gaussian(("a", "b"), np.zeros(1), np.eye(2))
    with refused(key="covariance", names=("a",)):
        Gaussian.independent(("a",), 0.0, 0.0)
    with refused(key="covariance", names=("a", "b")):
        Gaussian(("a", "b"), np.zeros(2), np.array([[1.0, 2.0], [2.0, 1.0]]))
    with refused(key="mean", names=("a",)):
        Gaussian.independent(("a",), np.nan, 1.0)
    with refused(key="matrix", names=("a", "b")):
        Gauge("w", ("a", "b"), np.eye(2), np.zeros(1))
    with refused(key="matrix", names=("a", "b")):
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
