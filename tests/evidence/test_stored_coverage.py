"""The stored counts of errors under slow noise and drift, and a sample worked out again."""

import pytest
from tests.base_seeds import chosen
from tests.evidence import noise_coverage

NAMED = {one.words: one for one in noise_coverage.DISTURBANCES}
SAMPLE, LEAST = 4, 8  # sessions
ROUNDED = 1  # sessions with an error or a p-value at its bound, on another processor


def test_every_case_is_stored():
    cases = {
        (one.method, one.added) for one in noise_coverage.read_coverage() if len(one.each) >= LEAST
    }
    assert cases == {(method, words) for method in noise_coverage.METHODS for words in NAMED}


def test_errors_in_sessions_called_consistent_are_as_stated():
    for one in noise_coverage.read_coverage():
        assert one.share <= one.allowed_share, (one.method, one.added)


def test_sessions_without_a_violation_are_called_consistent():
    for one in noise_coverage.read_coverage():
        if one.added == "nothing":
            assert one.consistent >= 0.95 * len(one.each), one.method


def test_sessions_that_hold_the_model_have_errors_of_their_size():
    for one in noise_coverage.read_coverage():
        if one.added == "nothing":
            band = 3.3 * (2 / (one.coefficients * len(one.each))) ** 0.5
            assert abs(one.nees - 1) <= max(0.05, band), one.method


@pytest.mark.parametrize("method", noise_coverage.METHODS)
def test_the_whole_range_between_quiet_and_rejected_is_covered(method: str):
    added = [one for one in noise_coverage.DISTURBANCES if one.memory]
    assert min(one.memory for one in added) == 0.05
    assert max(one.memory for one in added) == 300
    rejected = [
        one.consistent / len(one.each)
        for one in noise_coverage.read_coverage()
        if one.method == method and one.added.startswith("linear")
    ]
    assert rejected[0] >= 0.8
    assert rejected[-1] <= 0.1


@pytest.mark.slow
@pytest.mark.parametrize("method", noise_coverage.METHODS)
@pytest.mark.parametrize("added", chosen(list(NAMED)[::4], list(NAMED)[::16]))
def test_a_sample_of_sessions_errs_as_stored(method: str, added: str):
    answers = [noise_coverage.calibrate_session(method, NAMED[added], k) for k in range(SAMPLE)]
    stored = next(
        one for one in noise_coverage.read_coverage() if (one.method, one.added) == (method, added)
    )
    now = noise_coverage.count_sessions(method, NAMED[added], answers).each
    assert sum(a != b for a, b in zip(now, stored.each, strict=False)) <= ROUNDED
