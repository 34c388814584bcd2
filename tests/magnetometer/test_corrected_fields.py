"""Corrected magnetic fields, their uncertainty at operating points, and that of the heading."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from tests.magnetometer.nine_axes import FIELD, OFFSET, READING, Array, D, calibrated, nine_axes
from tests.program import run_program
from tests.refusals import refused

from inercal.basics.errors import InputError
from inercal.calibration import Validity
from inercal.calibration.files import load, save
from inercal.physics.magnetism import field_matrix, level_attitudes, split_matrix
from inercal.physics.motion import Motion
from inercal.physics.sensors import G0, imu

UP = np.array([0.0, 0.0, G0])


def heading(f: Array, m: Array) -> Array:
    """Return the heading of the sensor's x axis from magnetic north, rad, at any tilt."""
    up = f / np.linalg.norm(f, axis=-1, keepdims=True)
    west = np.cross(up, m)
    west /= np.linalg.norm(west, axis=-1, keepdims=True)
    return np.arctan2(west[..., 0], np.cross(west, up)[..., 0])


@pytest.mark.parametrize("directions", [("x", "y", "z"), ("y", "x", "-z")])
def test_the_worked_example_is_corrected_to_its_field(directions: tuple[str, str, str]):
    calibration = calibrated(nine_axes(directions), D, OFFSET)
    motion = calibration.correct(np.concatenate([UP, np.zeros(3), READING])[None])
    np.testing.assert_allclose(motion.m[0], FIELD * 1e-6, rtol=1e-12)
    np.testing.assert_allclose(motion.f[0], UP, atol=1e-12)


def test_u_of_field_and_heading_is_the_scatter_of_corrections_of_drawn_devices(tmp_path: Path):
    sensor = nine_axes(("y", "x", "-z"), "bias_dT", "scale_dT")
    calibration = calibrated(sensor, D[[1, 0, 2]] * [[1], [1], [-1]], OFFSET)
    save(calibration, tmp_path / "nine.calibration.json")
    calibration = load(tmp_path / "nine.calibration.json")
    rng, kelvin = np.random.default_rng(1), np.array([313.15, 293.15])
    f, m = np.array([[1.0, -2.0, 9.4], [0.0, 0.0, G0]]), 1e-6 * np.array([FIELD, [-30, 10, 20]])
    found = calibration.predict(f, None, kelvin, m)
    drawn = rng.multivariate_normal(calibration.values, calibration.covariance, 4000)
    dT = kelvin - sensor.reference_temperature
    y = sensor.to_output(sensor.forward(Motion(f, dT=dT, m=m), drawn))
    motion = calibration.correct(y, dT=dT)
    own = [found.names.index(name) for name in ("mx", "my", "mz")]
    np.testing.assert_allclose(found.value[:, own], m, rtol=1e-12)
    np.testing.assert_allclose((motion.m - m).std(axis=0), found.std[:, own], rtol=0.05)
    scatter = (heading(motion.f, motion.m) - heading(f, m)).std(axis=0)
    assert found.heading_std is not None
    np.testing.assert_allclose(scatter, found.heading_std, rtol=0.05)
    # The shares of the groups of coefficients explain the whole variance.
    assert np.allclose(sum(found.groups.values(), np.zeros(1)), 1)


def test_heading_grows_as_one_over_the_cosine_of_the_dip_and_ignores_a_common_scale():
    calibration = calibrated(nine_axes(), np.eye(3), np.zeros(3))
    names = calibration.sensor.coefficients
    bias = [name.endswith(".bias") and name[0] == "m" for name in names]
    alone = replace(calibration, covariance=1e-14 * np.diag(np.array(bias, dtype=float)))
    for dip in np.radians([0, 60, 80]):
        f, m = level_attitudes(0.0, float(dip), 50e-6, G0)
        found = np.array(alone.predict(f, m=m).heading_std)
        np.testing.assert_allclose(found, 1e-7 / 50e-6 / np.cos(dip), rtol=1e-9)
    scale = np.array([name.endswith(".scale") and name[0] == "m" for name in names])
    common = replace(calibration, covariance=1e-4 * np.outer(scale, scale).astype(float))
    f, m = level_attitudes(np.radians(15), np.radians(65), 50e-6, G0)
    np.testing.assert_allclose(np.linalg.norm(m, axis=1), 50e-6)
    # The terms of the variance, 1e-4, cancel up to their rounding.
    found = np.array(common.predict(f, m=m).heading_std)
    np.testing.assert_allclose(found, 0, atol=1e-2 * np.sqrt(np.finfo(float).eps))


@pytest.mark.parametrize("tilt", [0.0, 0.3])
def test_level_attitudes_keep_the_dip_and_reach_the_tilt(tilt: float):
    f, m = level_attitudes(tilt, 1.1, 50e-6, G0)
    np.testing.assert_allclose(np.sum(f * m, axis=1), -G0 * 50e-6 * np.sin(1.1), rtol=1e-12)
    np.testing.assert_allclose(f[:, 2], G0 * np.cos(tilt), rtol=1e-12)


def test_the_heading_needs_a_vertical_and_a_horizontal_field():
    calibration = calibrated(nine_axes(), D, OFFSET)
    found = calibration.predict([[0, 0, 0], [0, 0, G0]], m=[0, 0, -5e-5]).heading_std
    assert found is not None
    assert np.isnan(found).all()
    gyros_and_field = calibration.sensor.select_axes("w", "m")
    keep = [calibration.sensor.coefficients.index(n) for n in gyros_and_field.coefficients]
    part = replace(
        calibration, sensor=gyros_and_field, values=calibration.values[keep],
        covariance=calibration.covariance[np.ix_(keep, keep)],
    )  # fmt: skip
    assert part.predict(m=FIELD * 1e-6).heading_std is None


def test_a_sensor_without_magnetometers_refuses_a_field_and_states_none():
    sensor = imu().with_coefficients("bias")
    calibration = replace(
        calibrated(nine_axes(), D, OFFSET), sensor=sensor, values=np.zeros(6),
        covariance=1e-12 * np.eye(6),
    )  # fmt: skip
    assert calibration.predict(UP).m is None
    with refused(InputError, key="m"):
        calibration.predict(UP, m=[1e-5, 0, 0])


def test_d_is_split_into_the_shape_and_the_rotation_of_the_worked_example():
    calibration = calibrated(nine_axes(), D, OFFSET)
    found = split_matrix(field_matrix(calibration.sensor, calibration.values))
    np.testing.assert_allclose(found.matrix, D, atol=1e-15)
    np.testing.assert_allclose(
        np.linalg.inv(found.shape),
        [[0.979902, -0.009181, 0.000756], [-0.009181, 1.030190, -0.006171],
         [0.000756, -0.006171, 0.951875]], atol=1e-6,
    )  # fmt: skip
    np.testing.assert_allclose(np.degrees(found.rotation), [-1.99, -1.12, -1.15], atol=5e-3)
    np.testing.assert_array_equal(found.axes, np.eye(3))
    left = np.array([[0, 1, 0], [1, 0, 0], [0, 0, 1]])  # exchanged axes are left-handed
    mirrored = split_matrix(left @ D)
    np.testing.assert_array_equal(mirrored.axes, left)
    np.testing.assert_allclose(mirrored.rotation, found.rotation, atol=1e-12)


def test_predict_states_fields_in_microtesla_with_one_unit_for_all(tmp_path: Path):
    path = tmp_path / "nine.calibration.json"
    save(calibrated(nine_axes(), D, OFFSET), path)
    at = "f = 0, 0, 1 g; m = 20, 5, -40 µT; T = 20 °C"
    done = run_program("predict", path, "--at", at, "--json")
    stated = json.loads(done.output)
    np.testing.assert_allclose(stated["value"][0][6:], FIELD * 1e-6, rtol=1e-12)
    np.testing.assert_allclose(stated["raw_error"][0][6:], (READING - FIELD) * 1e-6, rtol=1e-9)
    apart = run_program("predict", path, "--at", at.replace("20, 5,", "20 µT, 5000 nT,"), "--json")
    assert json.loads(apart.output)["heading_std"] == pytest.approx(stated["heading_std"])
    for wrong in ("m = 20, 5, 0", "m = 20, 5 µT, -40", "m = 20, 5, -40 g"):
        failed = run_program("predict", path, "--at", wrong)
        assert (failed.status, failed.error.count("\n")) == (2, 1)
    table = tmp_path / "points.csv"
    table.write_text("fz [g],mx [µT],my [nT],mz [T]\n1,20,5000,-40e-6\n", encoding="utf-8")
    assert run_program("predict", path, "--points", table, "-o", tmp_path / "out.csv").status == 0
    head, row = (tmp_path / "out.csv").read_text(encoding="utf-8").splitlines()
    columns = dict(zip(head.split(","), row.split(","), strict=True))
    expanded = 2 * np.degrees(stated["heading_std"][0])
    assert float(columns["heading U [°]"]) == pytest.approx(expanded, rel=1e-6)
    assert float(columns["mz corrected [µT]"]) == pytest.approx(-40, rel=1e-9)
    page = tmp_path / "sweep.html"
    swept = run_program("predict", path, "--sweep", "mx = -50 µT … 50 µT", "-o", page)
    assert (swept.status, page.is_file()) == (0, True)


def test_a_field_outside_the_range_of_the_data_is_refused_and_survives_the_file(tmp_path: Path):
    calibration = replace(
        calibrated(nine_axes(), D, OFFSET), validity=Validity(field=(-60e-6, 40e-6))
    )
    save(calibration, tmp_path / "nine.calibration.json")
    again = load(tmp_path / "nine.calibration.json")
    assert again.validity == calibration.validity
    again.predict(m=FIELD * 1e-6)
    found = again.predict(m=3 * FIELD * 1e-6, extrapolate=True)
    # The worked example is linear: o + 3 (m − o) reads 76.05 µT along x and −105.25 µT along z.
    (excess,) = found.outside[0]
    assert (excess.part, excess.amount) == ("m", pytest.approx(45.25e-6))
    with refused(InputError, key="m"):
        again.predict(m=3 * FIELD * 1e-6)
