"""Plans that leave coefficients open are refused by name; plans that do not are accepted.

What a plan leaves open is found here from the physics: an accelerometer's reading at rest is its
row of M times g·up plus its bias, so that a change (δrow, δbias) is seen by no position when
δrow · g·up + δbias = 0 for every up.
"""

import re

import numpy as np
import pytest
from numpy.typing import NDArray
from tests.accuracy.ferraris import DEGREE, POSITIONS, TURNS, Handling, Imu, mems, record
from tests.accuracy.inercal_inputs import (
    make_bench,
    make_hold,
    make_observations,
    make_turn,
    true_coefficients,
)

from inercal.basics.errors import NotObserved
from inercal.estimation import Estimate, Gaussian
from inercal.methods import METHODS
from inercal.physics.plan import HandStep
from inercal.physics.sensors import Sensor, imu

Array = NDArray[np.float64]
HANDS = Handling(
    gravity_sd=2e-4,
    latitude=47 * DEGREE,
    tilt=0.1 * DEGREE,
    turn_tilt=0.3 * DEGREE,
    turn_angle=0.5 * DEGREE,
    timebase=1e-4,
)
DEVICE = mems(np.random.default_rng(70))


def prepared(method: str) -> Sensor:
    """Return the IMU, of six positions the accelerometers, with the method's coefficients."""
    whole = imu().select_axes("f") if method == "six_position" else imu()
    return METHODS[method].prepare(whole)


def calibrated(
    method: str,
    faces: dict[str, Array],
    turns: dict[str, Array] | None = None,
    *,
    steps: tuple[HandStep, ...] = (),
    priors: tuple[Gaussian, ...] = (),
) -> Estimate:
    """Return ml's estimate of a session of these faces and turns; its plan may have more steps."""
    turns = turns or {}
    made = record(DEVICE, HANDS, np.random.default_rng(71), faces=faces, turns=turns)
    chosen = METHODS[method]
    sensor = prepared(method)
    own = [make_hold(label, up) for label, up in faces.items()]
    own += [make_turn(label, axis, 2 * np.pi) for label, axis in turns.items()]
    plan = steps or tuple(own)
    seen = make_observations(made, sensor, plan, 0)
    return chosen.estimator("ml")(seen, sensor, make_bench(HANDS), plan, priors)


def deviations(estimate: Estimate, device: Imu, method: str) -> Array:
    sensor = prepared(method)
    p = len(sensor.coefficients)
    return (estimate.value[:p] - true_coefficients(device, sensor)) / estimate.std[:p]


def without(*labels: str) -> dict[str, Array]:
    return {label: up for label, up in POSITIONS.items() if label not in labels}


@pytest.mark.parametrize("method", ["six_position", "ferraris"])
def test_without_the_face_down_bias_and_scale_of_z_are_refused(method: str):
    turns = dict(TURNS) if method == "ferraris" else None
    with pytest.raises(NotObserved) as refused:
        calibrated(method, without("z_a"), turns, steps=METHODS[method].plan())
    message = str(refused.value)
    assert "az.k0" in message
    assert "az.k1" in message
    assert "z_a" in message
    assert "ax." not in message
    assert "ay." not in message
    assert len(refused.value.directions) == 1


def test_a_prior_on_its_bias_makes_up_for_the_face_down():
    named = DEVICE.coefficients()
    prior = Gaussian.independent(("az.k0",), [named["az.k0"] + 1e-3], [1e-3])
    plan = METHODS["six_position"].plan()
    estimate = calibrated("six_position", without("z_a"), steps=plan, priors=(prior,))
    assert np.abs(deviations(estimate, DEVICE, "six_position")).max() < 4
    # Read once with z up, the scale is now known as well as the bias was: u(K₁) = u(K₀)/g.
    k1 = estimate.select(["az.k1"]).std[0]
    assert k1 == pytest.approx(1e-3 / HANDS.gravity, rel=0.1)


def test_two_turns_leave_the_third_columns_of_the_gyros_open():
    turns = {label: TURNS[label] for label in ("x_rot", "y_rot")}
    with pytest.raises(NotObserved) as refused:
        calibrated("ferraris", dict(POSITIONS), turns, steps=METHODS["ferraris"].plan())
    assert "z_rot" in str(refused.value)
    main = [leading(words) for words in refused.value.directions]
    assert sorted(main) == ["gx.delta_p", "gy.delta_o", "gz.scale"]


def test_no_turn_leaves_the_gyros_matrix_open_and_nothing_of_the_accelerometers():
    with pytest.raises(NotObserved) as refused:
        calibrated("ferraris", dict(POSITIONS), steps=METHODS["ferraris"].plan())
    main = {leading(words) for words in refused.value.directions}
    assert main == {f"g{a}.{c}" for a in "xyz" for c in ("scale", "delta_o", "delta_p")}


def on_a_cone(opening: float, count: int) -> Array:
    turns = 2 * np.pi * np.arange(count) / count
    level = np.sin(opening) * np.stack([np.cos(turns), np.sin(turns)], axis=1)
    return np.column_stack([level, np.full(count, np.cos(opening))])


def tipped(seed: int) -> Array:
    """Return a rotation that is not a plan's usual one."""
    return np.linalg.qr(np.random.default_rng(seed).standard_normal((3, 3)))[0]


PLANS = {
    "one position": np.eye(3)[:1],
    "one axis up and down": np.array([[1.0, 0, 0], [-1, 0, 0]]),
    "one axis askew, up and down": np.array([[1.0, 0, 0], [-1, 0, 0]]) @ tipped(1).T,
    "three faces askew": np.eye(3) @ tipped(2).T,
    "all in one plane": np.array([[1.0, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0]]),
    "all in one askew plane": on_a_cone(np.pi / 2, 8) @ tipped(3).T,
    "a wedge of 30° turned about the vertical": on_a_cone(np.pi / 6, 8),
    "the same, askew": on_a_cone(np.pi / 6, 8) @ tipped(4).T,
}


@pytest.mark.parametrize("plan", list(PLANS))
def test_the_directions_named_are_those_no_position_sees(plan: str):
    ups = PLANS[plan]
    with pytest.raises(NotObserved) as refused:
        calibrated("six_position", {f"p{k}": up for k, up in enumerate(ups)})
    names = prepared("six_position").coefficients
    named = np.array([in_numbers(words, names) for words in refused.value.directions])
    # In units of g, (δrow · up + δbias) of each accelerometer: all coefficients are one-to-one.
    sees = np.zeros((3, len(ups), len(names)))
    for i, axis in enumerate("xyz"):
        p, o = (i + 1) % 3, (i + 2) % 3
        for short, column in {
            "k0": np.ones(len(ups)),
            "k1": ups[:, i],
            "delta_o": ups[:, p],
            "delta_p": -ups[:, o],
        }.items():
            sees[i, :, names.index(f"a{axis}.{short}")] = column
    sees = sees.reshape(-1, len(names))
    open_directions = len(names) - np.linalg.matrix_rank(sees)
    assert np.linalg.matrix_rank(named, tol=0.02) == len(named) == open_directions
    # Three digits are printed.
    seen = np.abs(named @ sees.T).max(axis=1) / np.abs(named).max(axis=1)
    assert seen.max() < 0.01


def in_numbers(words: str, names: tuple[str, ...]) -> Array:
    """Return the direction that is written as '0.878 ax.k0 − ax.delta_p', in the order of names."""
    direction = np.zeros(len(names))
    terms = re.findall(r"([−+-]?)\s*(?:([\d.e−+-]*\d)\s+)?(\w+\.\w+)", words)
    assert terms, words
    for sign, size, name in terms:
        number = float(size.replace("−", "-")) if size else 1.0
        direction[names.index(name)] = -number if sign in ("−", "-") else number
    return direction


def leading(words: str) -> str:
    names = METHODS["ferraris"].prepare(imu()).coefficients
    return names[int(np.abs(in_numbers(words, names)).argmax())]


@pytest.mark.parametrize("method", ["six_position", "ferraris"])
@pytest.mark.parametrize("lean", [30, 54.7])
def test_six_positions_along_tilted_axes_are_as_good_as_along_the_sensors_own(
    method: str, lean: float
):
    """On a wedge every position excites two or three axes at once; nothing is left open."""
    about = np.array([1.0, -1.0, 0.0]) / 2**0.5
    c, s = np.cos(lean * DEGREE), np.sin(lean * DEGREE)
    cross = np.cross(np.eye(3), about)
    wedge = np.eye(3) + s * cross.T + (1 - c) * cross.T @ cross.T
    faces = {label: wedge @ up for label, up in POSITIONS.items()}
    turns = {label: wedge @ axis for label, axis in TURNS.items()}
    estimate = calibrated(method, faces, turns if method == "ferraris" else None)
    assert np.abs(deviations(estimate, DEVICE, method)).max() < 4
