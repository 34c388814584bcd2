"""The bench of bare hands: what its steps feel like, and the exact derivatives."""

from math import asin, atan, pi

import numpy as np
import pytest
from numpy.typing import NDArray

from inercal.basics.units import Measured
from inercal.benches import Hand, MeanMotion
from inercal.benches.hand.bench import DEGREE, sensed_motion, tangent_vectors, tilted_direction
from inercal.physics.earth import EARTH_RATE
from inercal.physics.plan import AXES, HandStep, Hold, Turn, Vector, ferraris_plan

Array = NDArray[np.float64]
SKEW_UP: Vector = (2 / 3, -1 / 3, 2 / 3)
UPS: list[Vector] = [*AXES.values(), (0.0, 0.0, -1.0), (0.0, -1.0, 0.0), SKEW_UP]
BENCH = Hand(Measured(9.81, 1e-3), latitude=None)
SECONDS = 8.0
STEPS: list[HandStep] = [
    Hold("face", (0.0, 0.0, -1.0), 10.0),
    Hold("face", SKEW_UP, 10.0),
    Turn("face", (0.0, 1.0, 0.0), -2 * pi, SECONDS),
    Turn("face", SKEW_UP, pi / 2, SECONDS),
]


def nuisances(step: HandStep) -> dict[str, float]:
    """Return values far from zero, so that a term that is missing shows."""
    rng = np.random.default_rng(8)
    q = {
        name: p.value + (0.2 if p.unit == "rad" else 3.0 * p.sd) * rng.uniform(0.5, 1)
        for name, p in BENCH.acting_parameters([step], rates=True).items()
    }
    q["earth_up"] = 0.3  # as large as the turn, in place of its true 7e-5 rad/s
    if isinstance(step, Turn):
        q |= {f"force_{a}[{step.label}]": 9.0 * rng.uniform(-1, 1) for a in "xyz"}
    return q


def at(step: HandStep, q: dict[str, float]) -> MeanMotion:
    return sensed_motion(step, SECONDS, {name: np.array(value) for name, value in q.items()})


@pytest.mark.parametrize("step", STEPS, ids=lambda step: step.describe())
def test_every_derivative_of_what_is_felt_is_that_of_central_differences(step: HandStep):
    q = nuisances(step)
    here = at(step, q)
    assert set(here.df) | set(here.dw) <= set(q)
    for name, value in q.items():
        h = 1e-4 * max(abs(value), 1e-2)
        near = [at(step, q | {name: value + s * h}) for s in (1, -1)]
        far = [at(step, q | {name: value + s * 2 * h}) for s in (1, -1)]
        for vector, derivatives in (("f", here.df), ("w", here.dw)):
            one, two = (getattr(a, vector) - getattr(b, vector) for a, b in (near, far))
            expected = (8 * one - two) / (12 * h)
            found = derivatives.get(name, np.zeros(3))
            assert found == pytest.approx(expected, abs=1e-8), (name, vector)


@pytest.mark.parametrize("step", STEPS, ids=lambda step: step.describe())
def test_trials_are_worked_out_as_if_each_were_alone(step: HandStep):
    first, second = nuisances(step), {name: -v for name, v in nuisances(step).items()}
    both = sensed_motion(step, SECONDS, {n: np.array([v, second[n]]) for n, v in first.items()})
    for k, q in enumerate((first, second)):
        alone = at(step, q)
        assert both.f[k] == pytest.approx(alone.f, rel=1e-14, abs=1e-15)
        assert both.w[k] == pytest.approx(alone.w, rel=1e-14, abs=1e-15)


@pytest.mark.parametrize("up", UPS)
def test_the_two_directions_and_up_are_a_right_handed_orthonormal_frame(up: Vector):
    frame = np.vstack([tangent_vectors(up), up])
    assert frame @ frame.T == pytest.approx(np.eye(3), abs=1e-15)
    assert np.linalg.det(frame) == pytest.approx(1)


@pytest.mark.parametrize("up", UPS)
def test_a_tilted_up_is_a_unit_vector_leaning_by_the_tangents(up: Vector):
    t = np.array([[0.0, 0.0], [0.3, 0.0], [0.0, -0.4], [0.3, -0.4]])
    u, du = tilted_direction(up, t)
    assert np.linalg.norm(u, axis=-1) == pytest.approx(1, abs=1e-15)
    assert u[0] == pytest.approx(np.array(up), abs=1e-15)
    lean = np.arccos(np.clip(u[1:] @ np.array(up), -1, 1))
    assert lean == pytest.approx([atan(0.3), atan(0.4), atan(0.5)])
    # Towards d₁ by t₁ and towards d₂ by t₂; a unit vector changes at right angles to itself.
    along = np.array(up)
    assert (u / (u @ along)[:, None]) @ tangent_vectors(up).T == pytest.approx(t, abs=1e-15)
    assert np.einsum("kij,ki->kj", du, u) == pytest.approx(0, abs=1e-15)


def test_a_level_face_at_rest_feels_gravity_and_the_earth_turning():
    q = {"g": np.array(9.81), "earth_up": np.array(5e-5), "earth1[z_p]": np.array(4e-5)}
    at_rest = sensed_motion(Hold("z_p", (0.0, 0.0, 1.0), 10.0), 10.0, q)
    assert at_rest.f.tolist() == [0, 0, 9.81]
    assert at_rest.w[2] == 5e-5
    assert np.linalg.norm(at_rest.w[:2]) == pytest.approx(4e-5)


def test_a_slow_clock_makes_a_turn_look_quick():
    step = Turn("z_rot", (0.0, 0.0, 1.0), 2 * pi, 8.0)
    force = {f"force_{a}[z_rot]": np.zeros(()) for a in "xyz"}
    q = {"g": np.array(9.81), "timebase": np.array(0.01), "angle[z_rot]": np.array(0.1)} | force
    assert sensed_motion(step, 8.0, q).w == pytest.approx([0, 0, (2 * pi + 0.1) / (8.0 * 1.01)])


def test_latitude_decides_what_of_the_earths_rate_is_known():
    def of(bench: Hand, name: str) -> tuple[float, float]:
        parameter = next(p for p in bench.parameters if p.name == name)
        return parameter.value, parameter.sd

    latitude = asin(0.6)
    known = Hand(Measured(9.81, 0.0), latitude=latitude)
    assert of(known, "earth_up") == pytest.approx((0.6 * EARTH_RATE, 0.0))
    # A level vector of known length and unknown azimuth has this rms in each component.
    assert of(known, "earth1") == pytest.approx((0.0, 0.8 * EARTH_RATE / np.sqrt(2)))
    unknown = [of(Hand(Measured(9.81, 0.0)), name) for name in ("earth_up", "earth1", "earth2")]
    assert [value for value, _ in unknown] == [0, 0, 0]
    assert np.linalg.norm([sd for _, sd in unknown]) == pytest.approx(EARTH_RATE)


def test_nuisances_are_one_a_run_one_a_position_and_one_a_turn():
    bench = Hand(Measured(9.81, 1e-3), latitude=0.8, tilt=0.1 * DEGREE, turn_angle=2 * DEGREE)
    found = bench.acting_parameters(ferraris_plan(), rates=True)
    assert len(found) == 3 + 6 * 4 + 3 * 3
    assert "tilt1[x_p]" in found
    assert "tilt1[x_rot]" not in found
    assert "angle[x_p]" not in found
    assert found["tilt2[z_a]"].sd == 0.1 * DEGREE
    assert found["angle[y_rot]"].sd == 2 * DEGREE


def test_without_gyros_neither_the_earth_nor_the_clock_plays_a_part():
    bench = Hand(Measured(9.81, 1e-3), latitude=0.8)
    names = set(bench.acting_parameters(ferraris_plan()[:6], rates=False))
    assert names == {"g"} | {f"tilt{k}[{a}_{s}]" for k in (1, 2) for a in "xyz" for s in "pa"}
