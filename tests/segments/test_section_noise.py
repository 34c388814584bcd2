"""Means of rests that change, drift or scatter unlike the others."""

import re
from collections.abc import Sequence

import numpy as np
import pytest
from numpy.typing import NDArray

from inercal.physics.plan import six_positions
from inercal.physics.sensors import Noise, Readout, Sensor, imu
from inercal.recordings import Mark, Observations, Recording
from inercal.recordings.segments import average_sections

Array = NDArray[np.float64]
RATE, COUNT, G = 100.0, 1000, 9.81
STEPS = six_positions()
SENSOR = imu().select_axes("f")
MARKS = tuple(Mark(step.label, k * COUNT, (k + 1) * COUNT) for k, step in enumerate(STEPS))


def data(seed: int = 1, size: float = 0.01) -> Array:
    """Return six rests of ten seconds, m/s²."""
    ups = np.repeat([G * np.array(step.up) for step in STEPS], COUNT, axis=0)
    return ups + size * np.random.default_rng(seed).standard_normal(ups.shape)


def seen(
    values: Array, sensor: Sensor = SENSOR, *, drifting: bool = False, found: bool = False
) -> Observations:
    time = np.arange(len(values)) / RATE
    recording = Recording(time, values, sensor.channels, ("m/s²",) * 3)
    return average_sections(recording, sensor, MARKS, STEPS, drifting=drifting, found=found)


def sd(observations: Observations) -> Array:
    """Return the standard deviation of each mean, (r, 3)."""
    return np.sqrt(np.diagonal(observations.covariance, axis1=-2, axis2=-1))


def p_values(observations: Observations) -> Sequence[float]:
    return [test.p_value for test in observations.tests]


def test_quiet_rests_reject_nothing_and_have_the_variance_of_their_samples() -> None:
    found = seen(data(), drifting=True)
    assert len(found.tests) == 2
    assert min(p_values(found)) > 0.001
    assert len(found.notes) == 1
    assert "drift" in found.notes[0]  # as little of it as no test could show
    assert seen(data()).notes == ()
    np.testing.assert_allclose(sd(found), 0.01 / np.sqrt(COUNT), rtol=0.25)


def test_a_step_within_a_rest_names_the_rest_and_the_axis() -> None:
    values = data()
    values[3 * COUNT + COUNT // 2 : 4 * COUNT, 2] += 0.5e-3 * G
    worst = min(seen(values, found=True).tests, key=lambda test: test.p_value)
    assert worst.p_value < 1e-6
    assert STEPS[3].label in worst.name
    assert SENSOR.channels[2] in worst.name


@pytest.mark.parametrize("settling", [False, True])
def test_a_drift_over_the_run_is_named_and_taken_off_the_means(settling: bool) -> None:
    values, reach = data(), 4e-3 * G
    time = (np.arange(len(values)) + 0.5) / len(values)
    course = -np.exp(-2 * time) if settling else time
    values += reach * (course - course.mean())[:, None]
    found = seen(values, drifting=True)
    assert min(p_values(found)) < 1e-6
    assert found.drift is not None
    spread = np.sqrt(np.diagonal(found.drift, axis1=0, axis2=1).T + sd(found) ** 2)
    exact = [G * np.array(step.up) for step in STEPS]
    assert np.abs((found.without_drift.mean - exact) / spread).max() < 4
    # Formulas that take the means as they are have the drift itself in their covariance.
    every = np.diagonal(found.full_covariance).reshape(6, 3)
    assert (np.abs(found.mean - exact) < 2.5 * np.sqrt(every)).all()
    # The slopes of 10 s leave 0.005 m/s² over the run open.
    assert 0.1 * reach < spread[0].max() < 0.3 * reach
    assert seen(values).drift is None


def test_noise_as_slow_as_the_rests_rejects_the_model() -> None:
    rng = np.random.default_rng(5)
    values = data(5)
    steps = 0.02 / np.sqrt(RATE) * rng.standard_normal(values.shape)
    found = seen(values + np.cumsum(steps, axis=0), found=True)
    slow = [test for test in found.tests if "slower" in test.name]
    assert [test.p_value < 1e-4 for test in slow] == [True]
    assert not any("slower" in test.name for test in seen(data(5)).tests)


def test_slow_noise_enlarges_the_variance_of_means_and_is_reported() -> None:
    rng = np.random.default_rng(3)
    ratios: list[float] = []
    for seed in range(5):
        values = data(seed, 1e-4)
        state, keep = rng.standard_normal(3), np.exp(-1 / RATE)
        slow = np.empty_like(values)
        for k in range(len(values)):
            state = keep * state + np.sqrt(1 - keep**2) * rng.standard_normal(3)
            slow[k] = state
        found = seen(values + 0.01 * slow)
        assert len(found.notes) == 1
        assert "correlated" in found.notes[0]
        assert min(p_values(found)) > 1e-3
        ratios.append(float(np.median(sd(found))))
    seconds = COUNT / RATE
    expected = 0.01 * np.sqrt(2 / seconds * (1 - (1 - np.exp(-seconds)) / seconds))
    assert np.median(ratios) == pytest.approx(expected, rel=0.25)


@pytest.mark.parametrize("noise", [Noise(bias_instability=1e-4), Noise(random_walk=3e-5)])
def test_a_drift_beyond_the_stated_slow_noise_is_found_as_if_none_were_stated(noise: Noise) -> None:
    stated = imu(accelerometer=(Readout(), noise)).select_axes("f")
    agrees, by_statement = seen(data(), stated, drifting=True), seen(data(), stated)
    assert agrees.drift is not None
    assert by_statement.drift is not None
    np.testing.assert_array_equal(agrees.drift, by_statement.drift)
    assert agrees.drift_mean is None
    values = data()
    values += 4e-3 * G * ((np.arange(len(values)) + 0.5) / len(values) - 0.5)[:, None]
    found, unstated = seen(values, stated, drifting=True), seen(values, drifting=True)
    assert min(p_values(found)) < 1e-6
    assert found.drift is not None
    assert unstated.drift is not None
    np.testing.assert_allclose(found.drift - by_statement.drift, unstated.drift, rtol=0.1)
    np.testing.assert_allclose(
        found.without_drift.mean, unstated.without_drift.mean, rtol=0, atol=1e-4
    )


@pytest.mark.parametrize("rate", [0.0, 1e-3])
def test_a_drift_of_the_gyros_is_only_stated_if_it_is_found(rate: float) -> None:
    sensor = imu().select_axes("w")
    rng = np.random.default_rng(7)
    time = (np.arange(6 * COUNT) + 0.5) / RATE
    values = 1e-3 * rng.standard_normal((6 * COUNT, 3)) + rate * (time / time[-1])[:, None]
    notes = " ".join(seen(values, sensor, drifting=True).notes)
    found = re.findall(r"about (\d+) °/h .* (\d+) s after", notes)
    assert len(found) == (rate > 0)
    for size, middle in found:  # 0.001 rad/s are 206 °/h, and the rests are centred at 30 s
        assert int(size) == pytest.approx(206, rel=0.3)
        assert middle == "30"


def test_a_random_walk_far_beyond_the_stated_one_rejects_the_model() -> None:
    stated = imu(accelerometer=(Readout(), Noise(random_walk=1e-3))).select_axes("f")
    for walk, beyond in ((1e-3, False), (0.02, True)):
        steps = walk / np.sqrt(RATE) * np.random.default_rng(5).standard_normal(data().shape)
        tests = seen(data(5) + np.cumsum(steps, axis=0), stated, found=True).tests
        assert any("slower" in t.name and t.p_value < 1e-4 for t in tests) == beyond


def test_a_rest_of_larger_noise_has_a_larger_uncertainty_and_is_no_violation() -> None:
    values = data()
    loud = slice(2 * COUNT, 3 * COUNT)
    values[loud] += 0.12 * np.random.default_rng(5).standard_normal((COUNT, 3))
    found = seen(values)
    assert min(p_values(found)) > 1e-3
    ratio = sd(found)[2] / np.median(sd(found), axis=0)
    np.testing.assert_allclose(ratio, 12.0, rtol=0.35)
    assert any(STEPS[2].label in note for note in found.notes)


@pytest.mark.parametrize("seed", range(5))
def test_coarse_steps_reject_nothing(seed: int) -> None:
    q = 4e-3 * G
    found = seen(np.round((data(seed) + 0.3 * q * seed) / q) * q, found=True)
    assert all(p > 1e-3 for p in p_values(found))


def test_many_trials_have_a_variance_each_and_no_tests() -> None:
    values = np.stack([data(seed) for seed in range(3)])
    values[1, 2 * COUNT : 3 * COUNT] += 0.12 * np.random.default_rng(6).standard_normal((COUNT, 3))
    time = np.arange(values.shape[1]) / RATE
    recording = Recording(time, values, SENSOR.channels, ("m/s²",) * 3)
    found = average_sections(recording, SENSOR, MARKS, STEPS)
    alone = seen(values[1])
    np.testing.assert_allclose(found.covariance[1], alone.covariance, rtol=1e-12)
    assert found.tests == ()
