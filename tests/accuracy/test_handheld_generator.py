"""The generator of hand-held sessions itself, held against physics."""

from dataclasses import replace
from itertools import pairwise
from math import ceil, floor

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation
from tests.accuracy.ferraris import DEGREE, EARTH, Imu, mems
from tests.accuracy.handheld import (
    Handheld,
    Session,
    about_one_axis,
    directions,
    planar,
    readings,
    record,
    to_triangular,
    triangular,
)

pytestmark = pytest.mark.slow  # nothing of inercal is in these tests
Array = NDArray[np.float64]
LATITUDE = 47 * DEGREE
PERFECT = Imu(np.eye(3), np.zeros(3), np.eye(3), np.zeros(3), np.zeros((3, 3)))
FAST = Session(positions=4, hold_seconds=1.0, move_seconds=1.0, rate_hz=2000.0)


def made(session: Session, imu: Imu = PERFECT, seed: int = 7, trials: int = 1) -> Handheld:
    return record(imu, session, np.random.default_rng(seed), trials=trials)


def angle(a: Array, b: Array) -> Array:
    return np.arctan2(np.linalg.norm(np.cross(a, b), axis=-1), (a * b).sum(-1))


def carried(
    data: Array, start: int, stop: int, rate_hz: float, *, coning: bool = False
) -> Rotation:
    """Return the turn from the middle of one sample to that of another, by the gyros."""
    part = data[start : stop + 1, 3:] / rate_hz
    part[[0, -1]] /= 2
    if coning:
        part[1:] += (
            np.cross(part[:-1], part[1:]) / 12
        )  # of a rate that changes evenly from step to step
    total = Rotation.identity()
    for step in Rotation.from_rotvec(part):
        total = total * step
    return total


def test_the_norm_at_rest_is_gravity() -> None:
    session = made(Session(gravity_sd=0.01), trials=3)
    for k, (start, stop) in enumerate(session.rests):
        f = session.data[:, start:stop, :3]
        np.testing.assert_allclose(f[:, 0], session.gravity[:, None] * session.ups[:, k])
        assert np.ptp(f, axis=1).max() < 1e-12
    assert np.abs(session.gravity - 9.81).max() > 1e-3


def test_a_wobble_leaves_the_norm_and_shortens_the_mean_by_its_square() -> None:
    session = made(Session(tremor_deg=1.0), trials=40)
    rests = np.stack([session.data[:, a:b, :3] for a, b in session.rests], axis=1)
    np.testing.assert_allclose(np.linalg.norm(rests, axis=-1), 9.81, rtol=1e-12)
    off = angle(rests, session.ups[:, :, None])
    assert np.sqrt(np.mean(off**2) / 2) == pytest.approx(DEGREE, rel=0.03)  # two axes tilt it
    short = 1 - np.linalg.norm(rests.mean(axis=2), axis=-1) / 9.81
    assert 0.3 * DEGREE**2 < short.mean() < DEGREE**2


def test_a_push_has_the_rms_asked_for_and_a_bounded_velocity() -> None:
    session = made(Session(tremor_push=0.1), trials=20)
    rests = np.stack([session.data[:, a:b, :3] for a, b in session.rests], axis=1)
    push = rests - 9.81 * session.ups[:, :, None]
    assert np.sqrt(np.mean(push**2)) == pytest.approx(0.1, rel=0.03)
    # 0.1 m/s² at about 8 Hz is a tremor of 2 mm/s, and of the sway there is twice as much: a mean
    # over 3 s cannot be more than a change of some 6 mm/s in that time.
    assert 1e-4 < np.sqrt(np.mean(push.mean(axis=2) ** 2)) < 2.5e-3


@pytest.mark.parametrize("tremor", [0.0, 0.3])
def test_the_gyros_carry_gravity_from_rest_to_rest(tremor: float) -> None:
    session = made(replace(FAST, tremor_deg=tremor))
    for (_, start), (stop, _) in pairwise(session.rests):
        turn = carried(session.data[0], start - 50, stop + 50, FAST.rate_hz)
        before, after = session.data[0, [start - 50, stop + 50], :3]
        assert angle(before, after) > 30 * DEGREE
        assert angle(turn.apply(after), before) < 1e-6


def test_a_gyro_gives_the_mean_of_its_rate_and_not_the_turn() -> None:
    session = made(Session(move_seconds=1.0, yaw_deg=180.0))
    errors = np.empty((2, 23))
    for k, ((_, start), (stop, _)) in enumerate(pairwise(session.rests)):
        before, after = session.data[0, [start - 1, stop], :3]
        for coning in (False, True):
            turn = carried(session.data[0], start - 1, stop, 100.0, coning=coning)
            errors[int(coning), k] = angle(turn.apply(after), before)
    assert errors[0].max() > 1e-5  # at 100 Hz the product of the steps is not the turn
    assert errors[1].max() < errors[0].max() / 10


def test_the_earth_is_felt_at_rest_and_carried_through_moves() -> None:
    session = made(replace(FAST, latitude=LATITUDE))
    middles = [(a + b) // 2 for a, b in session.rests]
    at_rest = session.data[0, middles]
    up, earth = at_rest[:, :3] / 9.81, at_rest[:, 3:]
    np.testing.assert_allclose(np.linalg.norm(earth, axis=1), EARTH, rtol=1e-9)
    np.testing.assert_allclose((up * earth).sum(1), EARTH * np.sin(LATITUDE), rtol=1e-9)
    for k, (a, b) in enumerate(pairwise(middles)):
        turn = carried(session.data[0], a, b, FAST.rate_hz)  # the pole star stays where it is
        assert angle(turn.apply(earth[k + 1]), earth[k]) < 1e-6
    none = made(FAST)
    assert not none.data[0, middles, 3:].any()


def test_the_hand_moves_the_sensor_only_between_rests() -> None:
    still, moved = made(replace(FAST, arm=0.0)), made(FAST)
    norm = np.linalg.norm(moved.data[0, :, :3], axis=1)
    np.testing.assert_allclose(np.linalg.norm(still.data[0, :, :3], axis=1), 9.81)
    at_rest = np.zeros(norm.size, dtype=bool)
    for start, stop in moved.rests:
        at_rest[start:stop] = True
    np.testing.assert_allclose(norm[at_rest], 9.81)
    assert np.abs(norm[~at_rest] - 9.81).max() > 0.5


def test_accelerometers_off_the_turning_axis_feel_the_turn() -> None:
    arm = np.array([0.03, -0.02, 0.05])
    session = replace(FAST, arm=0.0)
    at, off = made(session).data[0], made(session, replace(PERFECT, arm=arm)).data[0]
    w = at[:, 3:]
    felt = np.cross(np.gradient(w, 1 / FAST.rate_hz, axis=0), arm) + np.cross(w, np.cross(w, arm))
    np.testing.assert_allclose(off[:, :3] - at[:, :3], felt, atol=2e-3)
    assert np.abs(felt).max() > 0.2


@pytest.mark.parametrize("samples", [2.0, 2.5])
@pytest.mark.parametrize("tremor", [0.0, 0.3])
def test_late_gyros_are_late_by_the_delay(samples: float, tremor: float) -> None:
    session = replace(FAST, tremor_deg=tremor, latitude=LATITUDE)
    prompt, late = (made(replace(session, delay=d)) for d in (0.0, samples / FAST.rate_hz))
    np.testing.assert_array_equal(late.data[..., :3], prompt.data[..., :3])
    w, count = prompt.data[0, :, 3:], prompt.time.size
    earlier, later = (w[5 - n : count - n] for n in (ceil(samples), floor(samples)))
    tolerance = 1e-9 if samples == 2.0 else 5e-4  # halfway between samples by a straight line
    np.testing.assert_allclose(late.data[0, 5:, 3:], (earlier + later) / 2, atol=tolerance)


def test_coefficients_in_the_triangular_frame_give_the_same_readings() -> None:
    rng = np.random.default_rng(3)
    imu = mems(rng, arm=np.array([0.03, -0.02, 0.05]))
    low, turn = triangular(imu), to_triangular(imu)
    assert not np.triu(low.M_a, 1).any()
    assert np.diag(low.M_a).min() > 0.9
    np.testing.assert_allclose(turn @ turn.T, np.eye(3), atol=1e-14)
    f, w, k2, k3 = 10 * rng.standard_normal((4, 50, 3))
    k2, k3 = 1e-4 * k2[0], 1e-5 * k3[0]
    once, again = (np.hstack([f @ q.T, w @ q.T]) for q in (np.eye(3), turn))
    np.testing.assert_allclose(
        readings(imu, once, k2, k3), readings(low, again, k2, k3), rtol=1e-12, atol=1e-12
    )
    # And a whole session whose up is given in the one frame or the other.
    ups, session = directions(6, rng), Session(arm=0.0)
    one = record(imu, session, np.random.default_rng(5), ups=ups)
    two = record(low, session, np.random.default_rng(5), ups=ups @ turn.T)
    np.testing.assert_allclose(one.data, two.data, rtol=1e-8, atol=1e-8)


def test_curvature_acts_along_the_input_axes() -> None:
    k2, k3 = np.array([1e-4, 0.0, -2e-4]), np.array([0.0, 3e-5, 0.0])
    f = np.array([[9.81, -9.81, 9.81]])
    given = readings(PERFECT, np.hstack([f, 0 * f]), k2, k3)[0, :3] - f[0]
    np.testing.assert_allclose(given, [1e-4 * 9.81**2, -3e-5 * 9.81**3, -2e-4 * 9.81**2])


@pytest.mark.parametrize("coloured", [False, True])
def test_means_over_a_second_spread_as_stated(coloured: bool) -> None:
    sizes = {"colour_a": 3e-3, "colour_g": 2e-4} if coloured else {}
    white = {} if coloured else {"white_a": 3e-3, "white_g": 2e-4}
    imu = replace(PERFECT, **(sizes | white), colour_seconds=0.5)
    noise = made(Session(), imu, trials=40).data - made(Session(), trials=40).data
    means = noise[:, :10_000].reshape(40, -1, 100, 6).mean(axis=2)
    tau = 0.5
    expected = (2 * tau * (1 - tau * (1 - np.exp(-1 / tau)))) ** 0.5 if coloured else 1.0
    found = np.sqrt(np.mean(means**2, axis=(0, 1)))
    np.testing.assert_allclose(found, expected * np.repeat([3e-3, 2e-4], 3), rtol=0.04)


def test_biases_drift_by_the_size_asked_for_about_a_mean_of_zero() -> None:
    plain = made(Session(), trials=50)
    drift = made(Session(drift_a=0.05, drift_g=1e-3), trials=50).data - plain.data
    np.testing.assert_allclose(drift.mean(axis=1), 0, atol=1e-6)
    reach = np.ptp(drift, axis=1) / np.repeat([0.05, 1e-3], 3)
    assert reach.min() > 0.4
    assert reach.max() < 2.0
    assert np.abs(np.diff(drift, axis=1)).max() < 0.05 * 5 / drift.shape[1]


@pytest.mark.parametrize("n", [12, 24, 60])
def test_directions_are_spread_and_follow_one_another_at_40_to_120_degrees(n: int) -> None:
    ups = directions(n, np.random.default_rng(n))
    steps = angle(ups[1:], ups[:-1]) / DEGREE
    assert steps.min() > 40
    assert steps.max() < 120.1
    np.testing.assert_allclose(ups.T @ ups / n, np.eye(3) / 3, atol=0.03)
    # n equal caps that cover the sphere have a radius of 2/√n; none is much nearer than that.
    assert angle(ups[:, None], ups)[np.triu_indices(n, 1)].min() > 2 / n**0.5


def test_bad_plans_are_as_bad_as_they_say() -> None:
    rng = np.random.default_rng(1)
    normal = np.array([1.0, 2.0, -1.0]) / 6**0.5
    off = np.arcsin(planar(2000, normal, 2.0, rng) @ normal)
    assert np.sqrt(np.mean(off**2)) == pytest.approx(2 * DEGREE, rel=0.06)
    level = record(PERFECT, Session(yaw_deg=0.0), rng, ups=about_one_axis(12, normal, rng))
    np.testing.assert_allclose(level.ups @ normal, 0, atol=1e-12)
    np.testing.assert_allclose(np.cross(level.data[0, :, 3:], normal), 0, atol=1e-10)
    for few in range(2, 6):
        assert directions(few, rng).shape == (few, 3)
