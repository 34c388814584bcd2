"""The accelerometers' noise under a hand's tremor, against noise that is known."""

import numpy as np
import pytest
from numpy.typing import NDArray
from tests.accuracy.handheld import directions
from tests.base_seeds import SEEDS

from inercal.physics.sensors import imu
from inercal.recordings.segments.section_noise import density_without_hand_motion

Array = NDArray[np.float64]
RATE, SECONDS, G = 100.0, 3.0, 9.81
NOISE = np.array([1e-3, 2e-3, 4e-3])  # of the axes, m/s² times √s
DENSITY = np.diag(np.r_[NOISE, NOISE] ** 2 * RATE)


def rests(seed: int, wobble: float, push: float, count: int = 300) -> list[Array]:
    """Return rests (n, 6) in all attitudes: noise, a wobble of 0.2 and 8 Hz, a push of 8 Hz."""
    rng = np.random.default_rng(seed)
    t = np.arange(0, SECONDS, 1 / RATE)
    made: list[Array] = []
    for up in directions(count, rng):
        phase = rng.uniform(0, 2 * np.pi, (2, 3, 1))
        slow, fast = (
            np.sin(2 * np.pi * hz * t + p) for hz, p in zip((0.2, 8.0), phase, strict=True)
        )
        angle = wobble * (slow + 0.5 * fast)
        body = np.zeros((t.size, 6))
        body[:, :3] = G * (up + np.cross(up, angle.T)) + push * fast.T
        body += np.sqrt(np.diag(DENSITY)) * rng.standard_normal(body.shape)
        made.append(body)
    return made


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize(("wobble", "push"), [(0.0, 0.0), (1e-3, 0.0), (1e-3, 0.03)])
def test_each_axis_noise_is_found_whatever_the_hand_does(seed: int, wobble: float, push: float):
    found = density_without_hand_motion(10 * DENSITY, imu(), rests(seed, wobble, push))
    # 300 rests of about 10 degrees of freedom, a third of them an axis': 5 %.
    np.testing.assert_allclose(np.diag(found)[:3], NOISE**2 * RATE, rtol=0.3)
    assert np.all(found[:3, 3:] == 0)
    np.testing.assert_array_equal(found[3:, 3:], 10 * DENSITY[3:, 3:])


@pytest.mark.slow
def test_the_mean_of_many_axes_noise_is_unbiased():
    ratio = [
        np.trace(density_without_hand_motion(DENSITY, imu(), rests(seed, 1e-3, 0.0))[:3, :3])
        / np.sum(NOISE**2 * RATE)
        for seed in range(10, 20)
    ]
    standard_error = np.std(ratio, ddof=1) / len(ratio) ** 0.5
    assert np.mean(ratio) == pytest.approx(1, abs=4 * standard_error)


def test_rests_without_any_noise_leave_the_density_as_it_is():
    still = [np.tile([0.0, 0.0, G, 0, 0, 0], (300, 1))] * 3
    np.testing.assert_array_equal(density_without_hand_motion(DENSITY, imu(), still), DENSITY)


def test_axes_that_are_alike_are_not_set_apart_by_chance():
    alike = np.full(3, NOISE[0] ** 2 * RATE)
    ratios: list[Array] = []
    for seed in range(30):
        rng = np.random.default_rng(seed)
        made = []
        for up in directions(24, rng):
            body = np.zeros((round(SECONDS * RATE), 6))
            body[:, :3] = G * up + np.sqrt(alike[0]) * rng.standard_normal((len(body), 3))
            made.append(body)
        found = np.diag(density_without_hand_motion(DENSITY, imu(), made))[:3]
        ratios.append(found / alike)
    # By 24 rests of 10 degrees of freedom each: 9 %. An axis apart would have some 22 %.
    scatter = np.std(ratios, axis=0)
    assert np.all(scatter < 0.16)
    assert np.mean(ratios) == pytest.approx(1, abs=4 * 0.09 / len(ratios) ** 0.5)
