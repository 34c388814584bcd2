"""Accelerometers in poses of known angles, and gyros tumbled at rest: errors as stated.

Readings are made with plain numpy and the rotations of scipy, not with the bench's motion.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation
from tests.methods.platform_devices import Table, devices, plan
from tests.methods.test_rates_and_poses import G_TERMS, bench, errors, estimated, nees
from tests.refusals import refused

from inercal.basics.errors import NotObserved
from inercal.basics.units import Measured
from inercal.benches.rate_platform import RatePlatform
from inercal.benches.rate_platform.sections import Pose
from inercal.estimation import Estimate
from inercal.methods.rates_and_poses import ml
from inercal.methods.rates_and_poses import plan as platform_plan
from inercal.physics.sensors import ACCELEROMETER, G0, GYRO, triad
from inercal.recordings import Observations

Array = NDArray[np.float64]
G, NOISE, N = 9.81, 50e-6 * G0, 100
LINEAR = ("k0", "k1", "delta_o", "delta_p")
SPREAD = {"k0": 2e-3 * G0, "k1": 1e-3, "delta_o": 2e-3, "delta_p": 2e-3, "k2": 1e-4 / G0}
UNIT = {line.name: line.si for line in (*ACCELEROMETER, *GYRO)}


def platform(attitude: float, mounting: float) -> RatePlatform:
    """Return a platform with these deviations, °."""
    turns = [float(np.radians(angle)) for angle in (attitude, mounting)]
    return RatePlatform(Measured(G, 1e-5), attitude=turns[0], mounting=turns[1])


def poses(name: str) -> list[Pose]:
    return [s for s in platform_plan(rates=(), attitudes=name) if isinstance(s, Pose)]


def readings(
    steps: Sequence[Pose], of: RatePlatform, terms: Sequence[str], rng: np.random.Generator
) -> tuple[Array, dict[str, Array]]:
    """Return readings (N, r, 3) of drawn devices, m/s², and their true coefficients (N, 3)."""
    truth = {term: SPREAD[term] * rng.standard_normal((N, 3)) for term in terms}
    mounting = Rotation.from_rotvec((of.mounting or 0.0) * rng.standard_normal((N, 3)))
    made = np.empty((N, len(steps), 3))
    for k, step in enumerate(steps):
        # Case to level by the roll about x, then the pitch about the level y.
        level = Rotation.from_euler("xy", [step.roll, step.pitch])
        up = level.inv().apply([0.0, 0.0, 1.0])
        tilt = (of.attitude or 0.0) * rng.standard_normal((N, 3))
        f = G * mounting.apply(Rotation.from_rotvec(tilt).apply(up))
        for j in range(3):
            i, p, o = f[:, j], f[:, (j + 1) % 3], f[:, (j + 2) % 3]
            basis = {"k0": 1.0, "k1": i, "delta_o": p, "delta_p": -o, "k2": i**2}
            made[:, k, j] = i + sum(truth[term][:, j] * basis[term] for term in terms)
    return made + NOISE * rng.standard_normal(made.shape), truth


def fitted(made: Array, steps: Sequence[Pose], of: RatePlatform, terms: Sequence[str]) -> Estimate:
    r, sensor = len(steps), triad("t", "f", "a").with_coefficients(*terms)
    seen = Observations(
        labels=tuple(step.label for step in steps),
        mean=made,
        covariance=np.tile(NOISE**2 * np.eye(3), (r, 1, 1)),
        duration=np.ones(r),
        samples=np.ones(r, dtype=np.int64),
        time=np.arange(r, dtype=float),
        channels=sensor.channels,
        timed=False,
    )
    return ml(seen, sensor, of, steps)


def of_pose_errors(
    found: Estimate, truth: Mapping[str, Array]
) -> tuple[float, Mapping[str, tuple[float, float]]]:
    """Return the NEES over the coefficients, and rms of error and of stated deviation, SI."""
    names = [f"a{axis}.{term}" for term in truth for axis in "xyz"]
    at = [found.names.index(name) for name in names]
    off = found.value[:, at] - np.concatenate(list(truth.values()), axis=1)
    covariance = found.covariance[:, at][:, :, at]
    weighed = np.einsum("ti,tij,tj->t", off, np.linalg.inv(covariance), off).mean() / len(at)
    variance = np.diagonal(covariance, axis1=-2, axis2=-1)
    sizes = {
        term: (
            float(np.sqrt(np.mean(off[:, 3 * k : 3 * k + 3] ** 2))) / UNIT[term],
            float(np.sqrt(np.mean(variance[:, 3 * k : 3 * k + 3]))) / UNIT[term],
        )
        for k, term in enumerate(truth)
    }
    return float(weighed), sizes


# Poses, deviations of attitude and mounting in °, terms, and expected rms: µg, ppm, ″, µg/g².
CASES = {
    "faces": ("faces", 0.02, 0.0, LINEAR, {"k0": 34, "k1": 36, "delta_o": 52}),
    "free mounting": ("tilted", 0.05, 0.1, (*LINEAR, "k2"), {"k1": 26, "delta_o": 362, "k2": 75}),
}


@pytest.mark.parametrize("name", CASES)
def test_errors_of_accelerometers_in_poses_are_as_stated(name: str, seed: int):
    plan_name, attitude, mounting, terms, expected = CASES[name]
    steps, of = poses(plan_name), platform(attitude, mounting)
    made, truth = readings(steps, of, terms, np.random.default_rng(seed))
    found = fitted(made, steps, of, terms)
    assert found.converged.all()
    weighed, sizes = of_pose_errors(found, truth)
    assert 0.9 < weighed < 1.1
    assert {t: sizes[t][1] for t in expected} == pytest.approx(expected, rel=0.1)


def test_tilts_that_are_left_out_show_and_a_mounting_does_not():
    steps, of = poses("tilted"), platform(0.05, 0.1)
    made, truth = readings(steps, of, LINEAR, np.random.default_rng(3))
    found = fitted(made, steps, replace(of, attitude=0.0), LINEAR)
    assert np.mean(found.chi2) / found.dof == pytest.approx(203, rel=0.1)
    found = fitted(made, steps, replace(of, mounting=0.0), LINEAR)
    weighed, sizes = of_pose_errors(found, truth)
    assert np.mean(found.chi2) / found.dof == pytest.approx(1.0, abs=0.1)
    assert weighed > 5
    assert sizes["delta_o"][0] > 5 * sizes["delta_o"][1]


@pytest.mark.parametrize("key", ["attitude", "mounting"])
def test_an_error_of_poses_that_is_not_stated_is_refused(key: str):
    steps, of = poses("faces"), platform(0.02, 0.1)
    made, _ = readings(steps, of, LINEAR, np.random.default_rng(4))
    with refused(key=f"[bench] {key}"):
        fitted(made, steps, replace(of, **{key: None}), LINEAR)


def test_poses_with_one_face_up_do_not_tell_bias_from_scale():
    steps = [step for step in poses("faces") if step.up[2] > -0.5]
    of = platform(0.02, 0.1)
    made, _ = readings(steps, of, LINEAR, np.random.default_rng(5))
    with refused(NotObserved) as refusal:
        fitted(made, steps, of, (*LINEAR, "k2"))
    assert {"az.k1", "az.k2"} <= set(refusal.value.names)


TUMBLE = [replace(row, seconds=120.0) for row in plan([0], six=True)]
LEVEL = Table(0.0, 0.0, 0.0, 0.0, float(np.radians(0.02)))


@pytest.mark.parametrize(("grade", "along", "across"), [("T", 0.46, 4.8), ("C", 2.7, 5.4)])
def test_a_tumble_at_rest_shows_the_sensitivity_to_acceleration(
    grade: str, along: float, across: float, seed: int
):
    """Along the input axis as well as the noise, across it as the level earth's rate allows."""
    terms = ("bias", *G_TERMS)
    made = devices(TUMBLE, grade, LEVEL, terms, N, np.random.default_rng(seed))
    found = estimated(made, bench(LEVEL), terms)
    assert 0.88 < nees(made, found, terms) < 1.12
    stated = {
        t: np.sqrt(np.mean(sd**2)) / UNIT[t] for t, (_, sd) in errors(made, found, terms).items()
    }
    assert stated["g_i"] == pytest.approx(along, rel=0.05)
    assert stated["g_p"] == pytest.approx(across, rel=0.05)


def test_the_vertical_earth_rate_left_out_of_a_tumble_shows_in_no_residual():
    terms = ("bias", *G_TERMS)
    made = devices(TUMBLE, "T", LEVEL, terms, N, np.random.default_rng(6))
    # On the equator the earth's rate has no vertical part.
    found = estimated(made, replace(bench(LEVEL), latitude=Measured(0.0, 0.0)), terms)
    off, _ = errors(made, found, terms)["g_i"]
    assert np.mean(off) / UNIT["g_i"] * G / G0 == pytest.approx(11.55, rel=0.02)
    assert np.mean(found.chi2) / found.dof < 1.2
