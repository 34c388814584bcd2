"""Blocks of trials: the answers of single fits, in memory that does not grow with the trials."""

import tracemalloc

import numpy as np
from numpy.testing import assert_allclose

from inercal.arrays import Array
from inercal.estimate import Estimate, Gaussian, Problem, least_squares, least_squares_of_trials
from inercal.estimate.trial_blocks import BLOCK_TRIALS

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


def test_memory_beyond_the_result_does_not_grow_with_the_trials():
    solve(data(20))  # the kernels of many trials are loaded before memory is counted
    few, many = (_peak_beyond_result(data(k * BLOCK_TRIALS)) for k in (1, 4))
    assert many < 1.3 * few
