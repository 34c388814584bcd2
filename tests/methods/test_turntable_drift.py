"""Flicker as states of a filter, and the bias as the mean over the run."""

from math import inf, log, pi, sqrt

import numpy as np
import pytest
from numpy.testing import assert_allclose
from numpy.typing import NDArray
from tests.accuracy import turntable
from tests.refusals import refused

from inercal.estimation.kalman import predict
from inercal.methods.turntable.drift import (
    MIN_FLICKER_SPAN,
    Drift,
    covariance_of_means,
    drift_model,
    flicker_processes,
)
from inercal.methods.turntable.drift_propagation import add_drift_cross_covariance, propagate_drift
from inercal.physics.sensors import Noise

Array = NDArray[np.float64]
FLAT = sqrt(2 * log(2) / pi)  # Allan deviation of flicker with B = 1, IEEE Std 952
START, STOP = np.array([0.0, 90.0, 500.0]), np.array([90.0, 130.0, 900.0])
RUN = (0.0, 1000.0)


def allan_deviation(times: Array, variances: Array, averaging_time: Array) -> Array:
    """Return that of a sum of Gauss–Markov processes, by covariances of neighbouring means."""
    total = np.zeros(averaging_time.size)
    for tau, variance in zip(times, variances, strict=True):
        x = averaging_time / tau
        within = 2 * (x - 1 + np.exp(-x)) / x**2
        between = (1 - np.exp(-x)) ** 2 / x**2
        total += variance * (within - between)
    return np.sqrt(total)


@pytest.mark.parametrize(("span", "count"), [(1e4, 4), (1e5, 5), (1e6, 6)])
def test_the_states_have_the_allan_deviation_of_flicker_from_1_s_to_the_span(
    span: float, count: int
):
    times, variances = flicker_processes(3.0, span)
    found = allan_deviation(times, variances, np.geomspace(1.0, span, 300))
    assert times.size == count
    assert np.abs(found / (3.0 * FLAT) - 1).max() < 0.1


@pytest.mark.parametrize("averaging_time", [1.0, 10.0, 100.0])
def test_the_generators_flicker_has_that_allan_deviation(averaging_time: float):
    drawn = turntable.flicker(np.random.default_rng(4), 2.0, 20_000, 20.0, (20,))
    n = int(20 * averaging_time)
    means = drawn[:, : drawn.shape[1] // n * n].reshape(20, -1, n).mean(axis=-1)
    found = sqrt(float((np.diff(means, axis=1) ** 2).mean()) / 2)
    # Of 20 pieces of 1000 s: the deviation at 100 s has some 180 degrees of freedom.
    assert found == pytest.approx(2.0 * FLAT, rel=0.12 if averaging_time > 10 else 0.05)


def test_runs_below_the_span_have_the_same_states_and_longer_ones_more():
    noise = [Noise(1.0, 2.0)] * 3
    short, same, long = (
        drift_model(noise, s) for s in (60.0, MIN_FLICKER_SPAN, 1.1 * MIN_FLICKER_SPAN)
    )
    assert_allclose(short.times, same.times, rtol=0)
    assert long.times.size == short.times.size + 1
    assert long.times[-1] > 4 * short.times[-1]


def test_axes_of_different_correlation_times_are_refused():
    with refused(key="correlation"):
        drift_model([Noise(1.0, 1.0, correlation=t) for t in (1.0, 1.0, 2.0)], 60.0)


def simulated(noise: Array) -> Array:
    """Return the covariance of the means of spans, of noise (trials, 4000) at 4 Hz, centred."""
    noise = noise - noise.mean(axis=1, keepdims=True)
    spans = zip((4 * START).astype(int), (4 * STOP).astype(int), strict=True)
    means = np.stack([noise[:, a:b].mean(axis=1) for a, b in spans])
    return np.asarray(means @ means.T / noise.shape[0])


@pytest.mark.slow
def test_means_of_flicker_vary_about_the_mean_of_the_run_as_stated():
    drawn = turntable.flicker(np.random.default_rng(3), 2.0, 4000, 4.0, (1200,))
    stated = covariance_of_means([Noise(bias_instability=2.0)], START, STOP, RUN)[..., 0]
    assert np.abs(simulated(drawn) - stated).max() < 0.1 * stated.max()


def test_means_of_a_drift_with_a_mean_of_its_own_vary_about_that():
    rng = np.random.default_rng(2)
    drawn: Array = np.asarray(turntable.drift(rng, 2.0, 200.0, 4000, 4.0, 400))
    means = np.stack(
        [drawn[:, int(4 * a) : int(4 * b)].mean(axis=1) for a, b in zip(START, STOP, strict=True)]
    )
    found = np.einsum("rti,sti->rs", means, means) / (400 * 3)
    noise = Noise(bias_instability=2.0, correlation=200.0)
    stated = covariance_of_means([noise], START, STOP, RUN)[..., 0]
    assert np.abs(found - stated).max() < 0.05 * 4


def test_a_walk_grows_from_the_start():
    start, stop = np.array([0.0, 100.0]), np.array([10.0, 130.0])
    noise = Noise(random_walk=sqrt(3.0))
    made = covariance_of_means([noise], start, stop, (0.0, 130.0))[..., 0]
    assert made == pytest.approx(3.0 * np.array([[10 / 3, 5.0], [5.0, 110.0]]))


def test_the_states_vary_between_spans_as_flicker_does():
    # 20 % in variance are 10 % in deviation.
    exact = covariance_of_means([Noise(bias_instability=1.0)], START, STOP, RUN)[..., 0]
    times, variances = flicker_processes(1.0, MIN_FLICKER_SPAN)
    start, stop = np.append(START, RUN[0]), np.append(STOP, RUN[1])
    whole = np.zeros((4, 4))
    for tau, variance in zip(times, variances, strict=True):
        one = Noise(bias_instability=sqrt(variance), correlation=tau)
        whole += covariance_of_means([one], start, stop, RUN)[..., 0]
    centred = whole - whole[:, -1:] - whole[-1:] + whole[-1, -1]
    for weights in ((1, 0, 0), (0, 1, 0), (0, 0, 1), (1, -1, 0), (0, 1, -1)):
        by = np.array(weights, dtype=float)
        assert by @ centred[:3, :3] @ by == pytest.approx(by @ exact @ by, rel=0.2)


def carried(made: Drift, steps: Array) -> Array:
    """Return the covariance of the drift's states after steps of time, s."""
    p, s = made.covariance(), made.size
    keep, drawn, joint = np.ones(s), np.zeros(s), np.zeros((made.times.size, 3))
    for step in steps.tolist():
        propagate_drift(made, step, 0, keep, drawn, joint)
        predict(p, np.zeros((0, s)), keep, np.zeros((0, 0)), drawn, np.zeros((0, s)))
        add_drift_cross_covariance(made, 0, joint, p)
    return p


@pytest.mark.parametrize("since", [0.0, 37.0])
def test_the_states_hold_the_mean_over_the_run(since: float):
    # One Gauss–Markov process, and a walk that is not part of it.
    tau, variance, walk = 50.0, np.array([4.0, 1.0, 0.0]), np.array([0.0, 0.5, 2.0])
    made = Drift(np.array([tau, inf]), np.stack([variance, np.zeros(3)]), walk, mean_over_run=True)
    steps = np.random.default_rng(1).uniform(0.1, 20.0, 30)
    p, total = carried(made, steps), float(steps.sum()) + since
    by, beyond = made.mean(total, since)
    x = total / tau
    expected = variance * 2 * (x - 1 + np.exp(-x)) / x**2
    assert_allclose(by @ p @ by.T + np.diag(beyond), np.diag(expected), rtol=1e-9, atol=1e-12)


def test_the_mean_so_far_is_that_of_the_integral():
    made = drift_model([Noise(1.0, 2.0, 0.1)] * 3, 600.0)
    states = np.random.default_rng(2).standard_normal((5, made.size))
    elapsed = np.array([0.0, 10.0, 20.0, 300.0, 600.0])
    found = made.running_mean(states, elapsed)
    for row, one, since in zip(found, states, elapsed.tolist(), strict=True):
        assert_allclose(row, made.mean(since)[0] @ one if since else np.zeros(3), atol=1e-9)
