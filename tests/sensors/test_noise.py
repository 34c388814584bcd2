"""Noise against its Allan deviation (IEEE Std 952, annex B) and its simplest statistics."""

import numpy as np
import pytest
from tests.refusals import refused

from inercal.physics.sensors import Noise


def allan_deviation(y: np.ndarray, m: int) -> float:
    means = y[..., : y.shape[-1] // m * m].reshape(*y.shape[:-1], -1, m).mean(-1)
    return float(np.sqrt(0.5 * np.mean(np.diff(means, axis=-1) ** 2)))


@pytest.mark.parametrize("m", [1, 10, 100])
def test_white_noise_has_n_over_root_tau(m: int):
    y = Noise(white=2.0).draw(np.random.default_rng(1), (40, 10_000), rate_hz=50.0)
    assert allan_deviation(y, m) == pytest.approx(2.0 / (m / 50.0) ** 0.5, rel=0.03)


@pytest.mark.parametrize("m", [64, 256, 1024])
def test_bias_instability_has_a_floor_of_0664(m: int):
    y = Noise(bias_instability=3.0).draw(np.random.default_rng(2), (60, 1 << 15), rate_hz=10.0)
    assert allan_deviation(y, m) == pytest.approx(0.664 * 3.0, rel=0.05)


@pytest.mark.parametrize("m", [100, 300])
def test_random_walk_grows_with_root_tau_over_three(m: int):
    y = Noise(random_walk=0.5).draw(np.random.default_rng(3), (200, 20_000), rate_hz=10.0)
    assert allan_deviation(y, m) == pytest.approx(0.5 * (m / 10.0 / 3) ** 0.5, rel=0.06)


def test_quantisation_rounds_to_its_step():
    y = Noise(quantisation=0.25).quantise(np.array([0.1, 0.2, -0.9]))
    assert y.tolist() == [0.0, 0.25, -1.0]


def test_a_negative_noise_is_refused_by_name():
    with refused(names=["white"]):
        Noise(white=-1.0)


def test_a_correlation_time_makes_the_drift_a_gauss_markov_process():
    noise = Noise(bias_instability=3.0, correlation=2.0)
    drift = noise.draw(np.random.default_rng(1), (2000, 81), 10.0)
    assert np.std(drift[:, 0]) == pytest.approx(3.0, rel=0.05)
    for lag in (20, 40, 80):
        correlation = np.mean(drift[:, 0] * drift[:, lag]) / 9
        assert abs(correlation - np.exp(-lag / 20)) < 3 / np.sqrt(2000)
