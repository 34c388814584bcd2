"""Magnetometers in continuous motion are calibrated from the field and the gyros."""
# pyright: reportUnknownParameterType=false, reportPossiblyUnboundVariable=false

from pathlib import Path
from shutil import copy

import numpy as np
import pytest
from scipy.stats import chi2
from tests.base_seeds import evidence
from tests.magnetometer import generator as sim
from tests.magnetometer.calibrations import EARTH
from tests.magnetometer.motion import Motion, motion, waves
from tests.magnetometer.motion_calibrations import MotionCalibrated, calibrated_motion

from inercal.basics.errors import NotObserved
from inercal.estimation.scores import SCORE_TEST_SHARE, SIGNIFICANCE_LEVEL
from inercal.pipeline import calibrate, simulate_files
from inercal.recordings.io.write import write_recordings
from inercal.runfile import read

EXAMPLE = Path(__file__).parents[2] / "examples" / "magnetometer" / "motion.toml"


def moved(*seed: int, noise: bool = True, **options: object) -> MotionCalibrated:
    """Return a device in motion on the turning earth, calibrated."""
    rng = np.random.default_rng(seed)
    data: Motion = motion(rng, sim.device(rng), **{"earth": EARTH, **options})
    return calibrated_motion(rng, data, noise)


def require_true(one: MotionCalibrated) -> None:
    """Check all coefficients and the delay against the device, within 4 u."""
    error, covariance = one.errors()
    np.testing.assert_array_less(np.abs(error), 4 * np.sqrt(np.diagonal(covariance)))


def test_the_attitude_is_integrated_exactly():
    """Steps that are four times as long give the same turn, within 1e-6 rad."""
    way = waves(np.random.default_rng(1))
    start = np.arange(400) * 0.005
    turns = np.eye(3)
    for one in way.turn(start, 0.005):
        turns = turns @ one
    long = np.eye(3)
    for one in way.turn(start[::4], 0.02):
        long = long @ one
    np.testing.assert_allclose(turns, long, atol=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize("device", [1, evidence(2), evidence(3)])
@pytest.mark.parametrize("noise", [True, False], ids=["stated noise", "noise of the data"])
def test_coefficients_biases_and_delay_are_found_within_4_u(device: int, noise: bool):
    one = moved(device, noise=noise)
    require_true(one)
    u = dict(zip(one.estimate.names, one.estimate.std, strict=True))
    assert u["delay"] < 2e-3
    assert u["mx.bias"] < 0.2e-6
    assert u["gx.bias"] < np.radians(0.1)
    assert one.judged.grade == "consistent"


@pytest.mark.slow
@pytest.mark.parametrize("delay", [evidence(-0.0173), evidence(0.0), 0.0411])
def test_a_delay_between_samples_is_found(delay: float):
    one = moved(4, delay=delay, every=1)
    require_true(one)
    at = one.estimate.names.index("delay")
    assert abs(one.estimate.value[at] - delay) < 4 * one.estimate.std[at] < 5e-3


@pytest.mark.slow
def test_errors_in_motion_agree_with_their_covariance(seed: int):
    """The mean of (error)ᵀ covariance⁻¹ (error) is in its two-sided 99.9 % band."""
    count, values = 40, list[float]()
    for k in range(count):
        error, covariance = moved(seed, k).errors()
        sd = np.sqrt(np.diagonal(covariance))
        z = error / sd
        values.append(float(z @ np.linalg.solve(covariance / np.outer(sd, sd), z)))
    whole = chi2(count * len(z))
    assert whole.ppf(0.0005) < sum(values) < whole.ppf(0.9995)


@pytest.mark.slow
@pytest.mark.parametrize("axis", [0, evidence(1), evidence(2)])
def test_turns_about_one_axis_only_are_refused_with_the_combinations(axis: int):
    """The field along the axis is constant, as the offset is."""
    with pytest.raises(NotObserved) as caught:
        moved(5, axes=np.eye(3)[axis])
    name = f"m{'xyz'[axis]}"
    assert {f"{name}.bias", f"{name}.scale"} <= set(caught.value.names)
    assert len(caught.value.directions) > 1


@pytest.mark.slow
def test_a_step_of_the_field_is_found_with_its_time():
    step = 2e-6 * np.array([0.6, 0.0, 0.8])
    one = moved(6, step=step)
    tests = one.estimate.score_tests
    best = min(tests.scores, key=tests.adjusted)
    stem, _, time = best.name.rpartition(" at ")
    assert stem == "step of the field"
    assert tests.adjusted(best) < SCORE_TEST_SHARE * SIGNIFICANCE_LEVEL
    assert abs(float(time.removesuffix(" s")) - 10) < 1
    # The frame of the attitudes is unknown, but the length of the step is not.
    assert np.linalg.norm(best.size) == pytest.approx(2e-6, rel=0.15)
    assert one.judged.grade == "unreliable"


@pytest.mark.slow
def test_a_simulated_run_gives_its_truth(tmp_path: Path):
    run = read(Path(copy(EXAMPLE, tmp_path)))
    write_recordings({run.file(name): made for name, made in simulate_files(run).items()})
    outcome = calibrate(run)
    found = outcome.calibration
    for name in found.sensor.coefficients:
        true = run.truth.get(name, 0.0)
        assert abs(found.value(name) - true) < 4 * found.uncertainty(name), name
    assert outcome.verdict.grade == "consistent"
