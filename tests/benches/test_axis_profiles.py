"""Moves from rest to rest: within their limits, to the angle exactly, without a jump."""

from math import radians

import numpy as np
import pytest
from tests.refusals import refused

from inercal.benches.motion_control import AxisMotionLimits
from inercal.benches.turntable.simulation import join_profiles, move_profile

TRAPEZOID = AxisMotionLimits(0.5, 0.4)
S_CURVE = AxisMotionLimits(0.5, 0.4, 0.8)
STEEP = AxisMotionLimits(0.5, 4.0, 0.8)  # the acceleration is never reached
ANGLES = [1e-9, 1e-3, 0.3, -0.7, 6.283185307179586, -12.566370614359172]


@pytest.mark.parametrize("limits", [TRAPEZOID, S_CURVE, STEEP])
@pytest.mark.parametrize("angle", ANGLES)
def test_no_limit_is_exceeded_and_the_angle_is_exact(limits: AxisMotionLimits, angle: float):
    seconds, course = move_profile(angle, limits)
    t = np.linspace(0.0, seconds, 20001)
    way, rate, acceleration = course.evaluate(t)
    assert way[0] == 0
    assert way[-1] == angle
    assert course.evaluate(np.array([2 * seconds + 1]))[0] == angle
    assert np.abs(rate).max() <= limits.rate * (1 + 1e-12)
    assert np.abs(acceleration).max() <= limits.acceleration * (1 + 1e-12)
    if limits.jerk is not None:
        assert np.abs(course.state[:, 3]).max() <= limits.jerk * (1 + 1e-12)
    area = np.sum((rate[1:] + rate[:-1]) / 2) * (t[1] - t[0])
    assert area == pytest.approx(angle, rel=2e-8)


@pytest.mark.parametrize("limits", [TRAPEZOID, S_CURVE, STEEP])
@pytest.mark.parametrize("angle", ANGLES)
def test_pieces_join(limits: AxisMotionLimits, angle: float):
    seconds, course = move_profile(angle, limits)
    inside = course.start[course.start > 0]
    before, after = course.evaluate(inside - 1e-9 * seconds), course.evaluate(inside)
    steps = 2e-9 * seconds
    for lower, upper, most in zip(before, after, (limits.rate, limits.acceleration), strict=False):
        assert np.abs(upper - lower).max() <= most * steps + 1e-15
    if limits.jerk is not None:
        assert np.abs(after[2] - before[2]).max() <= limits.jerk * steps + 1e-15


def test_a_long_move_takes_the_time_of_its_rate_and_one_ramp():
    # Ramps of 1.25 s, and of 0.5 s of jerk with them.
    assert move_profile(10.0, TRAPEZOID)[0] == pytest.approx(10 / 0.5 + 0.5 / 0.4)
    assert move_profile(10.0, S_CURVE)[0] == pytest.approx(10 / 0.5 + 0.5 / 0.4 + 0.4 / 0.8)


def test_a_small_angle_is_a_triangle():
    seconds, course = move_profile(0.1, TRAPEZOID)
    assert seconds == pytest.approx(2 * np.sqrt(0.1 / 0.4))
    assert course.evaluate(np.array([seconds / 2]))[1] == pytest.approx(np.sqrt(0.1 * 0.4))


def test_a_small_angle_with_jerk_has_four_ramps():
    seconds, course = move_profile(1e-3, S_CURVE)
    ramp = (1e-3 / (2 * 0.8)) ** (1 / 3)
    assert seconds == pytest.approx(4 * ramp)
    assert course.evaluate(np.array([ramp]))[2] == pytest.approx(0.8 * ramp)


def test_a_move_between_reaches_the_acceleration_and_not_the_rate():
    limits = AxisMotionLimits(5.0, 0.4, 0.8)
    seconds, course = move_profile(1.0, limits)
    _, rate, acceleration = course.evaluate(np.linspace(0, seconds, 20001))
    assert acceleration.max() == pytest.approx(0.4)
    assert rate.max() < 2
    assert course.evaluate(np.array([seconds]))[0] == 1.0


def test_no_angle_takes_no_time():
    seconds, course = move_profile(0.0, S_CURVE)
    assert seconds == 0
    assert course.evaluate(np.array([0.0, 1.0]))[0] == pytest.approx([0, 0])


def test_moves_follow_one_another():
    seconds, one = move_profile(1.0, TRAPEZOID)
    course = join_profiles([(2.0, 0.5, one), (20.0, 1.5, move_profile(-2.0, TRAPEZOID)[1])], 0.5)
    angle = course.evaluate(np.array([-1.0, 1.0, 2.0 + seconds, 19.0, 50.0]))[0]
    assert angle == pytest.approx([0.5, 0.5, 1.5, 1.5, -0.5], abs=1e-15)


@pytest.mark.parametrize("wrong", [0.0, -1.0, float("nan"), float("inf")])
def test_limits_that_cannot_be_are_refused(wrong: float):
    with refused(key="rate"):
        AxisMotionLimits(wrong, 1.0)
    with refused(key="acceleration"):
        AxisMotionLimits(1.0, wrong)
    with refused(key="jerk"):
        AxisMotionLimits(1.0, 1.0, wrong)


def test_a_turn_of_720_degrees_at_10_degrees_a_second_takes_72_seconds_and_a_third():
    assert move_profile(radians(720), AxisMotionLimits(radians(10), radians(30)))[
        0
    ] == pytest.approx(72 + 1 / 3)
