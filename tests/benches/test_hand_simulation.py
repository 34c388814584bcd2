"""A plan carried out in simulation is one motion that could be: its parts fit together."""

from math import pi

import numpy as np
import pytest
from numpy.typing import NDArray

from inercal.basics.units import Measured
from inercal.benches import Hand
from inercal.benches.contract import SimulatedMotion
from inercal.benches.hand.bench import DEGREE, sensed_motion
from inercal.benches.hand.simulation import simulate_hand_motion
from inercal.physics import frames
from inercal.physics.plan import HandStep, Hold, Turn, ferraris_plan, six_positions

Array = NDArray[np.float64]
STEPS = ferraris_plan(seconds=3.0, turn_seconds=4.0)
HAND = Hand(
    Measured(9.81, 2e-3), latitude=0.8, tilt=0.5 * DEGREE, turn_angle=2 * DEGREE, timebase=1e-3
)


def performed(
    bench: Hand = HAND,
    rate_hz: float = 50.0,
    trials: int = 4,
    seed: int = 1,
    steps: tuple[HandStep, ...] = STEPS,
) -> SimulatedMotion:
    return simulate_hand_motion(bench, steps, rate_hz, np.random.default_rng(seed), trials)


def section(done: SimulatedMotion, label: str) -> slice:
    inside = np.flatnonzero(done.labels == label)
    assert (np.diff(inside) == 1).all()
    return slice(int(inside[0]), int(inside[-1]) + 1)


def test_every_step_leaves_one_section_of_its_length_in_the_order_of_the_plan():
    done = performed()
    labels = [step.label for step in STEPS]
    assert list(dict.fromkeys(done.labels[done.labels != ""].tolist())) == labels
    for step in STEPS:
        part = section(done, step.label)
        assert (part.stop - part.start) / 50.0 == pytest.approx(step.seconds)
    assert np.diff(done.time) == pytest.approx(1 / 50.0)


@pytest.mark.parametrize("step", STEPS, ids=lambda step: step.label)
def test_means_over_a_section_are_what_the_estimator_expects_to_be_felt(step: HandStep):
    done = performed()
    part = section(done, step.label)
    f, w = done.motion.f[:, part].mean(axis=1), done.motion.w[:, part].mean(axis=1)
    # Whatever the accelerometers say is the mean force during a turn: f̄ is an input there.
    force = {f"force_{a}[{step.label}]": f[:, k] for k, a in enumerate("xyz")}
    q = done.bench_errors | (force if isinstance(step, Turn) else {})
    expected = sensed_motion(step, step.seconds, q)
    assert f == pytest.approx(expected.f, rel=1e-12, abs=1e-12)
    assert w * step.seconds == pytest.approx(expected.w * step.seconds, abs=1e-9)


@pytest.mark.parametrize("label", ["x_rot", "y_rot", "z_rot"])
def test_a_turn_ends_at_rest_after_its_angle_and_error(label: str):
    done = performed()
    step = next(step for step in STEPS if step.label == label)
    assert isinstance(step, Turn)
    part = section(done, label)
    up = done.motion.f[:, part.start] / done.bench_errors["g"][:, None]
    own = done.motion.w[:, part] - done.bench_errors["earth_up"][:, None, None] * up[:, None]
    # The recording's clock runs slow by the factor 1 + τ.
    angle = (own @ up[..., None])[..., 0].sum(axis=1) / 50.0 * (1 + done.bench_errors["timebase"])
    assert angle == pytest.approx(step.angle + done.bench_errors[f"angle[{label}]"], abs=1e-9)
    assert np.abs(own[:, [0, -1]]).max() < 1e-15


@pytest.mark.parametrize("tilt", [0.0, 1e-4, 0.5 * DEGREE])
def test_specific_force_is_gravity_from_beginning_to_end(tilt: float):
    done = performed(Hand(Measured(9.81, 2e-3), latitude=0.8, tilt=tilt, turn_tilt=tilt))
    norm = np.linalg.norm(done.motion.f, axis=-1)
    assert norm == pytest.approx(
        np.broadcast_to(done.bench_errors["g"][:, None], norm.shape), rel=1e-12
    )


def drift(bench: Hand, rate_hz: float, steps: tuple[HandStep, ...] = STEPS) -> float:
    """Return how far up, carried along by the rates alone, strays from the specific force."""
    done = performed(bench, rate_hz, trials=3, steps=steps)
    # Samples are the middles of intervals of constant rate: du/dt = −ω × u.
    half = frames.exp_so3(-0.5 * done.motion.w / rate_hz)
    true = done.motion.f / done.bench_errors["g"][:, None, None]
    u = true[:, 0]
    worst = 0.0
    for k in range(true.shape[1]):
        middle = (half[:, k] @ u[..., None])[..., 0]
        worst = max(worst, float(np.abs(middle - true[:, k]).max()))
        u = (half[:, k] @ middle[..., None])[..., 0]
    return worst


@pytest.mark.parametrize("tilt", [0.0, 1e-4, 0.5 * DEGREE])
def test_the_rates_integrate_to_the_changes_of_attitude_moves_included(tilt: float):
    # At the pole the earth turns about the vertical and leaves up alone.
    bench = Hand(Measured(9.81, 0.0), latitude=pi / 2, tilt=tilt, turn_tilt=tilt)
    coarse, fine = drift(bench, 50.0), drift(bench, 100.0)
    # Half a step from the middle of a sample errs by dω/dt · dt²/8, and a half turn within 2 s
    # accelerates by 4.5 rad/s² at most: 6e-5 at 100 Hz, four times as much at 50 Hz.
    assert fine < 6e-5
    assert fine < 0.3 * coarse


def test_a_move_between_neighbouring_attitudes_follows_its_rates():
    bench = Hand(Measured(9.81, 0.0), latitude=pi / 2, tilt=2e-4, turn_tilt=2e-4)
    twice = (Hold("a", (0.0, 0.0, 1.0), 2.0), Hold("b", (0.0, 0.0, 1.0), 2.0))
    assert drift(bench, 50.0, twice) < 1e-8


def test_drawn_errors_have_the_declared_means_and_deviations():
    trials = 4000
    done = performed(
        rate_hz=10.0, trials=trials, steps=ferraris_plan(seconds=0.5, turn_seconds=1.0)
    )
    declared = HAND.acting_parameters(ferraris_plan(), rates=True)
    assert set(done.bench_errors) == set(declared)
    for name, parameter in declared.items():
        drawn = done.bench_errors[name]
        assert drawn.mean() == pytest.approx(
            parameter.value, abs=5 * parameter.sd / trials**0.5 + 1e-18
        )
        assert drawn.std() == pytest.approx(parameter.sd, rel=5 / (2 * trials) ** 0.5), name


def test_errors_of_different_positions_and_turns_are_independent():
    trials = 4000
    done = performed(
        rate_hz=10.0, trials=trials, steps=ferraris_plan(seconds=0.5, turn_seconds=1.0)
    )
    loose = [values for values in done.bench_errors.values() if values.std() > 0]
    correlation = np.corrcoef(np.stack(loose)) - np.eye(len(loose))
    assert np.abs(correlation).max() < 5 / trials**0.5


def test_a_run_feels_one_gravity_and_one_clock_in_all_its_steps():
    done = performed()
    norms = [np.linalg.norm(done.motion.f[:, section(done, step.label)], axis=-1) for step in STEPS]
    assert np.ptp(np.concatenate(norms, axis=1), axis=1) == pytest.approx(0, abs=1e-12)
    assert "timebase" in done.bench_errors
    assert not [name for name in done.bench_errors if name.startswith(("g[", "timebase["))]


def test_without_turns_the_samples_between_the_positions_carry_no_label():
    done = performed(steps=six_positions(2.0))
    assert (done.labels == "").sum() == 5 * 2.0 * 50.0
    assert np.abs(done.motion.w[:, done.labels == ""]).max() > 1  # rad/s: they are moves


def test_one_seed_gives_one_performance():
    first, again, other = performed(seed=5), performed(seed=5), performed(seed=6)
    assert np.array_equal(first.motion.w, again.motion.w)
    assert not np.array_equal(first.motion.w, other.motion.w)
