"""The norm on a centrifuge's arm, against the vectors it is the norm of."""

import numpy as np
import pytest

from inercal.benches import Centrifuge
from inercal.benches.centrifuge import felt_norm
from inercal.plan import Spin
from inercal.units import Measured

SPINS = [Spin("slow", 3.0), Spin("fast", 18.0), Spin("back", -18.0)]
BENCH = Centrifuge(
    Measured(9.81, 1e-4),
    Measured(1.2, 1e-5),
    Measured(1e-7, 1e-8),
    rate=1e-6,
    tilt=1e-4,
    earth_up=Measured(5e-5, 1e-7),
    dwell_rate=3e-6,
    dwell_tilt=4e-6,
)
AT = {"g": 9.812, "radius": 1.2003, "stretch": 2e-7, "rate": 4e-5, "tilt": 3e-4, "earth_up": 6e-5}


def norms(**changes: float) -> np.ndarray:
    q = {name: np.array(value) for name, value in (AT | changes).items()}
    return felt_norm(BENCH, SPINS, q).norm


def test_the_norm_is_that_of_centripetal_acceleration_and_gravity():
    w = np.array([spin.rate for spin in SPINS]) * (1 + AT["rate"]) + AT["earth_up"]
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
    assert felt_norm(BENCH, SPINS, q).by[name] == pytest.approx(by, rel=1e-6)


def test_what_differs_from_dwell_to_dwell_adds_in_squares():
    q = {key: np.array(value) for key, value in AT.items()}
    made = felt_norm(BENCH, SPINS, q)
    expected = np.hypot(3e-6 * made.by["rate"], 4e-6 * made.by["tilt"])
    assert made.dwell == pytest.approx(expected)


def test_a_step_says_what_to_do():
    assert SPINS[2].in_words() == "spin at 171.9 rpm"
