"""Calibrations of other programs, read: round trips, and files that are none."""

import json
from pathlib import Path

import numpy as np
import pytest
from tests.export.calibrations import (
    COUNTS,
    LINEAR,
    OPTIONS,
    make_calibration,
    make_magnetometer,
)
from tests.program import run_program
from tests.refusals import refused

import inercal
from inercal.calibration import Calibration
from inercal.calibration.comparison import compare
from inercal.calibration.comparison.run_to_run import comparison_lines
from inercal.calibration.display import coefficient_lines
from inercal.export import export_calibration
from inercal.export.readers import READERS

# Aliases of aliases: 10⁹ numbers, if an array were made of them.
BOMB = "a: &a [1,1,1,1,1,1,1,1,1,1]\n" + "".join(
    f"{new}: &{new} [{','.join([f'*{old}'] * 10)}]\n"
    for old, new in zip("abcdefgh", "bcdefghi", strict=True)
)
BOMB += "imu0:\n  accelerometers: {M: *i}\n  gyroscopes: {M: *i, A: *i, C_gyro_i: *i}\n"
STATED = {
    "imucal": ("bias", "scale", "misalignment", "g"),
    "kalibr": ("scale", "misalignment", "g"),
    "basalt": ("bias", "scale", "misalignment"),
    "realsense": ("bias", "scale", "misalignment"),
    "px4": ("k0", "k1", "bias", "k0_dT", "k0_dT2", "bias_dT"),
    "ardupilot": ("k0", "k1", "bias", "k0_dT", "k0_dT2", "bias_dT"),
    "imu_tk": ("k0", "k1", "delta_o", "delta_p"),
}
TRIANGULAR = ("kalibr", "basalt")


def round_trip(folder: Path, calibration: Calibration, to: str) -> Calibration:
    made = export_calibration(calibration, to, options=OPTIONS.get(to))
    path = folder / f"sensor{made.target.suffix}"
    path.write_text(made.text, encoding="utf-8")
    return inercal.import_calibration(path, to, like=calibration)


@pytest.mark.parametrize("to", STATED)
def test_what_an_export_holds_is_read_back(to: str, tmp_path: Path):
    if to == "kalibr":
        pytest.importorskip("yaml")
    names = STATED[to]
    calibration = make_calibration(*names, *(LINEAR if to == "imu_tk" else ()))
    found = round_trip(tmp_path, calibration, to)
    wanted = calibration.in_frame("triangular") if to in TRIANGULAR else calibration
    both = set(found.sensor.coefficients) & set(wanted.sensor.coefficients)
    measured = {n for n in calibration.sensor.coefficients if to != "imu_tk" or n.startswith("a")}
    assert both == measured
    scale = dict(zip(wanted.sensor.coefficients, wanted.sensor.unit_scale, strict=True))
    for name in both:
        # Single precision of numbers near 1 where the target has it.
        assert abs(found.value(name) - wanted.value(name)) <= 1.3e-7 * scale[name]
    assert not found.states_uncertainty
    assert all(line.expanded == "" for line in coefficient_lines(found))
    compared = compare(calibration, found)
    # Of two without uncertainties there is no verdict; of one there is.
    silent = comparison_lines(compare(found, found))
    assert not any("|E_n|" in line for line in silent)
    assert any("|E_n|" in line for line in comparison_lines(compared))
    # Along the frame of Kalibr some misalignments are 0 by definition.
    assert len(compared.names) >= len(both) - 3
    assert np.nanmax(np.abs(compared.normalised_errors)) < 0.02


@pytest.mark.usefixtures("few_samples")
@pytest.mark.parametrize("axes", ["x -y -z", "y z x"])
@pytest.mark.parametrize("to", READERS)
def test_turned_axes_of_an_export_are_turned_back(to: str, axes: str, tmp_path: Path):
    if to == "kalibr":
        pytest.importorskip("yaml")
    magnetic = to in ("magcal", "ros_magnetometer")
    calibration = make_magnetometer() if magnetic else make_calibration(*STATED.get(to, LINEAR))
    options = OPTIONS.get(to) if to in ("inav", "betaflight") else None
    path = tmp_path / "board.params"

    def read(axes: str, *, explained: bool = True, stated: str | None = None) -> Calibration:
        text = export_calibration(calibration, to, options=OPTIONS.get(to), axes=axes).text
        plain = text.replace("frame: mount", "frame")
        path.write_text(text if explained else plain, encoding="utf-8")
        return inercal.import_calibration(path, to, like=calibration, options=options, axes=stated)

    wanted = read("x y z")
    for found in (read(axes), read(axes, explained=False, stated=axes), read(axes, stated=axes)):
        assert found.sensor.coefficients == wanted.sensor.coefficients
        difference = (found.values - wanted.values) / wanted.sensor.unit_scale
        np.testing.assert_allclose(difference, 0, atol=1e-11)
    with refused(key="--axes"):
        read(axes, stated="x y z")


def test_counts_need_the_readout_of_a_calibration(tmp_path: Path):
    calibration = make_calibration(readouts=COUNTS)
    path = tmp_path / "sensor.json"
    path.write_text(export_calibration(calibration, "imucal").text, encoding="utf-8")
    with refused(key="--like"):
        inercal.import_calibration(path, "imucal")
    found = inercal.import_calibration(path, "imucal", like=calibration)
    assert found.value("ax.k1") == pytest.approx(calibration.value("ax.k1"), abs=1e-12)


def test_imucal_in_its_own_units_is_read(tmp_path: Path):
    """Truth by hand: readings of 2 % too much in g, and degrees per second."""
    eye = np.eye(3).tolist()
    content = {
        "cal_type": "Ferraris", "_format_version": "2.0.0", "acc_unit": "m/s^2",
        "gyr_unit": "deg/s", "from_acc_unit": "g", "from_gyr_unit": "deg/s", "comment": None,
        "K_a": (np.eye(3) * 1.02 / 9.80665).tolist(), "R_a": eye, "b_a": [0.01, 0, 0],
        "K_g": eye, "R_g": eye, "K_ga": np.zeros((3, 3)).tolist(), "b_g": [0, 0.5, 0],
    }  # fmt: skip
    path = tmp_path / "imu.json"
    path.write_text(json.dumps(content), encoding="utf-8")
    found = inercal.import_calibration(path, "imucal")
    motion = found.correct(np.array([[1.03, 0.0, 2.04, 0.0, 1.5, 0.0]]))
    np.testing.assert_allclose(motion.f[0], [9.80665, 0, 2 * 9.80665], atol=1e-9)
    np.testing.assert_allclose(motion.w[0], np.radians([0, 1.0, 0]), atol=1e-12)


def test_imu_tk_of_its_own_frame_becomes_triangular(tmp_path: Path):
    """The frame of imu_tk has z along the z axis; x along the x axis is the one of inercal."""
    matrix = np.array([[1, -0.01, 0.02], [0, 1, -0.03], [0, 0, 1.0]])
    text = "\n\n".join(
        "\n".join(" ".join(map(str, row)) for row in block)
        for block in (matrix, np.eye(3) * 1.001, np.array([[0.1], [0.2], [0.3]]))
    )
    path = tmp_path / "acc.calib"
    path.write_text(text, encoding="utf-8")
    found = inercal.import_calibration(path, "imu_tk")
    assert found.frame == "triangular"
    y = np.array([[1.0, 2.0, 9.0], [-3.0, 9.0, 1.0]])
    force = found.correct(y).f
    own = (y - [0.1, 0.2, 0.3]) @ (matrix * 1.001).T
    # The same forces but for a rotation: lengths and the angle between them.
    np.testing.assert_allclose(force @ force.T, own @ own.T, rtol=1e-12)
    assert abs(found.value("ax.delta_o")) < 1e-15


def test_ardupilot_limits_the_temperature_of_its_offsets(tmp_path: Path):
    """Truth by hand: CALTEMP 70 counts as TMAX 60, where the reading without force is OFFS."""
    path = tmp_path / "board.param"
    lines = ["INS_ACCOFFS_X,0.1", "INS_TCAL1_ENABLE,1", "INS_TCAL1_TMIN,0", "INS_TCAL1_TMAX,60"]
    lines += ["INS_ACC1_CALTEMP,70", "INS_TCAL1_ACC1_X,1000"]
    path.write_text("\n".join(lines), encoding="utf-8")
    found = inercal.import_calibration(path, "ardupilot")
    assert found.sensor.reference_temperature == pytest.approx(333.15)
    motion = found.correct(np.array([[1.1, 0, 0], [1.06, 0, 0]]), dT=np.array([0.0, -40.0]))
    np.testing.assert_allclose(motion.f[:, 0], 1, atol=1e-12)


def test_px4_applies_no_temperature_set_of_another_device(tmp_path: Path):
    path = tmp_path / "board.params"
    rows = ["CAL_ACC0_XOFF\t0.1\t9", "TC_A_ENABLE\t1\t6", "TC_A0_X0_0\t0.5\t9"]
    for more in ([], ["CAL_ACC0_ID\t2\t6"], ["CAL_ACC0_ID\t2\t6", "TC_A0_ID\t3\t6"]):
        path.write_text("".join(f"1\t1\t{row}\n" for row in rows + more), encoding="utf-8")
        found = inercal.import_calibration(path, "px4")
        assert found.value("ax.k0") == 0.1
        assert found.sensor.reference_temperature == 293.15


FORMS = {
    "two columns with a comma": "{0},{1}\n",
    "two columns": "{0}\t{1}\n",
    "aligned columns": "{0:<16} {1:.6f}\n",
    "vehicle, component, name, value, type": "1\t1\t{0}\t{1}\t9\n",
    "the same with spaces": "1 1 {0} {1} 9\n",
    "the shell of PX4": "x + {0} [74,197] : {1}\n",
    "the shell, not saved": "  * {0} [74,197] : {1}\n",
    "equals signs": "{0} = {1}\n",
}
TITLE = "# Onboard parameters for Vehicle 1\n#\nSymbols: x = used, + = saved, * = unsaved\n\n"


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize(
    ("of", "names"),
    [
        ("ardupilot", ("INS_ACCOFFS_{}", "INS_ACCSCAL_{}", "INS_GYROFFS_{}")),
        ("px4", ("CAL_ACC0_{}OFF", "CAL_ACC0_{}SCALE", "CAL_GYRO0_{}OFF")),
    ],
)
def test_each_form_of_a_ground_station_is_read(
    of: str, names: tuple[str, ...], form: str, tmp_path: Path
):
    stated = {
        name.format(axis): value if "SCAL" in name else value * (k + 1)
        for name, value in zip(names, (0.25, 0.8, -0.125), strict=True)
        for k, axis in enumerate("XYZ")
    }
    rows = [FORMS[form].format(name, value) for name, value in stated.items()]
    path = tmp_path / "board.params"
    path.write_text(TITLE + "".join(rows) + "\n 9/210 parameters used.\n", encoding="utf-8")
    found = inercal.import_calibration(path, of, like=None)
    assert [found.value(f"a{axis}.k0") for axis in "xyz"] == [0.25, 0.5, 0.75]
    assert [found.value(f"g{axis}.bias") for axis in "xyz"] == [-0.125, -0.25, -0.375]
    assert found.value("az.k1") == 0.25


@pytest.mark.parametrize(
    ("of", "text"),
    [
        ("imu_tk", "1 2 3"),
        ("imu_tk", "nonsense " * 30),
        ("imu_tk", "0 " * 21),
        ("imucal", "{}"),
        ("imucal", "[1, 2]"),
        ("imucal", "not json"),
        ("kalibr", "imu0:\n  model: calibrated\n"),
        ("kalibr", "- 1\n"),
        ("kalibr", "a: [1\n"),
        ("kalibr", "[" * 20_000),
        ("imucal", "[" * 200_000),
        ("kalibr", "IMU0:\n ---\n  Model: calibrated\n  Accelerometer:\n    Noise density: 0.1\n"),
        ("realsense", "{}"),
        ("realsense", '{"imus": []}'),
        ("realsense", '{"imus": [{"accelerometer": {"scale_and_alignment": [1, 2], "bias": 0}}]}'),
        (
            "realsense",
            json.dumps(
                {"imus": [{"accelerometer": {"scale_and_alignment": [0.0] * 9, "bias": [0.0] * 3}}]}
            ),
        ),
        ("realsense", "[" * 200_000),
        ("basalt", "[1, 2]"),
        ("basalt", '{"value0": {"calib_accel_bias": [0, 0, 0]}}'),
        ("basalt", '{"value0": {"calib_accel_bias": [0, 0, 0, -1, 0, 0, 0, 0, 0]}}'),
        ("basalt", '{"value0": {"calib_accel_bias": [0, 0, 0, NaN, 0, 0, 0, 0, 0]}}'),
        ("betaflight", "a page about zeros\n"),
        ("betaflight", "set acc_calibration = 0,0,0,0\nset mag_calibration = 0,0,0\n"),
        ("betaflight", "set acc_calibration = 1,x,3,1\n"),
        ("inav", "set acc_lpf_hz = 15\n"),
        ("inav", "set accgain_x = 0\n"),
        ("inav", "set acczero_x = none\n"),
        ("kalibr", BOMB),
        ("px4", "1 1 CAL_ACC0_XOFF none 9\n"),
        ("px4", "a page about parameters\n"),
        ("px4", "1\t1\tSYS_AUTOSTART\t4001\t6\n"),
        ("ardupilot", "INS_ACCOFFS_X\n"),
        ("ardupilot", "FOO,1\n"),
        ("ardupilot", "INS_ACCOFFS_X,0.1\nINS_ACCSCAL_X,0\n"),
        ("ardupilot", "INS_ACCOFFS_X,0.1\nINS_TCAL1_ENABLE,1\n"),
        (
            "ardupilot",
            "INS_ACCOFFS_X,0\nINS_GYROFFS_X,0\nINS_TCAL1_ENABLE,1\n"
            "INS_ACC1_CALTEMP,20\nINS_GYR1_CALTEMP,30\n",
        ),
    ],
)
def test_a_file_of_another_kind_is_refused_by_name(of: str, text: str, tmp_path: Path):
    if of == "kalibr":
        pytest.importorskip("yaml")
    path = tmp_path / "file"
    path.write_text(text, encoding="utf-8")
    with refused(file="file"):
        inercal.import_calibration(path, of)
    path.write_bytes(b"\xff\xfe\x00\x81")
    with refused(file="file"):
        inercal.import_calibration(path, of)


def test_the_verb_writes_a_calibration_that_can_be_compared(tmp_path: Path):
    calibration = make_calibration("k0", "k1", "bias")
    own = inercal.save(calibration, tmp_path / "own.calibration.json")
    params = tmp_path / "board.params"
    text = export_calibration(calibration, "px4", options=OPTIONS["px4"]).text
    params.write_text(text, encoding="utf-8")
    out = tmp_path / "px4.calibration.json"
    arguments = ("import", params, "--from", "px4", "--like", own, "--out", out)
    assert run_program(*arguments).status == 0
    assert run_program(*arguments).status == 2  # it exists
    assert run_program(*arguments, "--force").status == 0
    found = inercal.load(out)
    assert (found.method, found.estimator) == ("imported", "px4")
    ended = run_program("compare", own, out, "--json")
    assert len(json.loads(ended.output)["coefficients"]) == 9
    alone = json.loads(run_program("compare", out, out, "--json").output)
    assert alone["joint"] is None
    assert all(one["en"] is None for one in alone["coefficients"])
    assert run_program("show", out).status == 0
    assert run_program("import", params, "--from", "nothing", "--out", out).status == 2


MISSING = {
    "px4": ("CAL_ACC0_YOFF 0.1\nCAL_ACC0_XSCALE 1.1\n", ("CAL_ACC0_ZOFF", "CAL_ACC0_ZSCALE")),
    "ardupilot": ("INS_ACCOFFS_Y,0.1\nCOMPASS_OFS_Y,5\n", ("INS_ACCSCAL_X", "INS_ACCOFFS_Z")),
    "inav": ("set acczero_y = 3\n", ("acczero_x", "accgain_z")),
    "ros_magnetometer": ("initial_mag_bias_y: 1e-6\n", ("initial_mag_bias_z",)),
}


@pytest.mark.parametrize("of", MISSING)
def test_a_value_that_the_file_does_not_state_is_named(of: str, tmp_path: Path):
    text, names = MISSING[of]
    path = tmp_path / "board"
    path.write_text(text, encoding="utf-8")
    options = {"acc_1g": 2048} if of == "inav" else {}
    found = inercal.import_calibration(path, of, options=options)
    notes = " ".join(found.notes)
    for name in names:
        assert f"{name} = " in notes
