"""Files of RealSense, Basalt and Kalibr as these programs write them, by their own formulas."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.export.calibrations import NOISE, make_calibration, random_readings
from tests.program import run_program

import inercal
from inercal.basics.arrays import Array
from inercal.export import export_calibration

ROOT = Path(__file__).parents[2]
PRINTED = ROOT / "examples" / "export" / "results-imucam.txt"
READINGS = np.random.default_rng(3).uniform(-1, 1, (10_000, 6)) * ([20.0] * 3 + [2.0] * 3)


def by_columns(numbers: list[float], vector: Array) -> Array:
    """Multiply as float3x3 of librealsense does: its three members are the columns."""
    x, y, z = np.array(numbers).reshape(3, 3)
    return vector[:, :1] * x + vector[:, 1:2] * y + vector[:, 2:] * z


def test_the_camera_corrects_with_the_numbers_of_an_export():
    calibration = make_calibration("bias", "scale", "misalignment")
    seen = random_readings(calibration)
    imu = json.loads(export_calibration(calibration, "realsense").text)["imus"][0]
    for k, name in enumerate(("accelerometer", "gyroscope")):
        columns = slice(3 * k, 3 * k + 3)
        one = imu[name]
        found = by_columns(one["scale_and_alignment"], seen.output[:, columns]) - one["bias"]
        np.testing.assert_allclose(found, seen.corrected[:, columns], rtol=0, atol=1e-10)


def test_the_result_of_the_tool_of_realsense_is_read(tmp_path: Path):
    """Fit six positions as the tool does: [a, −1] X = g, and X by rows in the file."""
    g, rng = 9.80665, np.random.default_rng(5)
    matrix = np.eye(3) + rng.normal(size=(3, 3)) * 0.01
    truth = np.concatenate([g * np.eye(3), -g * np.eye(3)])
    seen = truth @ matrix.T + [0.1, -0.2, 0.3]
    columns = np.column_stack([seen, -np.ones(6)])
    solved = np.linalg.lstsq(columns, truth, rcond=None)[0]
    bias = [0.01, -0.02, 0.03]
    accelerometer = {
        "scale_and_alignment": solved.ravel()[:9].tolist(),
        "bias": solved.ravel()[9:].tolist(),
    }
    gyroscope = {"scale_and_alignment": np.eye(3).ravel().tolist(), "bias": bias}
    content: dict[str, Any] = {"device_type": "D435i"}
    content["imus"] = [{"accelerometer": accelerometer, "gyroscope": gyroscope}]
    path = tmp_path / "calibration.json"
    path.write_text(json.dumps(content, indent=4, sort_keys=True), encoding="utf-8")
    found = inercal.import_calibration(path, "realsense")
    motion = found.correct(READINGS)
    wanted = READINGS[:, :3] @ solved[:3] - solved[3]
    np.testing.assert_allclose(motion.f, wanted, rtol=0, atol=1e-11)
    np.testing.assert_allclose(motion.w, READINGS[:, 3:] - bias, rtol=0, atol=1e-14)
    row = [found.value(f"ax.{name}") for name in ("k1", "delta_o", "delta_p")]
    np.testing.assert_allclose(row, (matrix[0] - [1, 0, 0]) * [1, 1, -1], rtol=0, atol=1e-12)
    gyros = [name for name in found.sensor.coefficients if name.startswith("g")]
    assert gyros == ["gx.bias", "gy.bias", "gz.bias"]


def test_a_gyro_alone_leaves_the_accelerometer_of_the_camera_as_it_is():
    calibration = make_calibration("bias", "scale")
    own = calibration.sensor
    part = inercal.Calibration(
        own.select_axes("w"),
        calibration.values[6:],
        np.eye(6) * 1e-12,
        validity=calibration.validity,
    )
    assert part.sensor.coefficients == own.coefficients[6:]
    imu = json.loads(export_calibration(part, "realsense").text)["imus"][0]["accelerometer"]
    assert imu == {"scale_and_alignment": np.eye(3).ravel().tolist(), "bias": [0.0] * 3}


def test_a_calibration_of_basalt_is_read(tmp_path: Path):
    """The parameters of getBiasAndScale, written out by hand."""
    acc = [0.1, -0.2, 0.3, 0.01, 0.002, -0.003, -0.02, 0.004, 0.03]
    gyro = [0.01, -0.02, 0.03, *(1e-3 * np.arange(1, 10)).tolist()]
    path = tmp_path / "calibration.json"
    content = {"value0": {"calib_accel_bias": acc, "calib_gyro_bias": gyro, "T_imu_cam": []}}
    path.write_text(json.dumps(content), encoding="utf-8")
    found = inercal.import_calibration(path, "basalt")
    assert found.frame == "triangular"
    motion = found.correct(READINGS)
    scale = np.array([[0.01, 0, 0], [0.002, -0.02, 0], [-0.003, 0.004, 0.03]])
    scale_g = np.array([[1, 4, 7], [2, 5, 8], [3, 6, 9]]) * 1e-3
    f, w = READINGS[:, :3], READINGS[:, 3:]
    np.testing.assert_allclose(motion.f, f + f @ scale.T - acc[:3], rtol=0, atol=1e-11)
    np.testing.assert_allclose(motion.w, w + w @ scale_g.T - gyro[:3], rtol=0, atol=1e-12)


def test_basalt_states_the_noise_in_continuous_time():
    calibration = make_calibration()
    one = json.loads(export_calibration(calibration, "basalt", options=NOISE).text)["value0"]
    assert one["imu_update_rate"] == 200
    stated = [
        one[f"{name}_std"] for name in ("accel_noise", "accel_bias", "gyro_noise", "gyro_bias")
    ]
    assert stated == [[NOISE[name]] * 3 for name in list(NOISE)[:4]]


def kalibr_correction(one: dict[str, Any], y: Array) -> Array:
    """Invert y = M f, y_g = M_g C ω + A C f."""
    gyros = {name: np.array(rows) for name, rows in one["gyroscopes"].items()}
    f = np.linalg.solve(np.array(one["accelerometers"]["M"]), y[:, :3].T)
    rest = y[:, 3:].T - gyros["A"] @ gyros["C_gyro_i"] @ f
    w = np.linalg.solve(gyros["M"] @ gyros["C_gyro_i"], rest)
    return np.vstack([f, w]).T.astype(float)


def printed() -> dict[str, Any]:
    """Return the matrices of the example, whose lines are found by their numbers."""
    lines = PRINTED.read_text(encoding="utf-8").splitlines()

    def rows(label: str, place: int) -> list[list[float]]:
        first = [k for k, line in enumerate(lines) if line.strip().startswith(label)][place] + 1
        return [[float(x) for x in line.strip(" []").split()] for line in lines[first : first + 3]]

    gyroscopes = {"M": rows("M:", 0), "A": rows("A [", 0), "C_gyro_i": rows("C_gyro_i:", 0)}
    return {"gyroscopes": gyroscopes, "accelerometers": {"M": rows("M:", 1)}}


def test_a_printed_result_of_kalibr_is_the_calibration_of_its_yaml(tmp_path: Path):
    found = inercal.import_calibration(PRINTED, "kalibr")
    motion = found.correct(READINGS)
    wanted = kalibr_correction(printed(), READINGS)
    np.testing.assert_allclose(np.hstack([motion.f, motion.w]), wanted, rtol=0, atol=1e-10)
    yaml = pytest.importorskip("yaml")
    path = tmp_path / "imu.yaml"
    one: dict[str, Any] = {**printed(), "model": "scale-misalignment"}
    one["accelerometers"]["ry_i"] = [0.001, -0.002, 0.0]
    path.write_text(yaml.safe_dump({"imu0": one}), encoding="utf-8")
    same = inercal.import_calibration(path, "kalibr")
    assert same.sensor.coefficients == found.sensor.coefficients
    np.testing.assert_array_equal(same.values, found.values)
    (note,) = (note for note in same.notes if "size effect" in note)
    assert "0.001, -0.002" in note


def test_a_recording_is_corrected_with_a_result_of_kalibr_and_the_missing_u_is_said(
    tmp_path: Path,
):
    rng = np.random.default_rng(1)
    y = [1.0, 2.0, 9.5, 1e-3, -2e-3, 3e-3] + rng.normal(size=(300, 6)) * 1e-3
    table = np.column_stack([np.arange(300) * 0.01, y])
    head = "time,ax,ay,az,gx,gy,gz"
    np.savetxt(tmp_path / "log.csv", table, "%.9g", ",", header=head, comments="")
    run = tmp_path / "run.toml"
    run.write_text(
        '[sensor]\nname = "imu"\n[sensor.accelerometer]\nunit = "m/s^2"\n[sensor.gyro]\n'
        'unit = "rad/s"\n[bench]\nkind = "hand"\ngravity = "9.81 m/s² ± 0.1 mm/s²"\n'
        '[method]\nname = "multi_position"\n[data]\nfile = "log.csv"\ntime = "time"\n'
        'accelerometer = ["ax", "ay", "az"]\ngyro = ["gx", "gy", "gz"]\n',
        encoding="utf-8",
    )
    calibration, out = tmp_path / "kalibr.calibration.json", tmp_path / "out.csv"
    ended = run_program("import", PRINTED, "--from", "kalibr", "--out", calibration)
    assert ended.status == 0, ended.error
    assert "without covariance" in ended.output
    ended = run_program("apply", calibration, run, "--out", out)
    assert ended.status == 0, ended.error
    assert "without covariance" in ended.output
    corrected = np.loadtxt(out, delimiter=",", skiprows=1)[:, 1:]
    np.testing.assert_allclose(corrected, kalibr_correction(printed(), y), rtol=0, atol=2e-8)
