"""Turntable runs in simulation: the way, the labels, and what the table reads back."""

from dataclasses import replace
from itertools import groupby
from math import degrees, pi, radians

import numpy as np
import pytest
from tests.accuracy import turntable as made
from tests.refusals import refused

from inercal.basics.units import Measured
from inercal.benches import Turntable
from inercal.benches.motion_control import AxisMotionLimits
from inercal.benches.turntable.attitude import true_attitude
from inercal.benches.turntable.simulation import (
    path_profile,
    simulate_turntable_motion,
    turntable_path_duration,
)
from inercal.physics.plan import Position, Rotation, TableStep

ARCSEC = radians(1 / 3600)
HOME = (0.0, 0.0, 0.0)
FS = 100.0
EXACT = Turntable(Measured(9.81, 0.0), radians(38), latency=Measured(2e-3, 0.0))
STEPS: tuple[TableStep, ...] = (
    Position("home", HOME, 5.0),
    Position("up", (0.0, pi / 2, 0.0), 10.0),
    Rotation("twice", 0, 4 * pi, 0.5),
    Rotation("inner", 2, -pi, 0.2, HOME),
)


def as_steps(path: list[made.Stand | made.Turn]) -> list[TableStep]:
    steps: list[TableStep] = []
    for step in path:
        if len(step) == 3:
            x, y, z = map(radians, step[1])
            steps.append(Position(step[0], (x, y, z), step[2]))
        else:
            steps.append(Rotation(step[0], step[1], radians(step[2]), radians(step[3])))
    return steps


def test_the_way_is_that_of_the_generator():
    table = made.Table(fastest=radians(30), acceleration=radians(40))
    bench = replace(EXACT, limits=(AxisMotionLimits(table.fastest, table.acceleration),))
    path = [*made.positions(7.0), *made.turns(back=True)]
    angles, rates, late, labels = made.simulate_travel(path, table, FS)
    way = path_profile(bench, as_steps(path))
    starts = np.concatenate([[0.0], way.ends[:-1]])
    own = [s for s in zip(way.labels, starts, way.ends, strict=True) if s[2] > s[1]]
    before = 1
    # The generator fills each section up to whole samples: each is compared from its own start.
    for (label, start, end), (name, run) in zip(own, groupby(labels[1:]), strict=True):
        assert label == name
        n = len(list(run))
        assert n == pytest.approx((end - start) * FS, abs=1)
        at = slice(before, before + n)
        time = np.minimum(start + np.arange(1, n + 1) / FS, end)
        there, speed, _ = way.evaluate(time)
        assert there == pytest.approx(angles[at], abs=1e-9)
        assert speed == pytest.approx(rates[at], abs=1e-9)
        inside = time[:-1] - table.latency
        assert way.evaluate(inside)[0] == pytest.approx(late[at][:-1], abs=1e-9)
        before += n


def test_labels_are_of_steps_and_moves_have_none():
    done = simulate_turntable_motion(EXACT, STEPS, FS, np.random.default_rng(1))
    assert set(done.labels) == {"", "home", "up", "twice", "inner"}
    count = {label: np.sum(done.labels == label) / FS for label in set(done.labels)}
    assert count["home"] == 5
    assert count["up"] == 10
    assert count["twice"] == pytest.approx(4 * pi / 0.5 + 0.5 / radians(30), abs=0.01)
    assert done.time[-1] == pytest.approx(turntable_path_duration(EXACT, STEPS), abs=0.01)
    still = done.labels == "up"
    assert done.motion.f[0, still] == pytest.approx(np.tile([0, 9.81, 0], (1000, 1)), abs=1e-12)
    turning = np.flatnonzero(done.labels == "twice")[200:-200]
    assert done.motion.w[0, turning, 1] == pytest.approx(
        np.full(turning.size, 0.5 + 7.292115e-5 * np.sin(radians(38)))
    )


def test_readback_counts_on_and_is_late():
    done = simulate_turntable_motion(EXACT, STEPS, FS, np.random.default_rng(1))
    said = done.readback
    assert list(said) == ["outer", "middle", "inner"]
    assert said["outer"][0, -1] == pytest.approx(4 * pi)
    turning = np.flatnonzero(done.labels == "twice")[200:-200]
    true = path_profile(EXACT, STEPS).evaluate(done.time)[0]
    late = (true[:, 0] - said["outer"][0])[turning]
    assert late == pytest.approx(np.full(turning.size, 2e-3 * 0.5), rel=1e-9)


def test_a_clock_that_runs_fast_reads_ever_earlier():
    bench = replace(EXACT, latency=Measured(0.0, 0.0), clock=1e-3)
    done = simulate_turntable_motion(bench, STEPS, FS, np.random.default_rng(4), trials=2)
    said = done.readback
    turning = np.flatnonzero(done.labels == "twice")[200:-200]
    true = path_profile(bench, STEPS).evaluate(done.time)[0][turning, 0]
    for k in range(2):
        late = 0.5 * done.bench_errors["clock"][k] * done.time[turning]
        assert true - said["outer"][k, turning] == pytest.approx(late, abs=1e-12)


def test_readback_at_its_own_rate_is_brought_to_the_samples():
    bench = replace(EXACT, latency=Measured(0.0, 0.0))
    done = simulate_turntable_motion(bench, STEPS, FS, np.random.default_rng(1), 1, 25.0)
    said = done.readback
    true = path_profile(bench, STEPS).evaluate(done.time)[0]
    assert said["outer"][0, ::4] == pytest.approx(true[::4, 0], abs=1e-12)
    # Between readings the way is bent by acceleration alone: a dt²/8.
    off = np.abs(said["outer"][0] - true[:, 0])
    assert 0 < off.max() <= radians(30) / 25**2 / 8 * (1 + 1e-6)


def test_readback_has_harmonics_and_noise():
    bench = replace(EXACT, harmonics=(0.0, 2 * ARCSEC), white=0.5 * ARCSEC)
    done = simulate_turntable_motion(bench, STEPS, FS, np.random.default_rng(2), trials=2)
    said = done.readback
    late = path_profile(bench, STEPS).evaluate(done.time - 2e-3)[0][:, 0]
    for k in range(2):
        sine, cosine = (done.bench_errors[f"{wave}2[outer]"][k] for wave in ("sin", "cos"))
        left = said["outer"][k] - late - sine * np.sin(2 * late) - cosine * np.cos(2 * late)
        assert np.std(left) == pytest.approx(0.5 * ARCSEC, rel=0.05)
        assert abs(np.mean(left)) < 0.05 * ARCSEC
    assert done.bench_errors["sin1[outer]"] == pytest.approx(np.zeros(2))


def test_trials_have_tables_of_their_own():
    bench = replace(EXACT, lean=radians(0.1), square=radians(0.1), azimuth=Measured(1.0, 0.1))
    done = simulate_turntable_motion(bench, STEPS, FS, np.random.default_rng(3), trials=3)
    angles = path_profile(bench, STEPS).evaluate(done.time[:1])[0]
    up = true_attitude(bench, angles, done.bench_errors)[:, 0, 2]
    assert done.motion.f[:, 0] == pytest.approx(9.81 * up)
    assert np.ptp(up[:, :2], axis=0).min() > 1e-4


def test_axes_move_at_once_each_at_its_own_limits():
    slow, fast = (
        AxisMotionLimits(radians(10), radians(20)),
        AxisMotionLimits(radians(60), radians(100), radians(400)),
    )
    bench = replace(EXACT, limits=(slow, fast, fast))
    way = path_profile(bench, [Position("p", (pi / 2, pi / 2, pi / 4), 1.0)])
    assert way.ends[0] == pytest.approx(9 + 0.5)
    time = np.linspace(0, way.ends[0], 2001)
    _, rates, accelerations = way.evaluate(time)
    most = np.degrees(np.abs(rates).max(axis=0))
    assert most == pytest.approx([10, 60, most[2]])
    assert np.degrees(np.abs(accelerations).max(axis=0)) == pytest.approx([20, 100, 100])


def test_the_nearest_of_equal_angles_is_where_an_axis_goes():
    way = path_profile(EXACT, [Position("a", (0, 3 * pi / 2, 0), 1.0), Position("b", HOME, 1.0)])
    assert np.degrees(way.evaluate(way.ends)[0][:, 1]) == pytest.approx([-90, -90, 0, 0], abs=1e-9)


@pytest.mark.parametrize(
    ("step", "key"),
    [
        (Position("p", (0.0, 1.0), 1.0), "angles"),
        (Rotation("r", 0, 1.0, 1.0), "rate"),
        (Rotation("r", 0, 1.0, 0.1, (0.0, 0.0)), "angles"),
    ],
)
def test_a_step_of_another_table_is_refused(step: TableStep, key: str):
    with refused(key=key, names=(step.label,)):
        path_profile(EXACT, [step])


def test_an_axis_that_the_table_lacks_is_refused():
    with refused(key="axis", names=("r",)):
        path_profile(replace(EXACT, axes="z"), [Rotation("r", 1, 1.0, 0.1)])
    with refused(key="steps"):
        path_profile(EXACT, [])


def test_steps_in_words():
    assert STEPS[1].describe() == "axes at 0°, 90°, 0°"
    assert STEPS[2].describe() == "turn the outermost axis by +720° at 28.6479 °/s"
    assert STEPS[3].describe().endswith("third axis by -180° at 11.4592 °/s, from 0°, 0°, 0°")
    assert degrees(STEPS[3].seconds * 0.2) == pytest.approx(180)


@pytest.mark.parametrize("wrong", [float("nan"), float("inf")])
def test_steps_that_are_not_finite_are_refused(wrong: float):
    with refused(key="angles", names=("p",)):
        Position("p", (0.0, wrong), 1.0)
    with refused(key="angle", names=("r",)):
        Rotation("r", 0, wrong, 1.0)
    for rate in (wrong, 0.0, -1.0):
        with refused(key="rate", names=("r",)):
            Rotation("r", 0, 1.0, rate)
        with refused(key="seconds", names=("p",)):
            Position("p", (0.0,), rate)
    with refused(key="axis", names=("r",)):
        Rotation("r", 3, 1.0, 1.0)
    with refused(key="angles", names=("p",)):
        Position("p", (0.0,) * 4, 1.0)
