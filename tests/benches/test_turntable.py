"""The turntable's attitude and motion: against a generator of its own, and as slopes."""

from dataclasses import replace
from math import pi, radians
from typing import Any

import numpy as np
import pytest
from tests.accuracy import turntable as made
from tests.refusals import refused

from inercal.basics.units import Measured
from inercal.benches import Turntable
from inercal.benches.motion_control import AxisMotionLimits
from inercal.benches.turntable.attitude import (
    ideal_readback,
    linear_misalignment,
    motion,
    reference_attitude,
    true_attitude,
)
from inercal.physics.earth import EARTH_RATE
from inercal.physics.frames import log_so3

ARCSEC = radians(1 / 3600)
BENCH = Turntable(
    Measured(made.G, 0.0),
    radians(38),
    Measured(0.3, radians(0.1)),
    lean=5 * ARCSEC,
    square=2 * ARCSEC,
    harmonics=(2 * ARCSEC, ARCSEC),
    white=0.5 * ARCSEC,
    latency=Measured(2e-3, 5e-3),
    clock=1e-6,
    lever=(Measured(0.1, 1e-3), Measured(-0.05, 1e-3), Measured(0.02, 1e-3)),
)
EXACT = Turntable(Measured(made.G, 0.0), radians(38), harmonics=(2 * ARCSEC, ARCSEC))
TABLE = made.Table(white=0.0, lean=radians(1), square=radians(0.5), azimuth=radians(20))
SILENT = made.Grade(0.0, 0.0, 0.0, 0.0)
PERFECT = made.Device(0.0, 0.0, 0.0, 0.0)
TRIALS = 3


def drawn(seed: int) -> dict[str, np.ndarray]:
    """Return what the generator draws of its table, by the bench's names."""
    rng = np.random.default_rng([seed, 2308])
    squares = TABLE.square * rng.standard_normal((TRIALS, 2))
    base = np.array([TABLE.lean, TABLE.lean, TABLE.azimuth]) * rng.standard_normal((TRIALS, 3))
    phases = rng.uniform(0, 2 * pi, (TRIALS, 2, 3))
    q = {"lean_x": base[:, 0], "lean_y": base[:, 1], "azimuth": -base[:, 2]}
    q |= {"square_1": squares[:, 0], "square_2": squares[:, 1]}
    for h, size in enumerate(TABLE.harmonics):
        for i, name in enumerate(("outer", "middle", "inner")):
            q[f"sin{h + 1}[{name}]"] = size * np.cos(phases[:, h, i])
            q[f"cos{h + 1}[{name}]"] = size * np.sin(phases[:, h, i])
    return q


def test_rates_and_forces_are_those_of_the_generator():
    path = made.complete_path(3.0)
    run = made.draw(4, TRIALS, path, SILENT, TABLE, PERFECT, hz=20.0)
    angles, rates, *_ = made.simulate_travel(path, TABLE, 20.0)
    felt = motion(EXACT, angles, rates, np.zeros_like(rates), drawn(4))
    assert felt.w == pytest.approx(run.rates, rel=1e-9, abs=1e-15)
    assert felt.f == pytest.approx(run.forces, rel=1e-9, abs=1e-13)


def test_readback_has_the_harmonics_of_the_generator():
    path = made.turns()
    run = made.draw(5, TRIALS, path, SILENT, TABLE, PERFECT, hz=20.0)
    late = made.simulate_travel(path, TABLE, 20.0)[2]
    assert ideal_readback(EXACT, late, drawn(5)) == pytest.approx(run.angles, rel=1e-14, abs=1e-15)


def test_a_readback_is_the_attitude_of_the_generator():
    angles = np.random.default_rng(1).uniform(-9, 9, (50, 3))
    assert reference_attitude(EXACT, angles) == pytest.approx(made.attitude(angles), abs=1e-15)


def test_the_azimuth_is_where_y_points_clockwise_from_north():
    (mat,) = reference_attitude(replace(EXACT, azimuth=Measured(pi / 2, 0.0)), np.zeros((1, 3)))
    assert mat @ [0, 1, 0] == pytest.approx([1, 0, 0])  # east
    assert mat @ [0, 0, 1] == pytest.approx([0, 0, 1])


@pytest.mark.parametrize("axes", ["z", "zx", "zxy", "xyz", "yzx", "xz"])
def test_misalignments_are_the_slopes_of_the_attitude(axes: str):
    bench = replace(BENCH, axes=axes)
    true = np.random.default_rng(2).uniform(-9, 9, (40, len(axes)))
    by = linear_misalignment(bench, true)
    declared = bench.acting_parameters()
    assert len(by.parameters) == 3 + len(axes) - 1 + 4 * len(axes)
    h = 1e-5
    for j, parameter in enumerate(by.parameters):
        off = []
        for sign in (h, -h):
            q = {parameter.name: np.array(declared[parameter.name].value + sign)}
            said = reference_attitude(bench, ideal_readback(bench, true, q))
            off.append(log_so3(true_attitude(bench, true, q) @ said.swapaxes(-1, -2)))
        slope = (off[0] - off[1]) / (2 * h)
        assert by.by[..., j] == pytest.approx(slope, abs=1e-9), parameter.name


def test_misalignments_add_to_what_is_off():
    rng = np.random.default_rng(3)
    declared = BENCH.acting_parameters()
    q = {n: p.value + p.sd * rng.standard_normal(TRIALS) for n, p in declared.items()}
    true = rng.uniform(-9, 9, (30, 3))
    said = ideal_readback(BENCH, true, q)
    assert said.shape == (TRIALS, 30, 3)
    by = linear_misalignment(BENCH, said)
    beta = np.stack([q[p.name] - declared[p.name].value for p in by.parameters], axis=-1)
    turned = true_attitude(BENCH, true, q) @ reference_attitude(BENCH, said).swapaxes(-1, -2)
    off = log_so3(turned)
    left = off - (by.by @ beta[:, None, :, None])[..., 0]
    assert np.abs(off).max() > 100 * ARCSEC
    assert np.abs(left).max() < 0.1 * ARCSEC


def swung(t: np.ndarray, k: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return angles, rates and accelerations of k axes that all swing."""
    size, speed = np.array([1.5, 0.8, -1.1])[:k], np.array([0.7, 1.1, 0.9])[:k]
    phase = speed * t[:, None] + np.array([0.3, 1.0, 2.0])[:k]
    return size * np.sin(phase), size * speed * np.cos(phase), -size * speed**2 * np.sin(phase)


@pytest.mark.parametrize("axes", ["z", "yx", "zxy", "xyz"])
def test_rate_its_derivative_and_force_are_those_of_the_attitude(axes: str):
    bench, k = replace(BENCH, axes=axes), len(axes)
    q = {"lean_x": np.array(0.02), "square_1": np.array(0.01)}
    t, h = np.linspace(0, 10, 200), 1e-3
    felt = motion(bench, *swung(t, k), q)
    mats = [true_attitude(bench, swung(t + j * h, k)[0], q) for j in (-2, -1, 0, 1, 2)]
    earth = EARTH_RATE * np.array([0, np.cos(bench.latitude), np.sin(bench.latitude)])
    mat = mats[2]
    rate = (
        8 * log_so3(mats[1].swapaxes(1, 2) @ mats[3]) - log_so3(mats[0].swapaxes(1, 2) @ mats[4])
    ) / (12 * h)
    assert felt.w == pytest.approx(rate + mat.swapaxes(1, 2) @ earth, abs=1e-8)
    after, before = (motion(bench, *swung(t + j * h, k), q).w for j in (1, -1))
    assert felt.dw == pytest.approx((after - before) / (2 * h), abs=2e-6)
    place = [m @ [0.1, -0.05, 0.02] for m in mats]
    speed = (8 * (place[3] - place[1]) - (place[4] - place[0])) / (12 * h)
    moved = (16 * (place[3] + place[1]) - (place[4] + place[0]) - 30 * place[2]) / (12 * h**2)
    force = moved + [0, 0, made.G] + 2 * np.cross(earth, speed)
    assert felt.f == pytest.approx((mat.swapaxes(1, 2) @ force[..., None])[..., 0], abs=1e-8)


def test_the_lever_arm_of_the_generator_is_felt_but_for_coriolis():
    lever = tuple(arm.value for arm in BENCH.lever)
    table = replace(TABLE, lever=lever, lean=0.0, square=0.0, azimuth=0.0)
    path = made.turns()
    run = made.draw(6, 1, path, SILENT, table, PERFECT, hz=20.0)
    angles, rates, *_ = made.simulate_travel(path, table, 20.0)
    bench = replace(EXACT, lever=BENCH.lever)
    felt = motion(bench, angles, rates, np.zeros_like(rates), {})
    steady = np.abs(np.gradient(rates, axis=0)).max(axis=1) == 0
    most = 2 * EARTH_RATE * radians(10) * 0.12
    assert np.abs(felt.f - run.forces[0])[steady].max() < most
    assert np.abs(felt.f - run.forces[0])[steady].max() > 0.3 * most


def test_parameters_are_named_and_shared_by_the_run():
    names = list(BENCH.acting_parameters())
    assert names[:6] == ["g", "lean_x", "lean_y", "azimuth", "square_1", "square_2"]
    assert names[6:10] == ["sin1[outer]", "cos1[outer]", "sin2[outer]", "cos2[outer]"]
    assert names[-5:] == ["latency", "clock", "lever_x", "lever_y", "lever_z"]
    assert {p.scope for p in BENCH.parameters} == {"run"}
    assert "square_1" not in replace(BENCH, axes="z").acting_parameters()
    assert replace(BENCH, axes="xz").names == ("outer", "inner")


@pytest.mark.parametrize(
    ("change", "key"),
    [
        ({"axes": "zz"}, "axes"),
        ({"axes": ""}, "axes"),
        ({"axes": "zxw"}, "axes"),
        ({"gravity": Measured(0.0, 0.0)}, "gravity"),
        ({"latitude": 2.0}, "latitude"),
        ({"lean": -1.0}, "lean_x"),
        ({"harmonics": (1e-5, float("nan"))}, "sin2[outer]"),
        ({"white": -1e-6}, "white"),
        ({"clock": float("inf")}, "clock"),
        ({"latency": Measured(float("nan"), 0.0)}, "latency"),
        ({"limits": (AxisMotionLimits(1.0, 1.0),) * 2}, "limits"),
        ({"lever": (Measured(0.1, 0.0),)}, "lever"),
    ],
)
def test_a_bench_that_cannot_be_is_refused(change: dict[str, Any], key: str):
    with refused(key=key):
        replace(BENCH, **change)


def test_angles_of_other_axes_are_refused():
    with refused(key="angles"):
        reference_attitude(BENCH, np.zeros((5, 2)))
    with refused(key="angles"):
        linear_misalignment(replace(BENCH, axes="z"), np.zeros((5, 2)))
