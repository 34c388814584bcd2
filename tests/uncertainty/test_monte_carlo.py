import numpy as np
import pytest
from numpy.random import Generator
from numpy.testing import assert_allclose, assert_array_equal
from numpy.typing import NDArray
from tests.base_seeds import SEEDS

from inercal.estimation.uncertainty import monte_carlo, nees, propagate

Array = NDArray[np.float64]


def run(rng: Generator, trials: int) -> dict[str, Array]:
    return {"x": rng.normal(size=(trials, 3)), "y": rng.random(trials)}


def test_equal_seeds_give_equal_trials_and_other_seeds_others():
    one, same, other = (monte_carlo(run, 1234, seed) for seed in (1, 1, 2))
    assert one["x"].shape == (1234, 3)
    assert one["y"].shape == (1234,)
    assert_array_equal(one["x"], same["x"])
    assert not np.any(one["x"] == other["x"])


def test_more_trials_begin_with_the_same_ones():
    few, many = monte_carlo(run, 1000, 7), monte_carlo(run, 2500, 7)
    assert_array_equal(few["x"], many["x"][:1000])


def test_batches_do_not_repeat_one_another():
    x = monte_carlo(run, 2000, 3, batch=100)["x"]
    assert len(np.unique(x)) == x.size


def test_progress_counts_up_to_all_trials():
    told: list[tuple[int, int]] = []
    monte_carlo(run, 1100, 1, progress=lambda done, total: told.append((done, total)))
    assert told == [(500, 1100), (1000, 1100), (1100, 1100)]


def test_first_order_and_monte_carlo_agree_where_the_function_is_nearly_linear():
    covariance = 1e-4 * np.array([[1.0, 0.3], [0.3, 2.0]])
    root = np.linalg.cholesky(covariance)

    def product(x: Array) -> Array:
        return np.stack([x[..., 0] * x[..., 1], x[..., 0] / x[..., 1]], axis=-1)

    def trial(rng: Generator, n: int) -> dict[str, Array]:
        return {"y": product(np.array([1.0, 2.0]) + rng.normal(size=(n, 2)) @ root.T)}

    y = monte_carlo(trial, 40_000, 5)["y"]
    value, expected = propagate(product, np.array([1.0, 2.0]), covariance)
    mean, error = y.mean(axis=0), y.std(axis=0) / 200
    assert np.all(np.abs(mean - value) < 4 * error + 1e-4)
    sd = np.sqrt(np.diag(expected))
    assert_allclose(np.cov(y.T) / np.outer(sd, sd), expected / np.outer(sd, sd), atol=0.03)


@pytest.mark.parametrize("seed", SEEDS)
def test_nees_of_honest_errors_averages_to_their_number(seed: int):
    covariance = np.array([[2.0, 0.5, 0.0], [0.5, 1.0, -0.3], [0.0, -0.3, 3.0]])
    root = np.linalg.cholesky(covariance)
    error = np.random.default_rng(seed).normal(size=(5000, 3)) @ root.T
    values = nees(error, covariance)
    assert_allclose(values, nees(error, np.broadcast_to(covariance, (5000, 3, 3))))
    assert_allclose(values[0], error[0] @ np.linalg.inv(covariance) @ error[0])
    assert abs(values.mean() - 3) < 4 * np.sqrt(6 / 5000)
    assert_allclose(values.var(), 6, rtol=0.2)
