"""Arm runs in simulation, against the norm and the attitudes that the plan says."""

from dataclasses import replace
from math import pi

import numpy as np
import pytest

from inercal.basics.units import Measured
from inercal.benches import Centrifuge
from inercal.benches.centrifuge.simulation import simulate_arm_motion
from inercal.methods.centrifuge_norm import plan

EXACT = Centrifuge(Measured(9.81, 0.0), Measured(1.2, 0.0), Measured(0.7, 0.0))
STEPS = plan(turns=3)[::7]  # some attitudes, some rates
FS = 100.0


def test_each_dwell_has_its_rate_its_norm_and_its_angles():
    done = simulate_arm_motion(EXACT, STEPS, FS, np.random.default_rng(1))
    said = done.readback
    earth = 7.292115e-5 * np.sin(0.7)
    for step in STEPS:
        at = np.flatnonzero(
            (done.labels == step.label.partition("_")[0]) & (said["arm_rate"] == step.rate)
        )
        assert at.size / FS >= step.seconds
        a = (step.rate + earth) ** 2 * 1.2
        norm = np.linalg.norm(done.motion.f[0, at[5:-5]], axis=-1)
        assert norm == pytest.approx(np.full(norm.size, np.hypot(a, 9.81)), rel=1e-12)
        assert step.attitude is not None
        psi, theta = said["psi"][at[0]], said["theta"][at[0]]
        out = (np.cos(psi) * np.cos(theta), np.sin(psi), np.cos(psi) * np.sin(theta))
        assert out == pytest.approx(step.attitude.out)
        along = done.motion.w[0, at[5]] @ np.array(step.attitude.up)
        assert along == pytest.approx(step.rate + earth)


def test_a_clockwise_arm_turns_the_sensor_the_other_way():
    clockwise = replace(EXACT, sense=-1)
    done = simulate_arm_motion(clockwise, STEPS[:1], FS, np.random.default_rng(1))
    said = done.readback
    at = np.argmax(said["arm_rate"] == STEPS[0].rate) + 5
    assert STEPS[0].attitude is not None
    assert done.motion.w[0, at] @ np.array(STEPS[0].attitude.up) < 0


def test_a_platform_that_turns_back_sees_the_arm_go_round():
    still = replace(EXACT, platform="counter-rotating", latitude=Measured(pi / 2, 0.0))
    step = replace(STEPS[0], rate=2 * pi, seconds=4.0)
    done = simulate_arm_motion(still, [step], FS, np.random.default_rng(1))
    said = done.readback
    assert np.all(done.motion.w == 0)
    at = np.flatnonzero(said["arm_rate"] == step.rate)[10:]
    f = done.motion.f[0, at[:100]]
    assert step.attitude is not None
    up = np.array(step.attitude.up)
    assert f.mean(axis=0) == pytest.approx(9.81 * up, abs=1e-3)
    assert np.linalg.norm(f, axis=-1) == pytest.approx(np.full(100, np.linalg.norm(f[0])))


def test_a_lean_swings_once_a_turn():
    leaning = replace(EXACT, lean=1e-3)
    step = replace(STEPS[0], rate=2 * pi, seconds=4.0)
    done = simulate_arm_motion(leaning, [step], FS, np.random.default_rng(3))
    said = done.readback
    at = np.flatnonzero(said["arm_rate"] == step.rate)[10:110]
    f = done.motion.f[0, at]
    lean = np.hypot(done.bench_errors["lean1"][0], done.bench_errors["lean2"][0])
    swing = np.linalg.norm(f - f.mean(axis=0), axis=-1)
    assert swing == pytest.approx(np.full(100, 9.81 * lean), rel=1e-3)
