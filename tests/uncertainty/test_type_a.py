import numpy as np
import pytest
from numpy.testing import assert_allclose
from numpy.typing import NDArray
from scipy import stats
from scipy.signal import lfilter
from tests.base_seeds import SEEDS

from inercal.basics.errors import InputError
from inercal.estimation.uncertainty import pooled_mean_covariances

Array = NDArray[np.float64]
MIX = np.array([[1.0, 0.0, 0.0], [0.6, 0.8, 0.0], [-0.3, 0.2, 2.0]])


def noise(rng: np.random.Generator, trials: int, n: int, phi: float) -> Array:
    """Return AR(1) noise x' = φ x + e of three correlated channels, (trials, n, 3)."""
    settling = 300
    e = rng.normal(size=(trials, n + settling, 3)) @ MIX.T
    return np.asarray(lfilter([1.0], [1.0, -phi], e, axis=1))[:, settling:]


def mean_covariance(samples: Array) -> tuple[Array, float]:
    """Return the covariance of the mean of one section, and its degrees of freedom."""
    covariances, dof = pooled_mean_covariances([samples])
    return covariances[0], dof


def long_run(phi: float) -> Array:
    """Return n times the covariance of the mean of much AR(1) noise."""
    return MIX @ MIX.T / (1 - phi) ** 2


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize(("phi", "n"), [(0.0, 37), (0.0, 1000), (0.5, 1000), (0.9, 4000)])
def test_intervals_cover_the_mean_as_often_as_they_say(phi: float, n: int, seed: int):
    trials = 1000
    samples = noise(np.random.default_rng(seed), trials, n, phi)
    covariance, dof = mean_covariance(samples)
    sd = np.sqrt(np.diagonal(covariance, axis1=-2, axis2=-1))
    inside = np.abs(samples.mean(axis=1)) < stats.t.ppf(0.975, dof) * sd
    # 0.02 beside the sampling: batches of a few hundred do not quite forget φ = 0.9.
    sampling = 4 * np.sqrt(0.95 * 0.05 / trials)
    assert np.all(np.abs(inside.mean(axis=0) - 0.95) < sampling + (0.02 if phi == 0.9 else 0.0))


def test_naive_intervals_of_correlated_noise_do_not_cover():
    samples = noise(np.random.default_rng(1), 500, 4000, 0.9)
    naive = 1.96 * samples.std(axis=1) / np.sqrt(4000)
    assert np.mean(np.abs(samples.mean(axis=1)) < naive) < 0.5


@pytest.mark.slow
@pytest.mark.parametrize("phi", [0.0, 0.5])
def test_covariance_of_the_channels_is_unbiased(phi: float):
    n, trials = 2000, 2000
    covariance, dof = mean_covariance(noise(np.random.default_rng(5), trials, n, phi))
    assert dof == 19
    sd = np.sqrt(np.diag(long_run(phi)))
    scaled = n * covariance.mean(axis=0) / np.outer(sd, sd)
    expected = long_run(phi) / np.outer(sd, sd)
    assert_allclose(scaled, expected, atol=4 * np.sqrt(2 / (19 * trials)) + 0.03 * (phi > 0))


def test_independent_samples_in_batches_of_one_are_the_gum():
    samples = np.random.default_rng(0).normal(size=(15, 2))
    covariance, dof = mean_covariance(samples)
    assert dof == 14
    assert_allclose(covariance, np.cov(samples.T) / 15, rtol=1e-12)


@pytest.mark.slow
def test_pooled_sections_share_their_noise_by_length():
    rng = np.random.default_rng(9)
    lengths = [400, 1000, 3000]
    sections = [noise(rng, 800, n, 0.3) + rng.normal(size=3) * 100 for n in lengths]
    covariances, dof = pooled_mean_covariances(sections)
    assert dof == 3 * 19
    for n, covariance in zip(lengths, covariances, strict=True):
        assert_allclose(covariance * n, covariances[0] * 400, rtol=1e-12)
        ratio = (
            n * np.diagonal(covariance, axis1=-2, axis2=-1).mean(axis=0) / np.diag(long_run(0.3))
        )
        assert_allclose(ratio, 1.0, atol=4 * np.sqrt(2 / (57 * 800)) + 0.02)


def test_sections_too_short_alone_are_enough_together():
    rng = np.random.default_rng(2)
    sections = [rng.normal(size=(2, 6)) for _ in range(24)]
    covariances, dof = pooled_mean_covariances(sections)
    assert dof == 24
    np.linalg.cholesky(covariances[0])
    with pytest.raises(InputError):
        mean_covariance(sections[0])


def test_trials_together_equal_trials_alone():
    samples = np.random.default_rng(3).normal(size=(4, 101, 3))
    together, _ = mean_covariance(samples)
    for one, covariance in zip(samples, together, strict=True):
        assert_allclose(mean_covariance(one)[0], covariance, rtol=1e-12)
