"""The rate table: what its mountings feel, what acts on which dwell, and its slopes."""

from dataclasses import replace
from math import cos, radians, sin
from typing import Any

import numpy as np
import pytest
from tests.accuracy import rate_table as made
from tests.refusals import refused

from inercal.basics.units import Measured
from inercal.benches.rate_table.bench import (
    RateTable,
    force_sensitivities,
    mounting_names,
    sensed_motion,
    speed_names,
)
from inercal.benches.rate_table.fixture import (
    PLANES,
    RPM,
    is_tilted,
    mounting_attitude,
    multi_angle_plan,
    planar_plan,
)
from inercal.physics.plan import Spin

BENCH = RateTable(Measured(9.8, 1e-3), Measured(0.25, 1e-4), 5e-4, 3e-3, 1e-4, 5e-4, 1e-3)
AT_86 = 0.25 * (86 * RPM) ** 2 / 9.8


def in_g(*attitudes: Any):
    steps = [Spin(str(k), 86 * RPM, 1.0, a) for k, a in enumerate(attitudes)]
    return sensed_motion(BENCH, steps, {}).f / 9.8


def test_planar_mountings_feel_the_centre_and_gravity():
    f = in_g(*(mounting_attitude(plane) for plane in PLANES))
    assert f == pytest.approx(np.array([[AT_86, 0, 1], [0, AT_86, 1], [1, 0, AT_86]]), abs=1e-15)


@pytest.mark.parametrize("tilt", [30, 60, 135])
@pytest.mark.parametrize("plane", PLANES)
def test_a_tilt_is_felt_as_the_note_says(plane: Any, tilt: float):
    a = radians(tilt)
    (f,) = in_g(mounting_attitude(plane, a))
    radial, normal = ("xyz".index(axis) for axis in PLANES[plane])
    assert f[radial] == pytest.approx(AT_86 * cos(a) + sin(a))
    assert f[normal] == pytest.approx(-AT_86 * sin(a) + cos(a))
    assert f[3 - radial - normal] == 0


def test_a_tilt_about_the_radial_direction_leaves_the_centre():
    (f,) = in_g(mounting_attitude("XY", radians(30), about="radial"))
    assert f == pytest.approx([AT_86, sin(radians(30)), cos(radians(30))])


def test_two_tilts_have_three_readings():
    one = mounting_attitude("XY", radians(135))
    dihedral, azimuth, successive = (
        mounting_attitude("XY", radians(135), radians(45), reading=reading)
        for reading in ("dihedral", "azimuth", "successive")
    )
    f = in_g(one, dihedral, azimuth, successive)
    assert f[1] == pytest.approx(f[0], abs=1e-12)
    assert azimuth.up[2] == one.up[2]
    assert np.arctan2(azimuth.out[1], azimuth.out[0]) == pytest.approx(radians(45))
    assert successive.out == one.out
    assert np.abs(f[2:, 0] * f[2:, 1]).min() > 0.1
    for attitude in (dihedral, azimuth, successive):
        pair = np.array([attitude.out, attitude.up])
        assert pair @ pair.T == pytest.approx(np.eye(2), abs=1e-15)


@pytest.mark.parametrize("reading", ["azimuth", "dihedral", "successive"])
def test_all_states_are_those_of_the_generator(reading: Any):
    bench = RateTable(Measured(made.G, 0.0), Measured(made.RADIUS, 0.0))
    f = sensed_motion(bench, [*planar_plan(), *multi_angle_plan(reading)], {}).f / made.G
    assert f == pytest.approx(made.nominal_force(made.PLANAR + made.TILTED, reading), abs=1e-15)


def test_dihedral_angles_that_no_pose_has_are_refused():
    with refused(key="second"):
        mounting_attitude("XY", radians(20), radians(30), reading="dihedral")
    with refused(key="plane"):
        mounting_attitude("XZ")  # pyright: ignore[reportArgumentType]


def test_plans_have_nine_and_sixteen_states():
    assert [step.label for step in planar_plan()][:3] == ["XY_0", "XY_46", "XY_86"]
    for one_speed in (False, True):
        steps = multi_angle_plan(one_speed=one_speed)
        assert len({step.label for step in steps}) == 16
        assert all(is_tilted(step) for step in steps)
        assert len({step.rate for step in steps}) == 2 - one_speed
    assert len({step.attitude for step in multi_angle_plan()}) == 10
    assert not any(is_tilted(step) for step in planar_plan())
    assert all(is_tilted(step) for step in multi_angle_plan(about="radial"))


def test_slopes_are_those_of_the_force():
    steps = [*planar_plan(), *multi_angle_plan()]
    rng = np.random.default_rng(2)
    declared = BENCH.acting_parameters(steps)
    q = {n: np.array(p.value + 0.01 * rng.standard_normal()) for n, p in declared.items()}
    made = sensed_motion(BENCH, steps, q)
    assert set(made.df) == set(declared)
    for name in declared:
        near, far = (sensed_motion(BENCH, steps, q | {name: q[name] + h}).f for h in (-1e-5, 1e-5))
        assert made.df[name] == pytest.approx((far - near) / 2e-5, abs=2e-8)


def test_mountings_and_speeds_share_what_is_theirs():
    steps = [*planar_plan(), *multi_angle_plan()]
    made = sensed_motion(BENCH, steps, {})
    acts = {
        name: {s.label for s, by in zip(steps, slope, strict=True) if by.any()}
        for name, slope in made.df.items()
    }
    assert acts["pose_y[XY]"] == {"XY_0", "XY_46", "XY_86"}
    assert acts["seat[XY]"] == {"XY_46", "XY_86"}
    assert acts["seat[XY30]"] == {"XY30_46", "XY30_86"}
    assert len(acts["speed[86 rpm]"]) == 13
    assert "speed[0 rpm]" not in acts
    assert acts["lean_1[XY_0]"] == acts["lean_2[XY_0]"] == {"XY_0"}
    assert len(acts["g"]) == 25
    assert len(BENCH.acting_parameters(steps)) == 3 + 13 * 4 + 2 + 3 * 2
    assert force_sensitivities(BENCH, steps).shape == (63, 25, 3)


def test_tilts_that_differ_a_little_are_two_mountings():
    tilts = ((135.01, 45), (135.04, 45), (135.04, 45.001))
    poses = [mounting_attitude("XY", radians(first), radians(second)) for first, second in tilts]
    steps = [Spin(str(k), 86 * RPM, 1.0, pose) for k, pose in enumerate(poses)]
    assert mounting_names(steps) == ["XY135.01+45", "XY135.04+45", "XY135.04+45.001"]
    assert sum(name.startswith("pose_x") for name in BENCH.acting_parameters(steps)) == 3


def test_rates_read_back_a_little_otherwise_are_one_set_speed():
    steps = planar_plan()
    read = [replace(step, rate=step.rate * (1 + 1e-4 * k)) for k, step in enumerate(steps)]
    assert len(BENCH.acting_parameters(read)) == len(BENCH.acting_parameters(steps))
    assert speed_names([Spin("a", 1.0), Spin("b", -1.0), Spin("c", 1.01), Spin("d", 1.001)]) == [
        "9.549 rpm",
        "-9.549 rpm",
        "9.645 rpm",
        "9.549 rpm",
    ]


def test_a_table_at_rest_knows_neither_radius_nor_rate():
    steps = planar_plan(speeds=(0.0,))
    assert set(BENCH.acting_parameters(steps)) == {
        "g",
        *(f"pose_{axis}[{plane}]" for axis in "xyz" for plane in PLANES),
        *(f"lean_{k}[{plane}_0]" for k in (1, 2) for plane in PLANES),
    }
    assert sensed_motion(BENCH, steps, {}).f[0] == pytest.approx([0, 0, 9.8])


def test_trials_have_errors_of_their_own():
    steps = planar_plan()
    q = {"pose_x[XY]": np.array([0.0, 0.01]), "radius": np.array([0.25, 0.26])}
    f = sensed_motion(BENCH, steps, q).f
    assert f.shape == (2, 9, 3)
    assert f[0] == pytest.approx(sensed_motion(BENCH, steps, {}).f)
    assert f[1, 0] == pytest.approx([0, -9.8 * sin(0.01), 9.8 * cos(0.01)])


def test_a_lean_is_felt_at_rest_alone_and_changes_no_norm():
    steps = planar_plan(speeds=(0.0, 86 * RPM))
    leaning = {f"lean_{k}[{step.label}]": 0.01 * k for k in (1, 2) for step in steps}
    plain = sensed_motion(BENCH, steps, {}).f
    f = sensed_motion(BENCH, steps, {name: np.array(by) for name, by in leaning.items()}).f
    # XY: x toward the centre, z up, and y = z × x along.
    assert f[0] / 9.8 == pytest.approx([0.01, 0.02, np.sqrt(1 - 5e-4)])
    assert f[1::2] == pytest.approx(plain[1::2], abs=0)
    assert np.linalg.norm(f[::2], axis=-1) == pytest.approx(9.8, rel=1e-15)


def test_over_whole_turns_a_lean_leaves_its_second_order():
    lean, azimuth = 1.7e-3, np.linspace(0, 2 * np.pi, 3600, endpoint=False)
    steps = [Spin("r", 0.0, 1.0, mounting_attitude("XY"))]
    q = {"lean_1[r]": lean * np.cos(azimuth), "lean_2[r]": -lean * np.sin(azimuth)}
    mean = sensed_motion(BENCH, steps, q).f.mean(axis=0)
    assert mean[0] == pytest.approx([0, 0, 9.8 * (1 - lean**2 / 2)], abs=1e-10)


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("radius", Measured(0.0, 0.0)),
        ("gravity", Measured(-1.0, 0.0)),
        ("pose", -1.0),
        ("lean", -1e-3),
        ("speed", float("nan")),
    ],
)
def test_a_bench_that_cannot_be_is_refused(key: str, value: float | Measured):
    with refused(key=key):
        replace(BENCH, **{key: value})  # pyright: ignore[reportArgumentType]


def test_a_step_of_unknown_attitude_is_refused():
    with refused(key="attitude", names=("a",)):
        sensed_motion(BENCH, [Spin("a", 1.0)], {})
