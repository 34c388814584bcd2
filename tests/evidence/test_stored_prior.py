"""The stored counts of priors of a type are as required; a sample is worked out again."""

import json

import numpy as np
import pytest
from scipy.stats import binom
from tests.base_seeds import evidence
from tests.evidence import prior
from tests.evidence.stored_runs import page_text

from inercal.laboratory.type_prior import FALSE_ALARMS

FOUND = json.loads(prior.DATA.read_text(encoding="utf-8"))
N = FOUND["populations"]
NUMBERS = [str(n) for n in prior.SENSORS]
EXPECTED = 0.9545


def test_all_populations_are_counted():
    assert prior.POPULATIONS == N
    assert [*FOUND["sensors"]] == NUMBERS
    assert {name: [*rows] for name, rows in FOUND["pairs"].items()} == dict.fromkeys(
        prior.ESTIMATORS, NUMBERS
    )


@pytest.mark.parametrize("n", NUMBERS)
def test_u_contains_a_new_sensor_as_often_as_stated(n: str):
    one = FOUND["sensors"][n]
    assert 0.93 <= np.mean([*one["covered"].values()]) <= 0.97
    low, high = binom.ppf([5e-4, 1 - 5e-4], N, EXPECTED) / N
    for term, share in one["covered"].items():
        assert share >= min(0.93, low), term
        # Calibrations of K₃ are as uncertain as its scatter: of three, U is larger than necessary.
        assert share <= max(0.97, high) or (term, n) == ("k3", "3"), term
    assert one["alarms"] <= binom.ppf(1 - 5e-4, N, FALSE_ALARMS) / N


@pytest.mark.parametrize("n", NUMBERS)
@pytest.mark.parametrize("estimator", prior.ESTIMATORS)
def test_the_nine_parameters_of_a_pair_are_as_uncertain_as_stated(estimator: str, n: str):
    assert 0.9 <= FOUND["pairs"][estimator][n]["nees"] <= 1.1


def test_the_page_is_that_of_the_counts():
    assert page_text(prior.PAGE) == prior.page(FOUND)


@pytest.mark.slow
@pytest.mark.parametrize("n", [10, evidence(30)])
def test_a_sample_of_new_sensors_lies_within_u_again(n: int):
    inside = prior.cover((n, 0))[:, :-1]
    # The coefficients of a sensor are correlated: the populations are what is independent.
    low, high = binom.ppf([5e-4, 1 - 5e-4], len(inside), EXPECTED) / len(inside)
    assert low <= inside.mean() <= high


@pytest.mark.slow
@pytest.mark.parametrize("n", [10, evidence(30)])
@pytest.mark.parametrize("estimator", prior.ESTIMATORS)
def test_a_sample_of_pairs_errs_as_stated_again(estimator: str, n: int):
    nees = prior.calibrate_pairs((estimator, n, 0))
    # χ² of nine parameters over nine has a variance of 2/9.
    assert abs(nees.mean() - 1) < prior.BAND * np.sqrt(2 / 9 / len(nees))
