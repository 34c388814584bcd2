"""The norm on a centrifuge's arm, against the vectors it is the norm of."""

from dataclasses import replace

import numpy as np
import pytest
from tests.refusals import refused

from inercal.basics.units import Measured
from inercal.benches import Centrifuge
from inercal.benches.centrifuge.arm_motion import sensed_motion, specific_force_norm
from inercal.benches.centrifuge.bench import attitude_names
from inercal.physics.earth import EARTH_RATE
from inercal.physics.plan import Spin, arm_attitude

SPINS = [Spin("slow", 3.0), Spin("fast", 18.0), Spin("back", -18.0)]
BENCH = Centrifuge(
    Measured(9.81, 1e-4),
    Measured(1.2, 1e-5),
    stretch=Measured(1e-7, 1e-8),
    rate=1e-6,
    tilt=1e-4,
    latitude=Measured(0.75, 1e-3),
    dwell_rate=3e-6,
    dwell_tilt=4e-6,
)
AT = {"g": 9.812, "radius": 1.2003, "stretch": 2e-7, "rate": 4e-5, "tilt": 3e-4, "latitude": 0.9}


def norms(**changes: float) -> np.ndarray:
    q = {name: np.array(value) for name, value in (AT | changes).items()}
    return specific_force_norm(BENCH, SPINS, q).norm


def test_the_norm_is_that_of_centripetal_acceleration_and_gravity():
    w = np.array([spin.rate for spin in SPINS]) * (1 + AT["rate"]) + EARTH_RATE * np.sin(
        AT["latitude"]
    )
    radius = AT["radius"] * (1 + AT["stretch"] * 1.2 * np.array([9.0, 324.0, 324.0]))
    vectors = np.stack(
        [w**2 * radius + AT["g"] * np.sin(AT["tilt"]), np.full(3, AT["g"] * np.cos(AT["tilt"]))]
    )
    assert norms() == pytest.approx(np.linalg.norm(vectors, axis=0), rel=1e-10)


@pytest.mark.parametrize("name", AT)
def test_derivatives_are_those_by_differences(name: str):
    step = 1e-4 * AT[name]
    by = (norms(**{name: AT[name] + step}) - norms(**{name: AT[name] - step})) / (2 * step)
    q = {key: np.array(value) for key, value in AT.items()}
    assert specific_force_norm(BENCH, SPINS, q).derivatives[name] == pytest.approx(by, rel=1e-6)


def test_what_differs_from_dwell_to_dwell_adds_in_squares():
    q = {key: np.array(value) for key, value in AT.items()}
    made = specific_force_norm(BENCH, SPINS, q)
    expected = np.hypot(3e-6 * made.derivatives["rate"], 4e-6 * made.derivatives["tilt"])
    assert made.dwell == pytest.approx(expected)


ATTITUDES = [arm_attitude(0.3, 1.2), arm_attitude(4.0, -2.0), arm_attitude(0.3, 1.2)]
HELD = [
    replace(spin, seconds=1.0, attitude=attitude)
    for spin, attitude in zip(SPINS, ATTITUDES, strict=True)
]
TURNED = AT | {"lean1": 2e-3, "lean2": -3e-3, "dwell_rate[fast]": 1e-4, "dwell_tilt[back]": 1e-3}
TURNED |= {"mount_x": 0.02, "mount_y": -0.01, "mount_z": 0.03}
TURNED |= {"index_x[slow]": 0.01, "index_y[fast]": 0.02, "index_z[slow]": -0.01}


def vectors(**changes: float) -> np.ndarray:
    q = {name: np.array(value) for name, value in (TURNED | changes).items()}
    return sensed_motion(BENCH, HELD, q).f


def test_the_vector_has_the_norm_in_any_attitude():
    q = {name: np.array(value) for name, value in TURNED.items()}
    assert np.linalg.norm(vectors(), axis=-1) == pytest.approx(
        specific_force_norm(BENCH, HELD, q).norm, rel=1e-12
    )


@pytest.mark.parametrize("name", [n for n in TURNED if not n.startswith("dwell")])
def test_derivatives_of_the_vector_are_those_by_differences(name: str):
    step = 1e-4 * TURNED[name]
    by = (vectors(**{name: TURNED[name] + step}) - vectors(**{name: TURNED[name] - step})) / (
        2 * step
    )
    q = {key: np.array(value) for key, value in TURNED.items()}
    made = sensed_motion(BENCH, HELD, q).df[name]
    assert made == pytest.approx(by, rel=1e-6, abs=1e-7 * np.abs(by).max())


def test_derivatives_of_the_norm_by_the_lean_are_those_by_differences():
    q = {key: np.array(value) for key, value in TURNED.items()}
    for name in ("lean1", "lean2"):
        up, down = (
            specific_force_norm(BENCH, HELD, q | {name: np.array(TURNED[name] + h)}).norm
            for h in (1e-6, -1e-6)
        )
        assert specific_force_norm(BENCH, HELD, q).derivatives[name] == pytest.approx(
            (up - down) / 2e-6, rel=1e-6
        )


def test_a_lean_is_not_felt_over_whole_turns():
    whole = [replace(step, seconds=3 * 2 * np.pi / abs(step.rate)) for step in HELD]
    q = {key: np.array(value) for key, value in AT.items()}
    leaning = q | {"lean1": np.array(1e-3), "lean2": np.array(1e-3)}
    assert specific_force_norm(BENCH, whole, leaning).norm == pytest.approx(
        specific_force_norm(BENCH, whole, q).norm, rel=1e-15
    )
    assert specific_force_norm(BENCH, HELD, leaning).norm != pytest.approx(
        specific_force_norm(BENCH, HELD, q).norm, rel=1e-6
    )


def test_a_sensor_locked_to_the_arm_turns_with_it_and_another_does_not():
    q = {key: np.array(value) for key, value in AT.items()}
    turning = sensed_motion(BENCH, HELD, q).w
    rate = np.array([spin.rate for spin in SPINS]) * (1 + AT["rate"])
    rate += EARTH_RATE * np.sin(AT["latitude"])
    ups = np.array([attitude.up for attitude in ATTITUDES])
    assert turning == pytest.approx(rate[:, None] * ups)
    still = replace(BENCH, platform="counter-rotating")
    assert np.all(sensed_motion(still, HELD, q).w == 0)


def test_attitudes_are_named_by_their_first_step():
    assert list(attitude_names(HELD).values()) == ["slow", "fast"]
    with refused(key="attitude", names=("slow",)):
        sensed_motion(BENCH, SPINS, {key: np.array(value) for key, value in AT.items()})


def test_a_step_says_what_to_do():
    assert SPINS[2].describe() == "spin at −171.9 rpm"
