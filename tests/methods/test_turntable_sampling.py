"""How sampled rates become angles between readbacks, and how much noise neighbours share."""

from collections.abc import Callable
from math import pi
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from inercal.methods.turntable import RATE, Terms
from inercal.methods.turntable_kalman import _readback
from inercal.methods.turntable_trajectory import _kernels
from inercal.methods.turntable_trajectory._kernels import neighbour_share, rate_bends

Array = NDArray[np.float64]
STEP = 0.02  # s
WHITE = np.full(3, 1e-12)
NO_TERMS = Terms(np.eye(3), np.zeros(0, np.int64), np.zeros((0, 13)), RATE)


def samples(count: int) -> Array:
    return np.asarray(STEP * np.arange(count), dtype=np.float64)


def in_python(compiled: Any) -> Callable[[float], float]:
    """Return a function that kernels call, as Python runs it."""
    return compiled.py_func


def differences(time: Array, rates: Array, when: Array, at: Array) -> tuple[Array, Array]:
    """Return what three ideal gyros find beyond attitudes `at` at `when`, and what they share."""
    e = when.size - 1
    apart, columns = np.zeros((e, 3)), np.zeros((e, 3, 0))
    drifting, driven, shared = (np.zeros((k, 3, 3)) for k in (e, e, e + 1))
    _kernels.increments(
        time, rates, *rate_bends(time, rates, WHITE), when, at, NO_TERMS, np.zeros(0),
        np.zeros(3), 9.8, WHITE, np.zeros(0), apart, columns, drifting, driven, shared,
    )  # fmt: skip
    return apart, shared


def about_up(angle: Array) -> Array:
    c, s, o = np.cos(angle), np.sin(angle), np.zeros_like(angle)
    return np.stack([c, -s, o, s, c, o, o, o, o + 1], axis=-1).reshape(-1, 3, 3)


@pytest.mark.slow
@pytest.mark.parametrize("late", [0.0, 0.3, 0.77])
def test_angles_between_samples_are_those_of_a_rate_that_bends(late: float):
    time = samples(40)
    when: Array = time[5:35:5] + late * STEP
    a, b, c = 0.3, 2.0, -1.5
    rates = np.column_stack([np.zeros((40, 2)), a + b * time + c * time**2])
    apart, _ = differences(
        time, rates, when, about_up(a * when + b * when**2 / 2 + c * when**3 / 3)
    )
    assert np.abs(apart).max() < 1e-14
    # As trapezoids would have it
    assert abs(c) * (when[1] - when[0]) * STEP**2 / 6 > 1e-7


@pytest.mark.parametrize("late", [0.0, 0.1, 0.5, 0.9])
def test_neighbouring_increments_share_as_much_noise_as_is_stated(late: float):
    time = samples(40)
    when: Array = time[5:35:5] + late * STEP
    still = np.tile(np.eye(3), (when.size, 1, 1))
    by, shared = np.empty((when.size - 1, time.size)), np.zeros((when.size, 3, 3))
    for k in range(time.size):
        rates = np.zeros((40, 3))
        rates[k, 2] = 1e-6
        apart, shared = differences(time, rates, when, still)
        by[:, k] = -apart[:, 2] / (1e-6 * STEP)
    common = by @ by.T
    assert np.diagonal(common, 1) == pytest.approx(in_python(neighbour_share)(late))
    assert np.diagonal(common) + 2 * common[1, 2] == pytest.approx(5.0)
    assert np.abs(np.diagonal(common, 2)).max() < 1e-9
    assert shared[1, 2, 2] == pytest.approx(common[1, 2] * WHITE[2] * STEP)


@pytest.mark.parametrize("late", [0.0, 0.1, 0.5, 0.9])
def test_attitudes_between_samples_share_as_much_noise_as_is_stated(late: float):
    # A parabola through the last three samples, and a cubic through four angles
    weights = np.array(
        [
            -late * (late - 1) * (late - 2) / 6,
            (late + 1) * (late - 1) * (late - 2) / 2,
            -(late + 1) * late * (late - 2) / 2,
            (late + 1) * late * (late - 1) / 6,
        ]
    )
    counted = np.zeros(20)
    for row, weight in zip((9, 10, 11, 12), weights, strict=True):
        counted[: row - 1] += weight
        counted[[row - 1, row]] += weight * np.array([13, 5]) / 12
    exact = np.sum(counted * (1 - counted))
    assert in_python(_readback._neighbour_share)(late) == pytest.approx(exact)


def test_sudden_accelerations_add_to_the_variance_of_an_angle_and_smooth_ones_do_not():
    time = samples(200)
    smooth = np.sin(2 * pi * time / 4)[:, None] * np.array([0.0, 0.0, 0.3])
    sudden: Array = np.clip(time - 1.013, 0, 1)[:, None] * np.array([0.0, 0.0, 0.5])
    white = np.full(3, 1e-10)
    assert not rate_bends(time, smooth, white)[1].any()
    kinks = rate_bends(time, sudden, white)[1]
    # 1/720 of the square of the angle that the acceleration makes in a step; so much at both ends
    assert kinks.sum() == pytest.approx(2 * (0.5 * STEP**2) ** 2 / 720, rel=0.5)


def test_steps_too_unequal_have_no_bend():
    time = np.concatenate([samples(10), 1 + samples(10)])
    rates = np.column_stack([time**2] * 3)
    bends, _ = rate_bends(time, rates, WHITE)
    assert np.allclose(bends[[*range(2, 9), *range(12, 20)]], 2.0)
    assert not bends[10].any()
