"""Two public hand-held recordings against what others found in them.

Xsens MTi: imu_tk (Tedaldi, Pretto, Menegatti 2014) built and run on the same files; its model is
a = T K (raw − b) with T upper triangular. MPU-9150: Mikov, Reginya, Moschevikin, ICINS 2020.
"""

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from inercal import calibrate
from inercal.benches import Hand
from inercal.methods.multi_position import joint
from inercal.methods.multi_position.rest_observations import Rests, Scatter
from inercal.methods.multi_position.row_whitening import whitener, whitener_with_drift
from inercal.pipeline import Outcome
from inercal.recordings import Observations

Array = NDArray[np.float64]
ROOT = Path(__file__).parents[2]
GRAVITY = 9.81744
INVERSE_SCALES = {"a": (414.459, 412.010, 414.649), "g": (4777.96, 4764.21, 4773.66)}
OFFSETS = (33124.1826, 33275.1794, 32364.4156)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory, data_dir: Path) -> Path:
    """Return a copy of the run files that names the data where they are."""
    copy = tmp_path_factory.mktemp("hand_held")
    for name in ("xsens.toml", "mpu9150.toml"):
        shutil.copy(ROOT / "examples" / "hand_held" / name, copy)
        text = (copy / name).read_text(encoding="utf-8")
        (copy / name).write_text(text.replace("../../../shared/data", str(data_dir)), "utf-8")
    return copy


@pytest.fixture(scope="module")
def xsens(folder: Path) -> Outcome:
    return calibrate(folder / "xsens.toml")


@pytest.fixture(scope="module")
def xsens_with_g(folder: Path) -> Outcome:
    """Return the result with the sensitivity to acceleration, which is stated."""
    return calibrate(folder / "xsens.toml", also=["g"])


@pytest.fixture(scope="module")
def mpu9150(folder: Path) -> Outcome:
    return calibrate(folder / "mpu9150.toml", also="auto")


def upper(forward: Array) -> Array:
    """Return a forward matrix in imu_tk's frame: K⁻¹ T⁻¹, upper triangular, by a rotation."""
    flipped = forward[::-1, ::-1]
    _, r = np.linalg.qr(flipped.T)
    signs = np.sign(np.diag(r))
    return (r.T * signs)[::-1, ::-1]


def forward(outcome: Outcome, kind: str) -> Array:
    """Return the forward matrix of one triad, counts per SI unit, in inercal's frame."""
    found, scale = outcome.calibration, {"a": 415.0, "g": 4770.0}[kind]
    diagonal = "k1" if kind == "a" else "scale"
    matrix = np.eye(3)
    values = dict(zip(found.sensor.coefficients, found.values, strict=True))
    for k, axis in enumerate("xyz"):
        p, o = (k + 1) % 3, (k + 2) % 3
        matrix[k, k] += values[f"{kind}{axis}.{diagonal}"]
        matrix[k, p] = values.get(f"{kind}{axis}.delta_o", 0.0)
        matrix[k, o] = -values.get(f"{kind}{axis}.delta_p", 0.0)
    return scale * matrix


@pytest.mark.slow
def test_xsens_accelerometers_agree_with_imu_tk(xsens: Outcome):
    scales = np.diag(upper(forward(xsens, "a")))
    np.testing.assert_allclose(scales, INVERSE_SCALES["a"], rtol=1e-3)
    _, offset = xsens.calibration.affine_correction()
    np.testing.assert_allclose(offset[:3], OFFSETS, rtol=0, atol=3)


def test_xsens_gyros_agree_with_imu_tk(xsens: Outcome):
    scales = np.diag(forward(xsens, "g"))
    np.testing.assert_allclose(scales, INVERSE_SCALES["g"], rtol=3e-3)


def test_xsens_norms_are_gravity_over_rests_and_samples(xsens: Outcome):
    assert len(xsens.marks) >= 36
    assert xsens.recording is not None
    felt = xsens.calibration.correct(xsens.recording).f
    off = np.linalg.norm(felt, axis=1) - GRAVITY
    each = np.concatenate([off[mark.start : mark.stop] for mark in xsens.marks])
    means = [felt[m.start : m.stop].mean(axis=0) for m in xsens.marks]
    assert np.sqrt(np.mean((np.linalg.norm(means, axis=1) - GRAVITY) ** 2)) <= 1.2e-3
    assert np.sqrt(np.mean(each**2)) <= 8.3e-3


@pytest.mark.slow
def test_xsens_sensitivity_to_acceleration_explains_its_gyros(xsens_with_g: Outcome):
    found = {group.name: group for group in xsens_with_g.estimate.groups}
    assert found["rotations"].p_value > 0.05
    assert found["rates"].spread.excess < 3e-4


def test_xsens_result_asks_for_the_sensitivity_to_acceleration(xsens: Outcome):
    assert any('also = ["g"]' in line for line in xsens.verdict.lines)


@pytest.mark.slow
def test_xsens_adds_the_sensitivity_to_acceleration_by_itself(
    xsens: Outcome, xsens_with_g: Outcome, folder: Path
):
    found, stated = calibrate(folder / "xsens.toml", also="auto"), xsens_with_g
    (added,) = found.additions
    assert (added.group, len(added.coefficients)) == ("g", 9)
    assert found.verdict.grade == "reservations"
    assert added.chi2_before == pytest.approx(4884, abs=1)
    assert added.chi2_after == pytest.approx(589, abs=1)
    assert added.chi2_before == xsens.estimate.score_tests.chi2
    np.testing.assert_array_equal(found.calibration.values, stated.calibration.values)
    np.testing.assert_array_equal(found.calibration.covariance, stated.calibration.covariance)


@pytest.mark.slow
def test_mpu9150_shows_no_sensitivity_to_acceleration_and_adds_none(mpu9150: Outcome, folder: Path):
    found, stated = mpu9150, calibrate(folder / "mpu9150.toml", also=["g"])
    assert found.additions == ()
    assert found.verdict.grade == "reservations"
    chi2 = [one.estimate.score_tests.chi2 for one in (found, stated)]
    assert chi2[0] - chi2[1] < 9  # for nine coefficients
    for name in found.calibration.sensor.coefficients:
        off = found.calibration.value(name) - stated.calibration.value(name)
        assert abs(off) < min(one.calibration.uncertainty(name) for one in (found, stated)) / 2


def test_mpu9150_accelerometers_agree_with_the_published(mpu9150: Outcome):
    outcome = mpu9150
    scales = np.diag(upper(forward(outcome, "a"))) / 415
    u = [outcome.calibration.uncertainty(f"a{axis}.k1") for axis in "xyz"]
    assert (np.abs(scales - [1.00363, 1.00315, 1.00647]) < 2 * np.array(u)).all()
    assert max(u) < 6e-4
    _, offset = outcome.calibration.affine_correction()
    np.testing.assert_allclose(offset[:3], [0.103, 0.097, 0.344], rtol=0, atol=0.006)


def left_out(seen: Observations, k: int) -> Observations:
    """Return the observations without rest k and the ways to it and from it."""
    rest, way = np.arange(len(seen.labels)) != k, seen.transitions
    assert way is not None
    kept = (way.rest != k) & (way.rest + 1 != k)
    return replace(
        seen,
        labels=tuple(label for label, stays in zip(seen.labels, rest, strict=True) if stays),
        mean=seen.mean[rest],
        covariance=seen.covariance[rest],
        duration=seen.duration[rest],
        samples=seen.samples[rest],
        time=seen.time[rest],
        drift=None if seen.drift is None else seen.drift[np.ix_(rest, rest)],
        transitions=replace(
            way,
            rest=(way.rest - (way.rest > k))[kept],
            start=way.start[kept],
            left=way.left[kept],
            reached=way.reached[kept],
            stop=way.stop[kept],
        ),
    )


@pytest.fixture(scope="module")
def xsens_without_drift(folder: Path) -> Outcome:
    """Return the result with a small stated instability, so that no drift is added to U."""
    run_file = folder / "xsens_stated.toml"
    text = (folder / "xsens.toml").read_text(encoding="utf-8")
    stated = text.replace("[sensor.gyro]", 'bias_instability = "0.1 µg"\n\n[sensor.gyro]')
    run_file.write_text(stated, encoding="utf-8")
    return calibrate(run_file)


@pytest.mark.evidence
def test_xsens_moves_without_a_pose_as_its_uncertainties_say(xsens_without_drift: Outcome):
    """The jackknife over poses, against what the stated covariance lets one expect of it.

    U of the accelerometers otherwise includes a drift that one pass over the poses cannot exclude;
    a jackknife does not see it.
    With θ_k and C_k found without pose k, E Σ (θ_k − θ)² = Σ (C_k − C). Only for poses that each
    weigh little is that C, as the usual jackknife takes it; here two poses alone lie near +x.
    """
    xsens = xsens_without_drift
    sensor, bench, estimate = xsens.calibration.sensor, xsens.bench, xsens.estimate
    assert isinstance(bench, Hand)
    p, n = len(sensor.coefficients), len(xsens.marks)
    scatter = Scatter(*(group.spread for group in estimate.groups))

    def covariance(seen: Observations) -> Array:
        rests = Rests(seen, sensor, bench)
        x = rests.start()
        x[: estimate.value.size] = estimate.value
        rows = rests.rows(x)
        size = np.concatenate([sensor.unit_scale, [known.sd for known in rests.known_quantities]])
        white = whitener_with_drift(rests, rows, whitener(rests, rows, scatter))
        J = white(rows.jacobian) * size
        prior = np.diag([0.0] * p + [1.0] * len(rests.known_quantities))
        variance: Array = np.diag(np.asarray(np.linalg.inv(J.T @ J + prior), dtype=float))
        return variance[:p] * size[:p] ** 2

    whole = covariance(xsens.observations)
    np.testing.assert_allclose(np.sqrt(whole), xsens.calibration.std, rtol=0.05)
    subsets = [left_out(xsens.observations, k) for k in range(n)]
    values = np.array([joint(seen, sensor, bench, ()).value[:p] for seen in subsets])
    moved = np.sqrt(np.sum((values - values.mean(axis=0)) ** 2, axis=0))
    expected = np.sqrt(sum(covariance(seen) - whole for seen in subsets))
    plain = moved * ((n - 1) / n) ** 0.5 / xsens.calibration.std
    for name, one, other in zip(sensor.coefficients, plain, moved / expected, strict=True):
        print(f"{name}: jackknife / stated {one:.2f}, found / expected {other:.2f}")
    assert np.all(moved < 1.6 * expected)
    assert np.all(moved > 0.6 * expected)


@pytest.mark.slow
def test_xsens_without_a_stated_instability_adds_the_drift_that_rests_leave_open(
    xsens: Outcome, xsens_without_drift: Outcome
):
    ratio = xsens.calibration.std / xsens_without_drift.calibration.std
    accelerometers = np.array([name[0] == "a" for name in xsens.calibration.sensor.coefficients])
    assert np.all(ratio[accelerometers] > 1.005)
    np.testing.assert_allclose(ratio[~accelerometers], 1, atol=0.005)
