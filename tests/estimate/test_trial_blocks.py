"""Blocks of trials: the answers of single fits, in memory that does not grow with the trials."""

import tracemalloc
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from numpy.typing import NDArray

from inercal.basics.arrays import Array
from inercal.estimation import (
    Estimate,
    Gaussian,
    Problem,
    least_squares,
    least_squares_of_trials,
    trial_blocks,
)
from inercal.estimation.problem import NormalEquations
from inercal.estimation.trial_blocks import BLOCK_TRIALS

T = np.linspace(0, 3, 40)
NAMES = tuple("abcdefgh")
POWERS = np.arange(len(NAMES))
TARGET = np.full(1, 0.5)


def problem(y: Array) -> Problem:
    """Return the fit of b exp(Σ c tᵏ), whose rows and noise differ from trial to trial."""

    def linearise(x: Array) -> tuple[Array, Array]:
        basis = (T[:, None] / 3) ** POWERS
        h = np.exp(x @ basis.T)
        return y - h, h[..., None] * basis

    prior = Gaussian.independent(("a",), TARGET, 1.0)
    return Problem(NAMES, np.zeros(8), linearise, 0.01 * (1 + abs(y)), np.ones(8), (prior,))


def data(trials: int) -> Array:
    x = np.random.default_rng(0).normal(scale=0.1, size=(trials, 8))
    return np.exp(x @ ((T[:, None] / 3) ** POWERS).T)


def solve(y: Array) -> Estimate:
    return least_squares_of_trials(len(y), lambda part: problem(y[part]))


def test_blocks_of_trials_have_the_answers_of_single_fits():
    y = data(2 * BLOCK_TRIALS + 1)
    together = solve(y)
    for k in (0, BLOCK_TRIALS - 1, BLOCK_TRIALS, 2 * BLOCK_TRIALS):
        alone = least_squares(problem(y[k]))
        assert_allclose(together.value[k], alone.value, rtol=1e-6, atol=1e-8)
        assert_allclose(together.covariance[k], alone.covariance, rtol=1e-6)
        assert_allclose(together.whitened[k], alone.whitened, atol=1e-6)
        assert together.rank == alone.rank


def _peak_beyond_result(y: Array) -> int:
    tracemalloc.start()
    try:
        result = solve(y)
        arrays = (result.value, result.covariance, result.residual, result.whitened)
        return tracemalloc.get_traced_memory()[1] - sum(array.nbytes for array in arrays)
    finally:
        tracemalloc.stop()


@pytest.mark.slow
def test_memory_beyond_the_result_does_not_grow_with_the_trials():
    solve(data(20))  # the kernels of many trials are loaded before memory is counted
    few, many = (_peak_beyond_result(data(k * BLOCK_TRIALS)) for k in (1, 4))
    assert many < 1.3 * few


def packed(y: Array) -> Problem:
    """Return the problem with its normal equations."""
    whole = problem(y)

    def equations(x: Array, which: NDArray[np.intp]) -> NormalEquations:
        basis = (T[:, None] / 3) ** POWERS
        h = np.exp(x @ basis.T)
        weight = 1 / (0.01 * (1 + abs(y[which])))
        a, u = (weight * h)[..., None] * basis, weight * (y[which] - h)
        rows, columns = np.tril_indices(len(NAMES))
        normal = (np.swapaxes(a, -1, -2) @ a)[:, rows, columns]
        return NormalEquations(y[which] - h, weight, u, normal, (u[:, None] @ a)[:, 0])

    return replace(whole, normal_equations=equations)


@pytest.fixture
def short_blocks(monkeypatch: pytest.MonkeyPatch) -> int:
    """Make blocks of 80 trials, which are solved by normal equations."""
    monkeypatch.setattr(trial_blocks, "BLOCK_TRIALS", 80)
    return 80


@pytest.mark.slow
def test_normal_equations_take_the_place_of_the_jacobians(short_blocks: int):
    # Trials far from one another: the mean of others is a bad start for some.
    y = 2 * data(2 * short_blocks) ** np.linspace(0.2, 2, 2 * short_blocks)[:, None]
    generic = solve(y)
    found = least_squares_of_trials(len(y), lambda part: packed(y[part]))
    assert found.converged.all()
    assert_allclose(found.value, generic.value, rtol=1e-6, atol=1e-8)
    assert_allclose(found.covariance, generic.covariance, rtol=1e-5, atol=1e-12)
    assert found.rank == generic.rank


def test_trials_that_cannot_begin_at_the_mean_of_others_begin_at_the_start(short_blocks: int):
    y = 2 * data(2 * short_blocks)
    calls: list[Array] = []

    def fragile(part: slice) -> Problem:
        whole = packed(y[part])
        assert whole.normal_equations is not None
        equations = whole.normal_equations

        def found(x: Array, which: NDArray[np.intp]) -> NormalEquations:
            result = equations(x, which)
            if part.start and not calls:
                calls.append(x)
                return result._replace(residual=np.full_like(result.residual, np.nan))
            return result

        return replace(whole, normal_equations=found)

    found = least_squares_of_trials(len(y), fragile)
    assert found.converged.all()
    assert np.any(calls[0] != 0)
    assert_allclose(found.value, solve(y).value, rtol=1e-6, atol=1e-8)


@pytest.mark.slow
def test_a_second_problem_begins_at_the_estimate_of_the_first(short_blocks: int):
    y = 2 * data(2 * short_blocks)

    def corrected(part: slice, first: Estimate) -> Problem:
        return packed(y[part] * (1 + 1e-3 * first.value[:, :1]))

    found = least_squares_of_trials(len(y), lambda part: packed(y[part]), refined=corrected)
    first = least_squares_of_trials(len(y), lambda part: packed(y[part]))
    then = corrected(slice(0, len(y)), first)
    assert_allclose(found.value, least_squares(then).value, rtol=1e-6, atol=1e-8)
    assert found.iterations.mean() < first.iterations.mean()


def test_a_second_problem_may_be_none():
    y = data(20)
    found = least_squares_of_trials(len(y), lambda part: packed(y[part]), refined=lambda *_: None)
    assert_allclose(found.value, solve(y).value, rtol=1e-6, atol=1e-8)
