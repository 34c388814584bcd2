"""Exports of magnetometers, applied by formulas from the sources, and imports of their files.

D = P Q: targets with a symmetric matrix apply P⁻¹, so their result is the field turned by Q.
"""

import json
import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from tests.export.calibrations import (
    DISTORTION,
    HARD_IRON,
    MICROTESLA,
    OPTIONS,
    SI,
    magnetometer_readings,
    make_calibration,
    make_magnetometer,
)
from tests.export.test_formulas import SINGLE, matlab, parameters, python, stated
from tests.program import run_program
from tests.refusals import refused

import inercal
from inercal.basics.arrays import Array
from inercal.calibration import Calibration
from inercal.calibration.files import calibration_object
from inercal.export import TARGETS, Export, export_calibration
from inercal.physics.sensors import Readout

READING, TRUE_FIELD = np.array([[33.35, -4.95, -21.75]]), np.array([20.0, 5.0, -40.0])  # µT
SYMMETRIC_FIELD = np.array([20.861, 3.204, -39.743])  # µT, of the worked example
COUNTS = Readout(1.5e7, 6200.0, "LSB")
MAG_OPTIONS = OPTIONS | {"px4": {**OPTIONS["px4"], "mag_id": 396825}}


def symmetric(p: dict[str, float], names: list[str]) -> Array:
    """Return the matrix of a diagonal and the elements 12, 13 and 23."""
    a, b, c, ab, ac, bc = (p[name] for name in names)
    return np.array([[a, ab, ac], [ab, b, bc], [ac, bc, c]])


def px4(text: str, raw: Array) -> Array:
    """Apply S (raw − OFF) in gauss; `raw` and the result are in T."""
    p = parameters(text)
    matrix = symmetric(p, [f"CAL_MAG0_{a}{w}" for w in ("SCALE", "ODIAG") for a in "XYZ"])
    return (raw * 1e4 - [p[f"CAL_MAG0_{a}OFF"] for a in "XYZ"]) @ matrix.T / 1e4


def ardupilot(text: str, raw: Array) -> Array:
    """Apply S (SCALE (raw + OFS)) in milligauss."""
    p = parameters(text)
    matrix = symmetric(p, [f"COMPASS_{w}_{a}" for w in ("DIA", "ODI") for a in "XYZ"])
    scaled = p["COMPASS_SCALE"] * (raw * 1e7 + [p[f"COMPASS_OFS_{a}"] for a in "XYZ"])
    return scaled @ matrix.T / 1e7


def ros(text: str, raw: Array) -> Array:
    yaml = pytest.importorskip("yaml")
    p = yaml.safe_load(text)["/**"]["ros__parameters"]
    assert p["initial_scaling_matrix"] == p["initial_mag_scaling_matrix"]
    matrix = np.array(p["initial_mag_scaling_matrix"]).reshape(3, 3)
    return (raw - [p[f"initial_mag_bias_{a}"] for a in "xyz"]) @ matrix.T


def magcal(text: str, output: Array) -> Array:
    content = json.loads(text)
    return (output - content["b"]) @ np.array(content["A"])


def fusion(text: str, output: Array) -> Array:
    p = {name: float(x) for name, x in re.findall(r"\.(\w+\.\w+) = ([-+.\de]+)f", text)}
    matrix = np.array([[p[f"element.{a}{b}"] for b in "xyz"] for a in "xyz"])
    return (output - [p[f"axis.{a}"] for a in "xyz"]) @ matrix.T


SYMMETRIC: dict[str, Callable[[str, Array], Array]] = {"px4": px4, "ardupilot": ardupilot}
OUTPUT: dict[str, Callable[[str, Array], Array]] = {"magcal": magcal, "fusion": fusion}


def export(calibration: Calibration, to: str, **more: str) -> Export:
    options = (MAG_OPTIONS.get(to) or {}) | more
    return export_calibration(calibration, to, options=options, source="x.calibration.json")


def field(to: str, text: str, calibration: Calibration, output: Array) -> Array:
    """Return the field that a target computes from the output of magnetometers, T."""
    if to in OUTPUT:
        return OUTPUT[to](text, output) / calibration.sensor.axes[-1].readout.scale
    return (SYMMETRIC | {"ros_magnetometer": ros})[to](text, calibration.sensor.to_si(output))


def polar() -> tuple[Array, Array]:
    """Return P and Q of D = P Q, by the singular values."""
    u, s, v = np.linalg.svd(DISTORTION)
    return u * s @ u.T, u @ v


@pytest.mark.parametrize("to", [*OUTPUT, "ros_magnetometer"])
def test_a_full_matrix_gives_the_field_of_the_worked_example(to: str):
    calibration = make_magnetometer()
    found = field(to, export(calibration, to).text, calibration, READING)
    np.testing.assert_allclose(found[0] * 1e6, TRUE_FIELD, rtol=0, atol=40 * SINGLE)


@pytest.mark.parametrize("to", SYMMETRIC)
def test_a_symmetric_matrix_gives_the_turned_field_of_the_worked_example(to: str):
    calibration = make_magnetometer()
    made = export(calibration, to)
    found = field(to, made.text, calibration, READING)
    np.testing.assert_allclose(found[0] * 1e6, SYMMETRIC_FIELD, rtol=0, atol=6e-4)
    (loss,) = made.losses
    assert "(-1.99, -1.12, -1.15) deg" in loss.word
    # The heading of a level sensor errs by 5.3° here, and by at most what is stated.
    headings = [np.degrees(np.arctan2(-v[1], v[0])) for v in (SYMMETRIC_FIELD, TRUE_FIELD)]
    stated_heading = re.search(r"up to (\S+) deg of heading", loss.word)
    assert stated_heading is not None
    assert abs(headings[0] - headings[1]) == pytest.approx(5.3, abs=0.05)
    assert 5.3 < float(stated_heading[1]) < 6.5
    assert made.costs[0].exceeds


@pytest.mark.parametrize("readout", [MICROTESLA, COUNTS], ids=["µT", "counts"])
@pytest.mark.parametrize("to", [*SYMMETRIC, *OUTPUT, "ros_magnetometer"])
def test_a_target_corrects_readings_up_to_the_error_that_it_states(to: str, readout: Readout):
    calibration = make_magnetometer(readout=readout)
    seen = magnetometer_readings(calibration)
    made = export_calibration(
        calibration, to, options=MAG_OPTIONS.get(to), field=(-70e-6, 70e-6), source="x"
    )
    found = field(to, made.text, calibration, seen.output)
    wanted = seen.corrected @ polar()[1].T if to in SYMMETRIC else seen.corrected
    np.testing.assert_allclose(found, wanted, rtol=0, atol=SINGLE * 6200 / 1.5e7)
    error = np.abs(found - seen.corrected).max()
    assert error <= max(1.2 * stated(made.text, "magnetic flux density"), SINGLE * 6200 / 1.5e7)


@pytest.mark.parametrize("to", SYMMETRIC)
def test_axes_front_right_down_take_the_rotated_matrix_and_offset(to: str):
    """Truth by hand: S′ = J S J and o′ = J o with J = diag(1, −1, −1)."""
    calibration = make_magnetometer()
    flip = np.array([1.0, -1.0, -1.0])
    made = export_calibration(calibration, to, options=MAG_OPTIONS.get(to), axes="x -y -z")
    raw = (DISTORTION @ TRUE_FIELD * 1e-6 + HARD_IRON) * flip
    found = SYMMETRIC[to](made.text, raw[None])[0]
    np.testing.assert_allclose(found, polar()[1] @ TRUE_FIELD * 1e-6 * flip, rtol=0, atol=1e-10)


@pytest.mark.slow
@pytest.mark.parametrize("terms", [(), ("bias_dT", "scale_dT")], ids=["linear", "temperature"])
@pytest.mark.parametrize(("to", "inertial"), [("python", True), ("matlab", False)])
def test_code_corrects_nine_axes_exactly(to: str, terms: tuple[str, ...], inertial: bool):
    calibration = make_magnetometer(*terms, inertial=inertial)
    seen = magnetometer_readings(calibration, 2000)
    text = export_calibration(calibration, to, name="imu_7").text
    found = {"python": python, "matlab": matlab}[to](text, seen)
    np.testing.assert_allclose(found[:, -3:], seen.corrected[:, -3:], rtol=0, atol=1e-13)
    np.testing.assert_allclose(found, seen.corrected, rtol=0, atol=1e-8)


@pytest.mark.slow
def test_the_matlab_file_states_a_and_b_of_magcal():
    calibration = make_magnetometer(readout=COUNTS, inertial=True)
    text = export_calibration(calibration, "matlab", name="imu_7").text
    plain = " ".join(re.sub(r"(?m)^% *", "", text).split())
    shown = re.search(r"A = (\S+) \* C\(7:9,7:9\)', b = \[(.*?)\]; expmfs", plain)
    gain = re.search(r"C = \[(.*?)\];", text, flags=re.DOTALL)
    assert shown is not None
    assert gain is not None
    rows = gain[1].replace("...", "").split(";")
    matrix = np.array([[float(x) for x in row.split(",")] for row in rows])[6:, 6:]
    seen = magnetometer_readings(calibration, 100)
    offset = [float(x) for x in shown[2].split(",")]
    found = (seen.output[:, 6:] - offset) @ (float(shown[1]) * matrix.T)
    np.testing.assert_allclose(found / COUNTS.scale, seen.corrected[:, 6:], rtol=0, atol=1e-12)


def test_the_csv_has_the_matrix_of_nine_axes():
    calibration = make_magnetometer(inertial=True)
    seen = magnetometer_readings(calibration, 100)
    rows = [x.split(",") for x in export(calibration, "csv").text.splitlines() if x[0] != "#"]
    matrix = np.array([float(r[3]) for r in rows if r[0] == "C"]).reshape(9, 9)
    offset = np.array([float(r[3]) for r in rows if r[0] == "offset"])
    found = (seen.output - offset) @ matrix.T
    np.testing.assert_allclose(found[:, 6:], seen.corrected[:, 6:], rtol=0, atol=1e-13)
    assert {r[5] for r in rows if r[:2] == ["C", "mx"]} == {
        *("(T)/(m/s^2)", "(T)/(rad/s)", "(T)/(uT)")
    }


@pytest.mark.slow
def test_flight_controllers_take_all_three_kinds_in_one_file():
    calibration = make_magnetometer(inertial=True)
    alone, inertial = make_magnetometer(), make_calibration(readouts=SI)
    for to in SYMMETRIC:
        together = parameters(export(calibration, to).text)
        apart = parameters(export(alone, to).text) | parameters(export(inertial, to).text)
        assert together == apart


@pytest.mark.usefixtures("few_samples")
@pytest.mark.parametrize("to", list(TARGETS))
def test_every_target_takes_magnetometers_or_says_that_it_leaves_them_out(to: str):
    calibration = make_magnetometer(inertial=True)
    options = MAG_OPTIONS.get(to) or ({"lsb": 1e-3} if to == "c_fixed" else None)
    made = export_calibration(calibration, to, options=options)
    kinds = {one.measures for one in made.costs}
    header = " ".join("\n".join(made.header).split())
    sha256 = calibration_object(calibration)["sha256"]
    assert sha256 in header.replace(" ", "") or sha256 in header
    if kinds == {"f", "w", "m"}:
        assert made.left_out == ""
        return
    missing = "mx, my, mz" if "m" not in kinds else "ax, ay, az, gx, gy, gz"
    assert made.left_out.endswith(missing)
    assert f"NOT in this file: {made.left_out}" in header
    with refused(key="--lossless"):
        export_calibration(calibration, to, options=options, lossless=True)
    alone = make_calibration() if kinds == {"m"} else make_magnetometer()
    with refused(key="--to"):
        export_calibration(alone, to, options=options)
    if kinds != {"m"}:
        inertial = export_calibration(make_calibration(), to, options=options)
        assert [one.largest for one in made.costs] == [one.largest for one in inertial.costs]


def turned(degrees: float) -> Array:
    angle = np.radians(degrees)
    c, s = np.cos(angle), np.sin(angle)
    return polar()[1].T @ np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


@pytest.mark.parametrize("to", SYMMETRIC)
def test_a_rotation_above_the_limit_is_refused_unless_accepted(to: str):
    assert export(make_magnetometer(turn=turned(4.9)), to).losses
    large = make_magnetometer(turn=turned(5.1))
    with refused(key="--set", names=("max_rotation",)):
        export(large, to)
    (loss,) = export(large, to, max_rotation="6 deg").losses
    assert "5.10) deg" in loss.word
    # Without a rotation, the symmetric matrix is the complete calibration.
    exact = export(make_magnetometer(turn=turned(0.0)), to)
    assert exact.losses == ()
    assert not exact.costs[0].exceeds


def test_parameters_beyond_what_a_target_accepts_are_refused():
    calibration = make_magnetometer()
    size = len(calibration.values)

    def with_values(**values: float) -> Calibration:
        names = calibration.sensor.coefficients
        chosen = {name.replace(".", "_"): k for k, name in enumerate(names)}
        c = calibration.values.copy()
        c[[chosen[name] for name in values]] = list(values.values())
        return inercal.Calibration(calibration.sensor, c, np.eye(size) * 1e-16)

    with refused(names=("COMPASS_OFS_X",)):
        export(with_values(mx_bias=-181e-6), "ardupilot")
    assert export(with_values(mx_bias=-181e-6), "ardupilot", offset_max="2000").text
    # [0.51 0.44; 0.44 0.51] in x and y has an inverse with 7.7 on its diagonal.
    narrow = dict.fromkeys((f"m{a}_{d}" for a in "xyz" for d in ("delta_o", "delta_p")), 0.0)
    narrow |= {"mx_scale": -0.49, "my_scale": -0.49, "mx_delta_o": 0.44, "my_delta_p": -0.44}
    for to, name in (("px4", "CAL_MAG0_XSCALE"), ("ardupilot", "COMPASS_DIA_X")):
        with refused(names=(name,)):
            export(with_values(**narrow), to)


@pytest.mark.parametrize("to", [*SYMMETRIC, "magcal", "ros_magnetometer"])
def test_what_an_export_holds_is_read_back(to: str, tmp_path: Path):
    calibration = make_magnetometer()
    path = tmp_path / "mag.txt"
    path.write_text(export(calibration, to).text, encoding="utf-8")
    for like in (None, calibration):
        found = inercal.import_calibration(path, to, like=like)
        matrix = polar()[0] if to in SYMMETRIC else DISTORTION
        raw = (matrix @ TRUE_FIELD * 1e-6 + HARD_IRON)[None]
        motion = found.correct(found.sensor.to_output(raw))
        np.testing.assert_allclose(motion.m[0], TRUE_FIELD * 1e-6, rtol=0, atol=1e-11)
        assert not found.states_uncertainty


def test_imports_follow_the_formulas_of_their_programs(tmp_path: Path):
    """Truth by hand: readings and fields in the units of the programs."""
    path = tmp_path / "board.param"
    path.write_text(
        "COMPASS_OFS_X,-120\nCOMPASS_OFS_Y,0\nCOMPASS_OFS_Z,50\nCOMPASS_SCALE,1.25\n"
        "COMPASS_DIA_X,0.8\nCOMPASS_DIA_Y,1\nCOMPASS_DIA_Z,1\nCOMPASS_ODI_X,0.1\n"
    )
    found = inercal.import_calibration(path, "ardupilot")
    # 1.25 (200, 300, 100) mG = (250, 375, 125) mG, then the matrix.
    motion = found.correct(np.array([[320e-7, 300e-7, 50e-7]]))
    np.testing.assert_allclose(motion.m[0], np.array([237.5, 400, 125]) * 1e-7, rtol=1e-12)
    path = tmp_path / "mag.json"
    path.write_text(
        json.dumps({"A": np.diag([1.2, 1, 0.8]).tolist(), "b": [[5, 6, 7]], "expmfs": 45})
    )
    with refused(file="mag.json"):
        inercal.import_calibration(path, "magcal", options={"unit": "LSB"})
    like = make_magnetometer(readout=Readout(1.5e6, 0.0, "LSB"))
    options = {"unit": "LSB", "field": "30 µT"}
    found = inercal.import_calibration(path, "magcal", like=like, options=options)
    motion = found.correct(np.array([[15.0, 26.0, 67.0]]))
    np.testing.assert_allclose(motion.m[0], np.array([12, 20, 48]) * 30e-6 / 45, rtol=1e-12)


@pytest.mark.slow
def test_magnetometers_of_an_autopilot_are_left_out_for_a_sensor_without(tmp_path: Path):
    path = tmp_path / "board.params"
    path.write_text(export(make_magnetometer(inertial=True), "px4").text, encoding="utf-8")
    found = inercal.import_calibration(path, "px4", like=make_calibration())
    assert [axis.measures for axis in found.sensor.axes] == [*"fffwww"]
    assert any("magnetometers" in note for note in found.notes)
    assert len(inercal.import_calibration(path, "px4").sensor.axes) == 9


@pytest.mark.parametrize(
    ("of", "text"),
    [
        ("px4", "CAL_MAG0_XOFF 0.1\nCAL_MAG0_XSCALE 0\n"),
        ("px4", "CAL_MAG0_XOFF 0.1\nCAL_MAG0_XODIAG 2\n"),
        ("ardupilot", "COMPASS_OFS_X,10\nCOMPASS_DIA_X,-1\n"),
        ("magcal", "{}"),
        ("magcal", "[1]"),
        ("magcal", "[" * 100_000),
        ("magcal", '{"A": [[1, 2], [3, 4]], "b": [1, 2]}'),
        ("magcal", '{"A": [[1, 0, 0], [0, 1, 0], [1, 1, 0]], "b": [0, 0, 0]}'),
        ("magcal", '{"A": [[1, 0, 0], [0, 1, 0], [0, 0, NaN]], "b": [0, 0, 0]}'),
        ("ros_magnetometer", "a: 1"),
        ("ros_magnetometer", "initial_mag_bias_x: 1e-6\ninitial_mag_scaling_matrix: [1, 2]"),
        (
            "ros_magnetometer",
            "initial_mag_bias_x: 1e-6\ninitial_scaling_matrix: [1,0,0,0,0,0,0,0,0]",
        ),
        ("ros_magnetometer", "initial_mag_bias_x: e--"),
    ],
)
def test_a_file_that_states_no_calibration_is_refused_by_name(of: str, text: str, tmp_path: Path):
    path = tmp_path / "file"
    path.write_text(text, encoding="utf-8")
    with refused(file="file"):
        inercal.import_calibration(path, of)


def test_the_verb_prints_the_rotation_and_what_is_left_out(tmp_path: Path):
    own = inercal.save(make_magnetometer(inertial=True), tmp_path / "own.calibration.json")
    out = tmp_path / "a.params"
    arguments = ("export", own, "--out", out, "--over-field", "-60 60 µT")
    ids = [x for name in ("acc_id", "gyro_id", "mag_id") for x in ("--set", f"{name}=7")]
    ended = run_program(*arguments, "--to", "px4", *ids)
    assert ended.status == 0
    assert "(-1.99, -1.12, -1.15) deg" in ended.output
    assert "µT" in ended.output
    ended = run_program(*arguments, "--to", "vectornav", "--force", "--json")
    assert json.loads(ended.output)["left_out"].endswith("mx, my, mz")
    assert run_program("export", own, "--to", "magcal", "--over-field", "1 2 g").status == 2
