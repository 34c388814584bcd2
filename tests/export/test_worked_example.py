"""Exports of one sensor against numbers that were worked out without inercal.

M, b, G, A and b_g are stated; L, Q, L_g, C_g, C, C b, T and K were computed in plain numpy and put
back. Orders of temperature that the tables lack are added, as a later version may.
"""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from tests.export.calibrations import NOISE
from tests.export.test_formulas import parameters, stated_turn

import inercal
from inercal.calibration import Calibration, Validity
from inercal.export import export_calibration
from inercal.physics.sensors import TABLES, imu
from inercal.physics.sensors.coefficient_tables import TERMS, Basis, ErrorTerm

M = np.array([[1.0012, 0.0030, -0.0021], [-0.0018, 0.9985, 0.0007], [0.0026, -0.0011, 1.0020]])
B = np.array([0.12, -0.08, 0.25])
G = np.array([[1.0005, 0.0010, 0.0004], [-0.0012, 0.9990, 0.0020], [0.0003, -0.0015, 1.0010]])
A = 1e-5 * np.array([[3.0, 1.0, 0.0], [0.0, -2.0, 1.0], [2.0, 0.0, 4.0]])
B_G = np.array([0.010, -0.020, 0.005])


def example() -> Calibration:
    sensor = imu("example").with_coefficients("bias", "scale", "misalignment", "g")
    values: dict[str, float] = {}
    for k, axis in enumerate(sensor.axes):
        matrix, bias = (M, B) if axis.measures == "f" else (G, B_G)
        names = ("k0", "k1") if axis.measures == "f" else ("bias", "scale")
        i, p, o = axis.frame
        row = matrix[k % 3]
        values |= {
            f"{axis.name}.{names[0]}": bias[k % 3],
            f"{axis.name}.{names[1]}": row @ i - 1,
            f"{axis.name}.delta_o": row @ p,
            f"{axis.name}.delta_p": -row @ o,
        }
        if axis.measures == "w":
            values |= {
                f"{axis.name}.g_{n}": A[k % 3] @ v for n, v in zip("ipo", axis.frame, strict=True)
            }
    c = np.array([values[name] for name in sensor.coefficients])
    return Calibration(sensor, c, np.eye(c.size) * 1e-12)


def test_the_reading_of_the_example_is_that_of_the_note():
    motion = example().correct(np.array([[1.1083, 1.9215, 9.2684, 0.11002, -0.21927, 0.30601]]))
    np.testing.assert_allclose(motion.f[0], [1, 2, 9], atol=1e-9)
    np.testing.assert_allclose(motion.w[0], [0.1, -0.2, 0.3], atol=2e-6)


@pytest.mark.parametrize("to", ["kalibr", "openvins"])
def test_matrices_of_kalibr(to: str):
    yaml = pytest.importorskip("yaml")
    text = export_calibration(example(), to, options=NOISE).text
    one = yaml.safe_load(text.removeprefix("%YAML:1.0\n"))["imu0"]
    lower = [
        [1.001206697, 0, 0],
        [0.001190434, 0.998501158, 0],
        [0.000495023, -0.000402823, 1.002003774],
    ]
    lower_g = [
        [1.00050058, 0, 0],
        [-0.0002007, 0.999002703, 0],
        [0.0006987, 0.000503783, 1.001000798],
    ]
    a = 1e-6 * np.array([[30.01, 9.97, -0.032], [-0.016, -19.98, 10.04], [20.016, 0.06, 39.992]])
    turn_g = [
        [0, -0.001995136, 0.002498668],
        [0.001991886, 0, 0.001302709],
        [-0.00250126, -0.001297725, 0],
    ]
    if to == "kalibr":
        found = one["accelerometers"]["M"], one["gyroscopes"]["M"], one["gyroscopes"]["C_gyro_i"]
        np.testing.assert_allclose(one["gyroscopes"]["A"], a, atol=1e-8)
    else:
        found = one["Ta"], one["Tw"], one["R_IMUtoGYRO"]
        # Tg acts on the force of the IMU frame: Kalibr's A turned back.
        np.testing.assert_allclose(one["Tg"], a @ np.array(found[2]), atol=1e-8)
    np.testing.assert_allclose(found[0], lower, atol=6e-10)
    np.testing.assert_allclose(found[1], lower_g, atol=6e-10)
    np.testing.assert_allclose(np.array(found[2]) - np.diag(np.diag(found[2])), turn_g, atol=6e-10)
    turn = stated_turn(text)
    assert turn[0, 1] == pytest.approx(0.002996, abs=6e-7)
    assert turn[2, 0] == pytest.approx(0.0021, abs=6e-7)


@pytest.mark.slow
def test_numbers_of_imu_calib_px4_and_imu_tk():
    yaml = pytest.importorskip("yaml")
    content = yaml.safe_load(export_calibration(example(), "imu_calib").text)
    assert content["SM"][:3] == pytest.approx([0.998790606, -0.002998565, 0.002095369], abs=6e-10)
    assert content["bias"] == pytest.approx([0.120618600, -0.080077373, 0.249100106], abs=6e-10)
    p = parameters(export_calibration(example(), "px4", options={"acc_id": 1, "gyro_id": 2}).text)
    scale = [p[f"CAL_ACC0_{a}SCALE"] for a in "XYZ"]
    assert scale == pytest.approx([0.998801438, 1.001502253, 0.998003992], abs=6e-9)
    residual = (np.array([1.1083, 1.9215, 9.2684]) - B) * scale - [1, 2, 9]
    np.testing.assert_allclose(residual, [-0.01288, 0.00451, 0.00040], atol=6e-6)
    words = export_calibration(example(), "imu_tk").text.split()
    numbers = [float(word) for word in words[:21]]
    assert numbers[1:4] == pytest.approx([-0.002994085, 0.002099572, 0.001804522], abs=6e-10)
    assert numbers[9::4][:3] == pytest.approx([0.998790606, 1.001496072, 0.997997791], abs=6e-10)
    one = json.loads(export_calibration(example(), "imucal").text)
    np.testing.assert_allclose(one["R_a"], M, rtol=0, atol=1e-15)


def with_temperature(*powers: float) -> Calibration:
    names = ["k0", *(f"k0_dT{k if k > 1 else ''}" for k in range(1, len(powers) + 1))]
    sensor = imu("warm").with_coefficients(*names)
    c = np.zeros(len(sensor.coefficients))
    for name, value in zip(names, (0.1, *powers), strict=True):
        c[sensor.coefficients.index(f"ax.{name}")] = value
    span = Validity(temperature=(263.15, 333.15))
    return Calibration(sensor, c, np.eye(c.size) * 1e-12, validity=span)


def test_terms_of_ardupilot_about_35_degrees():
    text = export_calibration(with_temperature(2e-3, -1e-5), "ardupilot").text
    p = parameters(text)
    assert p["INS_TCAL1_ACC1_X"] == pytest.approx(1700, rel=1e-6)
    assert p["INS_TCAL1_ACC2_X"] == pytest.approx(-10, rel=1e-6)
    assert p["INS_ACC1_CALTEMP"] == 20
    assert (p["INS_TCAL1_TMIN"], p["INS_TCAL1_TMAX"]) == (-10, 60)


@pytest.mark.slow
def test_an_order_of_temperature_that_is_added_to_the_tables_is_exported_and_read(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
):
    added = [
        ErrorTerm(f"k0_dT{k}", "", "µg/K²", 1e-6, Basis(" ".join(["dT"] * k)), "", "temperature")
        for k in (3, 4)
    ]
    monkeypatch.setitem(TABLES, "f", (*(t for t in TABLES["f"] if t.name not in
                                        ("k0_dT3", "k0_dT4")), *added))  # fmt: skip
    monkeypatch.setitem(TERMS, "f", {one.name: one for one in TABLES["f"]})  # as at import
    calibration = with_temperature(2e-3, -1e-5, 3e-7)
    ids = {"acc_id": 1, "gyro_id": 2}
    for to, options in (("px4", ids), ("ardupilot", None)):
        made = export_calibration(calibration, to, options=options)
        assert made.costs[0].largest < 1e-6  # single precision
        path = tmp_path / f"board{made.target.suffix}"
        path.write_text(made.text, encoding="utf-8")
        found = inercal.import_calibration(path, to)
        for name, value in (("k0_dT", 2e-3), ("k0_dT2", -1e-5), ("k0_dT3", 3e-7)):
            assert found.value(f"ax.{name}") == pytest.approx(value, rel=1e-5)
    # Order 4 is beyond both: it is named, and its error is stated.
    made = export_calibration(with_temperature(2e-3, -1e-5, 3e-7, 1e-9), "px4", options=ids)
    assert "ax.k0_dT4" in made.losses[0].names
    assert made.costs[0].largest == pytest.approx(1e-9 * 40.0**4, rel=1e-3)
    assert export_calibration(with_temperature(0, 0, 0, 1e-9), "c").losses == ()


def test_a_calibration_that_is_not_to_be_relied_on_says_so_in_every_file():
    from inercal.calibration.grade import Verdict

    verdict = Verdict("unreliable", ("the scatter is five times the stated one",))
    made = export_calibration(replace(example(), verdict=verdict), "c")
    assert any(line.startswith("NOT TO BE RELIED ON") for line in made.header)
    assert "NOT TO BE RELIED ON" in made.text
