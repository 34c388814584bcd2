"""The covariance of drift between sections against drawn noise."""

import numpy as np
import pytest

from inercal.physics.sensors import Noise
from inercal.recordings.segments.section_means import drift_covariance

RATE, SAMPLES, TRIALS = 10.0, 2000, 4000
SECTIONS = [(100, 300), (500, 900), (1500, 1600), (1700, 1990)]


def means(noise: Noise, seed: int) -> np.ndarray:
    drawn = noise.draw(np.random.default_rng(seed), (TRIALS, SAMPLES), RATE)
    return np.stack([drawn[:, a:b].mean(axis=1) for a, b in SECTIONS], axis=1)


def stated(noise: Noise) -> np.ndarray:
    limits = np.array(SECTIONS) / RATE
    durations = limits[:, 1] - limits[:, 0]
    covariance = drift_covariance([noise], limits.mean(axis=1), durations, SAMPLES / RATE)
    assert covariance is not None
    return covariance[..., 0]


@pytest.mark.slow
def test_a_random_walk_has_the_covariance_of_its_earlier_time():
    noise = Noise(random_walk=0.3)
    drawn = np.cov(means(noise, 1).T)
    # sd of a covariance over 4 000 trials: √((c_rr c_ss + c_rs²)/4 000), about 2 %
    np.testing.assert_allclose(drawn, stated(noise), rtol=0.1)


@pytest.mark.slow
@pytest.mark.parametrize("seed", [2, 3])
def test_differences_of_flickering_means_have_the_stated_variance(seed: int):
    # Differences, because what is slower than the recording belongs to the bias.
    noise = Noise(bias_instability=0.5)
    drawn, model = means(noise, seed), stated(noise)
    for r in range(len(SECTIONS)):
        for s in range(r):
            variance = model[r, r] + model[s, s] - 2 * model[r, s]
            assert np.var(drawn[:, r] - drawn[:, s]) == pytest.approx(variance, rel=0.1)


@pytest.mark.slow
def test_flickering_means_have_no_more_than_the_stated_variance_and_most_of_it():
    noise = Noise(bias_instability=0.5)
    ratio = np.var(means(noise, 4), axis=0) / np.diag(stated(noise))
    assert (ratio > 0.7).all()
    assert (ratio < 1.1).all()


def test_without_a_stated_drift_there_is_none():
    assert drift_covariance([Noise(white=1.0)], np.ones(2), np.ones(2), 10.0) is None
