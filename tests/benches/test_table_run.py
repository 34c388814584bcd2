"""Runs on a rate table in simulation, against what its states are said to feel."""

from dataclasses import replace
from math import pi

import numpy as np
import pytest

from inercal.basics.units import Measured
from inercal.benches.rate_table.bench import RateTable, sensed_motion
from inercal.benches.rate_table.fixture import RPM, group_by_mounting, multi_angle_plan, planar_plan
from inercal.benches.rate_table.simulation import (
    SPIN_UP,
    simulate_table_motion,
    table_plan_duration,
)
from inercal.methods.ship_multi_angle import plan

LEVEL = RateTable(Measured(9.8, 1e-3), Measured(0.25, 3e-4), 5e-4, 3e-3, 1e-4, 5e-4)
EXACT = RateTable(Measured(9.8, 0.0), Measured(0.25, 0.0))
LEANING = replace(EXACT, lean=2e-3)
FS = 50.0
STEPS = plan(seconds=4.0)


def test_steps_are_done_mounting_by_mounting_and_in_each_by_speed():
    done = group_by_mounting(STEPS)
    assert len(done) == 13
    assert [step.label for step in done[3]] == ["XY30_46", "XY30_86"]
    assert sorted(step.label for own in done for step in own) == sorted(s.label for s in STEPS)


def test_each_state_feels_what_the_bench_says_whatever_it_errs_by():
    done = simulate_table_motion(LEVEL, STEPS, FS, np.random.default_rng(1), 3)
    said = done.readback
    expected = sensed_motion(LEVEL, STEPS, done.bench_errors).f
    for k, step in enumerate(STEPS):
        assert step.attitude is not None
        at = (done.labels == step.attitude.name) & (said["arm_rate"] == step.rate)
        # At rest the time before spinning up and after spinning down belongs to it too.
        assert at.sum() / FS >= step.seconds
        f = done.motion.f[:, at]
        assert f == pytest.approx(np.broadcast_to(expected[:, k, None], f.shape), abs=1e-12)


def test_the_body_turns_about_what_is_up_at_the_rate_that_is_told():
    done = simulate_table_motion(EXACT, planar_plan(seconds=2.0), FS, np.random.default_rng(1))
    said = done.readback
    expected = np.zeros((done.time.size, 3))
    expected[:, 2] = said["arm_rate"]
    assert done.motion.w[0][done.labels != "ZY"] == pytest.approx(expected[done.labels != "ZY"])


def test_the_acceleration_of_the_table_is_felt_and_limited():
    done = simulate_table_motion(EXACT, planar_plan(seconds=2.0)[:3], FS, np.random.default_rng(1))
    said = done.readback
    slope = np.gradient(said["arm_rate"], 1 / FS)
    assert SPIN_UP * 0.95 < np.abs(slope).max() <= SPIN_UP * 1.001
    # x to the centre, z up: y = z × x is ahead where the table turns backwards.
    smooth = np.abs(np.gradient(slope, 1 / FS)) < SPIN_UP
    along = done.motion.f[0, :, 1]
    assert along[smooth] == pytest.approx(-0.25 * slope[smooth], abs=2e-2)
    assert np.ptp(along) > 0.25 * SPIN_UP


def test_a_lean_is_one_in_the_room_and_swings_once_a_turn():
    done = simulate_table_motion(LEANING, STEPS, FS, np.random.default_rng(3), 2)
    said = done.readback
    expected = sensed_motion(LEANING, STEPS, done.bench_errors).f
    sizes: list[np.ndarray] = []
    for k, step in enumerate(STEPS):
        assert step.attitude is not None
        at = np.flatnonzero((done.labels == step.attitude.name) & (said["arm_rate"] == step.rate))
        if step.rate == 0:
            first = done.motion.f[:, at[0]]  # afterwards the table stands elsewhere
            assert first == pytest.approx(expected[:, k], abs=1e-12)
            lean = [done.bench_errors[f"lean_{j}[{step.label}]"] for j in (1, 2)]
            sizes.append(np.hypot(*lean))
            continue
        swing = np.linalg.norm(done.motion.f[:, at] - expected[:, k, None], axis=-1)
        assert swing == pytest.approx(
            9.8 * np.broadcast_to(sizes[0][:, None], swing.shape), rel=0.01
        )
        turn = 2 * pi / step.rate * FS
        whole = at[: round(int(at.size / turn) * turn)]
        left = done.motion.f[:, whole].mean(axis=1) - expected[:, k]
        assert np.abs(left).max() < 9.8 * 0.02 * sizes[0].max()
    assert np.ptp(sizes, axis=0) == pytest.approx(0, abs=1e-15)


def test_leans_of_rests_are_as_the_bench_declares_them():
    steps = planar_plan(speeds=(0.0,), seconds=1.0)
    n = 20_000
    done = simulate_table_motion(LEANING, steps, 1.0, np.random.default_rng(5), n)
    names = [name for name in done.bench_errors if name.startswith("lean")]
    assert set(names) == {f"lean_{k}[{step.label}]" for k in (1, 2) for step in steps}
    found = np.cov([done.bench_errors[name] / 2e-3 for name in names])
    assert found == pytest.approx(np.eye(6), abs=5 * np.sqrt(2 / n))


def test_it_lasts_as_long_as_is_said():
    for steps in (STEPS, multi_angle_plan(seconds=1.0), planar_plan((0.0, 20 * RPM), 3.0)):
        done = simulate_table_motion(EXACT, steps, FS, np.random.default_rng(1))
        said = done.readback
        assert done.time.size == said["arm_rate"].size == done.labels.size
        assert done.time[-1] == pytest.approx(table_plan_duration(EXACT, steps), abs=0.5)
