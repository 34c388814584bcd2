"""Changes within rests against turns that gyros see, with motions that are written down here."""

import numpy as np
import pytest
from numpy.typing import NDArray

from inercal.physics.sensors import imu
from inercal.recordings import Mark, Recording
from inercal.recordings.segments import bias_jump_test, changes_within_rests

Array = NDArray[np.float64]
RATE, G = 100.0, 9.81
SENSOR = imu()
COUNT = 600


def tilting(angle: Array) -> Array:
    """Return readings (n, 6) of a sensor that leans about x by an angle, rad."""
    zero = np.zeros(angle.size)
    rate = np.gradient(angle) * RATE
    force = [zero, G * np.sin(angle), G * np.cos(angle)]
    return np.stack([*force, rate, zero, zero], axis=1)


def recording(readings: Array, seed: int = 1) -> Recording:
    noise = np.random.default_rng(seed).standard_normal(readings.shape)
    noise *= [0.01] * 3 + [1e-3] * 3
    time = np.arange(len(readings)) / RATE
    units = ("m/s²",) * 3 + ("rad/s",) * 3
    return Recording(time, readings + noise, SENSOR.channels, units)


def test_a_tilt_changes_specific_force_by_as_much_as_the_gyros_integrate():
    angle = 3e-3 * np.sin(np.arange(COUNT) / 150)
    still = recording(tilting(angle))
    exact = Recording(still.time, tilting(angle), still.channels, still.units)
    halves = changes_within_rests(exact, SENSOR, [Mark("r01", 50, 550)])
    change = halves.change[0, 1]
    assert abs(change) > 0.01
    assert change == pytest.approx(G * halves.integral[0, 3], rel=1e-3)
    assert halves.seconds[0] == pytest.approx(2.5, rel=1e-9)


def test_the_integral_has_the_noise_that_is_stated():
    made = [
        changes_within_rests(recording(np.zeros((400, 6)), seed), SENSOR, [Mark("r01", 0, 400)])
        for seed in range(300)
    ]
    sd = np.std([one.integral[0, 3:] for one in made])
    assert sd == pytest.approx(1e-3 * np.sqrt(made[0].square[0]), rel=0.1)


BESIDE = ((1, (COUNT + 300, COUNT + 550)),)
MARKS = [Mark("r01", 50, 550), Mark("r02", COUNT + 50, COUNT + 300)]


def p_value(readings: Array) -> tuple[float, str]:
    (test,) = bias_jump_test(recording(readings), SENSOR, MARKS, BESIDE)
    return test.p_value, test.name


def test_a_rest_that_was_cut_at_a_step_is_named_with_its_channel():
    readings = tilting(np.zeros(2 * COUNT))
    readings[COUNT + 300 :, 1] += 3e-3 * G
    p, name = p_value(readings)
    assert p < 1e-9
    assert name == f"change within r02 ({SENSOR.channels[1]})"


def test_a_rest_that_was_cut_at_a_tilt_is_no_fault_of_the_accelerometers():
    angle = np.zeros(2 * COUNT)
    angle[COUNT + 280 : COUNT + 320] = np.linspace(0, 3e-3, 40)
    angle[COUNT + 320 :] = 3e-3
    assert p_value(tilting(angle))[0] > 0.01
    assert p_value(tilting(np.zeros(2 * COUNT)))[0] > 0.01


def test_without_a_cut_nothing_is_tested():
    assert bias_jump_test(recording(np.zeros((COUNT, 6))), SENSOR, MARKS[:1], ()) == ()
