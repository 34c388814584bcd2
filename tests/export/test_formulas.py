"""Exports, applied as their targets do, against the calibration: formulas written from the sources.

This test reads the files without inercal. Where a target holds the model, the correction agrees to
rounding; where not, to the error that the file states.
"""

import csv
import json
import re
from collections.abc import Callable
from functools import cache, reduce
from io import StringIO
from itertools import product
from typing import Any

import numpy as np
import pytest
from tests.base_seeds import chosen
from tests.export.calibrations import (
    COUNTS,
    LINEAR,
    NOISE,
    NONLINEAR,
    OPTIONS,
    TEMPERATURE,
    Readings,
    make_calibration,
    random_readings,
)

from inercal.basics.arrays import Array
from inercal.calibration import Calibration
from inercal.export import Export, export_calibration
from inercal.physics.sensors import Form

Applied = Callable[[str, Readings], Array]
SINGLE = 16 * 2.0**-24


def parameters(text: str) -> dict[str, float]:
    lines = [re.split(r"[\t,]", x) for x in text.splitlines() if x and not x.startswith("#")]
    return {x[-3] if len(x) == 5 else x[0]: float(x[-2] if len(x) == 5 else x[1]) for x in lines}


def px4(text: str, seen: Readings) -> Array:
    p = parameters(text)

    def thermal(letter: str) -> Array | float:
        if p.get(f"TC_{letter}_ENABLE") != 1:
            return 0.0
        stem = f"TC_{letter}0_"
        d = np.clip(seen.celsius, p[stem + "TMIN"], p[stem + "TMAX"]) - p[stem + "TREF"]
        x = np.array([[p[f"{stem}X{k}_{a}"] for a in range(3)] for k in range(4)])
        return ((x[3] * d[:, None] + x[2]) * d[:, None] + x[1]) * d[:, None] + x[0]

    # A new board has the defaults of the parameters that the file leaves out.
    off = [p.get(f"CAL_ACC0_{a}OFF", 0.0) for a in "XYZ"]
    scale = [p.get(f"CAL_ACC0_{a}SCALE", 1.0) for a in "XYZ"]
    turn = [p.get(f"CAL_GYRO0_{a}OFF", 0.0) for a in "XYZ"]
    f = (seen.output[:, :3] - thermal("A") - off) * np.array(scale)
    return np.hstack([f, seen.output[:, 3:] - thermal("G") - turn])


def ardupilot(text: str, seen: Readings) -> Array:
    p = parameters(text)

    def thermal(word: str) -> Array | float:
        if p.get("INS_TCAL1_ENABLE") != 1:
            return 0.0
        ends = p["INS_TCAL1_TMIN"], p["INS_TCAL1_TMAX"]
        c = np.array([[p[f"INS_TCAL1_{word}{k}_{a}"] for a in "XYZ"] for k in (1, 2, 3)])

        def polynomial(t: Array) -> Array:
            t = np.clip(t, *ends)[:, None] - 35.0
            return (c[0] + (c[1] + c[2] * t) * t) * t * 1e-6

        return polynomial(seen.celsius) - polynomial(np.array([p[f"INS_{word}1_CALTEMP"]]))

    off = [p.get(f"INS_ACCOFFS_{a}", 0.0) for a in "XYZ"]
    scale = [p.get(f"INS_ACCSCAL_{a}", 1.0) for a in "XYZ"]
    turn = [p.get(f"INS_GYROFFS_{a}", 0.0) for a in "XYZ"]
    assert p["INS_GYR_CAL"] == 0
    f = (seen.output[:, :3] - thermal("ACC") - off) * np.array(scale)
    return np.hstack([f, seen.output[:, 3:] - thermal("GYR") - turn])


def vectornav(text: str, seen: Readings) -> Array:
    parts = {}
    for line in (x for x in text.splitlines() if x.startswith("$VNWRG")):
        body, _, check = line[1:].partition("*")
        assert int(check, 16) == reduce(lambda a, b: a ^ b, body.encode())
        register, *numbers = body.split(",")[1:]
        parts[int(register)] = np.array([float(x) for x in numbers])
    assert text.endswith("$VNWNV*57\n")
    columns = []
    for k, register in enumerate((25, 84)):
        matrix, bias = parts[register][:9].reshape(3, 3), parts[register][9:]
        columns.append((seen.output[:, 3 * k : 3 * k + 3] - bias) @ matrix.T)
    return np.hstack(columns)


def imu_calib(text: str, seen: Readings) -> Array:
    yaml = pytest.importorskip("yaml")
    content = yaml.safe_load(text)
    f = seen.output[:, :3] @ np.array(content["SM"]).reshape(3, 3).T - content["bias"]
    return np.hstack([f, seen.output[:, 3:]])


def realsense(text: str, seen: Readings) -> Array:
    """Multiply rows of readings by the matrix in the file, as the tool itself checks its result."""
    imu = json.loads(text)["imus"][0]
    parts = []
    for k, name in enumerate(("accelerometer", "gyroscope")):
        matrix = np.array(imu[name]["scale_and_alignment"]).reshape(3, 3)
        parts.append(seen.output[:, 3 * k : 3 * k + 3] @ matrix - imu[name]["bias"])
    return np.hstack(parts)


def basalt(text: str, seen: Readings) -> Array:
    """Apply raw + S raw − b with the numbers in the order of getBiasAndScale."""
    one, turn = json.loads(text)["value0"], stated_turn(json.loads(text)["comment"])
    a, g = one["calib_accel_bias"], one["calib_gyro_bias"]
    assert (len(a), len(g)) == (9, 12)
    scale = np.array([[a[3], 0, 0], [a[4], a[6], 0], [a[5], a[7], a[8]]])
    scale_g = np.array([[g[3], g[6], g[9]], [g[4], g[7], g[10]], [g[5], g[8], g[11]]])
    f, w = seen.output[:, :3], seen.output[:, 3:]
    f, w = f + f @ scale.T - a[:3], w + w @ scale_g.T - g[:3]
    return np.hstack([f @ turn, w @ turn])


def settings(text: str) -> dict[str, list[int]]:
    """Return the whole numbers that the commands for a CLI set."""
    rows = re.findall(r"^set (\w+) = (-?\d+(?:,-?\d+)*)$", text, flags=re.MULTILINE)
    return {name: [int(x) for x in value.split(",")] for name, value in rows}


def betaflight(text: str, seen: Readings) -> Array:
    *zero, calibrated = settings(text)["acc_calibration"]
    assert calibrated == 1
    raw = seen.output[:, :3] / 9.80665 * 2048
    return np.hstack([(raw - zero) / 2048 * 9.80665, seen.output[:, 3:]])


def inav(text: str, seen: Readings) -> Array:
    one = settings(text)
    assert "set init_gyro_cal = OFF\nset ins_gravity_cmss = 980.665\n" in text
    zero, gain, still = ([one[f"{name}_{a}"][0] for a in "xyz"]
                         for name in ("acczero", "accgain", "gyro_zero"))  # fmt: skip
    raw, rate = seen.output[:, :3] / 9.80665 * 2048, np.degrees(seen.output[:, 3:]) * 16.4
    f = (raw - zero) * gain / 4096 / 2048 * 9.80665
    return np.hstack([f, np.radians((rate - still) / 16.4)])


def imu_tk(text: str, seen: Readings) -> Array:
    x = np.array([float(word) for word in text.split()[:21]])
    matrix, scale, bias = x[:9].reshape(3, 3), x[9:18].reshape(3, 3), x[18:]
    return np.hstack([(seen.output[:, :3] - bias) @ (matrix @ scale).T, seen.output[:, 3:]])


def imucal(text: str, seen: Readings) -> Array:
    one = {k: np.array(v) for k, v in json.loads(text).items() if k[1:2] == "_"}
    assert one["K_a"].shape == (3, 3)
    back = np.linalg.inv
    a = (back(one["R_a"]) @ back(one["K_a"]) @ (seen.output[:, :3] - one["b_a"]).T).T
    w = (seen.output[:, 3:].T - one["K_ga"] @ a.T - one["b_g"][:, None]).T
    return np.hstack([a, (back(one["R_g"]) @ back(one["K_g"]) @ w.T).T])


def adis(text: str, seen: Readings) -> Array:
    rows = csv.DictReader(x for x in text.splitlines() if not x.startswith("#"))
    words = {}
    for row in rows:
        bits = 4 * (len(row["word"]) - 2)
        word = int(row["word"], 16)
        words[row["register"]] = word - (1 << bits) * (word >> (bits - 1))
        assert words[row["register"]] == int(row["value"])
    parts = []
    sizes = (0.8e-3 * 9.80665, np.radians(0.02))
    for k, (word, letter, lsb) in enumerate(zip(("ACCL", "GYRO"), "AG", sizes, strict=True)):
        scale = np.array([words[f"{a}_{word}_SCALE"] for a in "XYZ"]) / 32768
        bias = np.array([words[f"{a}{letter}_BIAS"] for a in "XYZ"]) * lsb
        parts.append((1 + scale) * seen.output[:, 3 * k : 3 * k + 3] + bias)
    return np.hstack(parts)


def table(text: str, seen: Readings) -> Array:
    rows = list(csv.DictReader(x for x in text.splitlines() if not x.startswith("#")))
    matrix = np.array([float(r["value"]) for r in rows if r["quantity"] == "C"]).reshape(6, 6)
    offset = np.array([float(r["value"]) for r in rows if r["quantity"] == "offset"])
    return (seen.output - offset) @ matrix.T


def python(text: str, seen: Readings) -> Array:
    assert not re.search(r"^\s*(import|from)\b", text, flags=re.MULTILINE)
    module: dict[str, Any] = {}
    exec(compile(text, "export.py", "exec"), module)
    if "temperature" in text.partition("def correct(")[2].partition(")")[0]:
        pairs = zip(seen.output.tolist(), seen.celsius.tolist(), strict=True)
        return np.array([module["correct"](x, t) for x, t in pairs])
    return np.array([module["correct"](x) for x in seen.output.tolist()])


def matlab(text: str, seen: Readings) -> Array:
    """Run the function in Python: its few constructs are translated one by one."""
    joined = text.replace("...\n", " ")
    lines = [x for x in joined.splitlines() if not x.lstrip().startswith("%")]
    assert lines[0].startswith("function motion = imu_7_correct(reading")
    assert lines[-1] == "end"
    source: list[str] = []
    for line in lines[1:-1]:
        line = re.sub(
            r"\((:), (\d+)\)", lambda m: f"[:, {int(m[2]) - 1}]", line.rstrip().rstrip(";")
        )
        line = line.replace(".*", "*").replace("C'", "C.T").replace("* C.T", "@ C.T")
        line = line.replace("temperature(:)", "temperature").replace("sign(", "np.sign(")
        line = re.sub(r"\bmin\(max\((.*?), (.*?)\), (.*?)\)", r"np.clip(\1, \2, \3)", line)
        line = line.replace("size(reading, 2)", "reading.shape[1]")
        line = line.replace("zeros(size(reading))", "np.zeros(reading.shape)")
        if found := re.fullmatch(r"    (C|offset) = \[(.*)\]", line):
            rows = [f"[{row}]" for row in found[2].split(";")]
            line = f"    {found[1]} = np.array([{','.join(rows)}])"
        if found := re.fullmatch(r"    for pass = 1:(\d+)", line):
            line = f"    for _ in range({found[1]}):"
        source += [line] * (line.strip() != "end")
    module: dict[str, Any] = {"np": np}
    code = "def correct(reading, temperature):\n" + "\n".join(source) + "\n    return motion"
    exec(code, module)
    return module["correct"](seen.output, seen.celsius)


def kalibr_matrices(text: str) -> dict[str, Any]:
    yaml = pytest.importorskip("yaml")
    one = yaml.safe_load(text.removeprefix("%YAML:1.0\n"))["imu0"]
    assert all(isinstance(one[name], float) for name in NOISE)
    return one


def stated_turn(text: str) -> Array:
    plain = " ".join(re.sub(r"(?m)^#? +", "", text).split())
    rows = re.search(r"with Q = \[(.*?)\]", plain)
    assert rows is not None
    return np.array([[float(x) for x in row.split(",")] for row in rows[1].split(";")])


def kalibr(text: str, seen: Readings) -> Array:
    """Invert the model of Kalibr, whose file has no biases; A acts in the gyro's frame."""
    one, turn = kalibr_matrices(text), stated_turn(text)
    gyros = {name: np.array(rows) for name, rows in one["gyroscopes"].items()}
    f = np.linalg.solve(np.array(one["accelerometers"]["M"]), seen.output[:, :3].T)
    rest = seen.output[:, 3:].T - gyros["A"] @ (gyros["C_gyro_i"] @ f)
    w = gyros["C_gyro_i"].T @ np.linalg.solve(gyros["M"], rest)
    return np.hstack([f.T @ turn, w.T @ turn])


def openvins(text: str, seen: Readings) -> Array:
    """Apply Ta⁻¹ and Tw⁻¹; Tg acts on the force in the IMU frame."""
    one, turn = kalibr_matrices(text), stated_turn(text)
    np.testing.assert_array_equal(one["R_IMUtoACC"], np.eye(3))
    f = np.linalg.solve(np.array(one["Ta"]), seen.output[:, :3].T)
    rest = seen.output[:, 3:].T - np.array(one["Tg"]) @ f
    w = np.array(one["R_IMUtoGYRO"]).T @ np.linalg.solve(np.array(one["Tw"]), rest)
    return np.hstack([f.T @ turn, w.T @ turn])


LINEAR_TARGETS: dict[str, Applied] = {
    "kalibr": kalibr,
    "openvins": openvins,
    "px4": px4,
    "ardupilot": ardupilot,
    "vectornav": vectornav,
    "imu_calib": imu_calib,
    "realsense": realsense,
    "basalt": basalt,
    "betaflight": betaflight,
    "inav": inav,
    "imu_tk": imu_tk,
    "imucal": imucal,
    "adis": adis,
    "csv": table,
    "python": python,
    "matlab": matlab,
}
SETS = {"linear": LINEAR, "full": (*LINEAR, *TEMPERATURE, *NONLINEAR)}


@cache
def export(calibration: Calibration, to: str) -> Export:
    return export_calibration(calibration, to, options=OPTIONS.get(to), source="x.calibration.json")


def stated(text: str, kind: str, what: str = "error of this file") -> float:
    """Return the largest error that a file states."""
    plain = " ".join(re.sub(r"(?m)^ *[#%*]* +|\\n", " ", text).split())
    found = re.search(rf"{what} in {kind} against the calibration: at most (\S+)", plain)
    assert found is not None
    return float(found[1])


@pytest.mark.slow
@pytest.mark.parametrize(
    ("to", "terms"),
    chosen(
        product(LINEAR_TARGETS, SETS),
        [(to, "full") for to in LINEAR_TARGETS]
        + [(to, "linear") for to in ("csv", "kalibr", "openvins", "px4")],
    ),
)
def test_the_correction_of_a_target_is_the_calibration_but_for_the_stated_error(
    to: str, terms: str
):
    calibration = make_calibration(*SETS[terms])
    seen = random_readings(calibration)
    made = export(calibration, to)
    error = np.abs(LINEAR_TARGETS[to](made.text, seen) - seen.corrected)
    for k, kind in enumerate(("specific force", "angular rate")):
        mine = error[:, 3 * k : 3 * k + 3].max()
        limit = SINGLE * np.abs(seen.corrected[:, 3 * k : 3 * k + 3]).max()
        assert mine <= max(1.03 * stated(made.text, kind), limit)
        # Random readings come near the corners, so what is stated is no mere bound.
        assert mine >= 0.5 * stated(made.text, kind) or mine <= limit


HELD = {
    ("px4", "f"): ("bias", "scale", *TEMPERATURE),
    ("px4", "w"): ("bias", *TEMPERATURE),
    ("ardupilot", "f"): ("bias", "scale", *TEMPERATURE),
    ("ardupilot", "w"): ("bias", *TEMPERATURE),
    ("vectornav", "w"): ("bias", "scale", "misalignment"),
    ("imu_calib", "f"): ("bias", "scale", "misalignment"),
    ("realsense", "f"): ("bias", "scale", "misalignment"),
    ("realsense", "w"): ("bias", "scale", "misalignment"),
    ("basalt", "f"): ("bias", "scale", "misalignment"),
    ("basalt", "w"): ("bias", "scale", "misalignment"),
    ("imu_tk", "f"): ("bias", "scale", "misalignment"),
    ("imucal", "w"): LINEAR,
    ("csv", "w"): LINEAR,
    ("python", "f"): SETS["full"],
    ("python", "w"): SETS["full"],
    ("matlab", "w"): SETS["full"],
}


@pytest.mark.parametrize(("to", "kind"), HELD)
def test_what_a_target_can_hold_is_exact_to_single_precision(to: str, kind: str):
    chosen = HELD[to, kind]
    if kind == "w" and to in ("px4", "ardupilot"):
        chosen = tuple(name for name in chosen if name != "scale")
    calibration = make_calibration(*chosen)
    seen = random_readings(calibration)
    columns = slice(0, 3) if kind == "f" else slice(3, 6)
    found = LINEAR_TARGETS[to](export(calibration, to).text, seen)[:, columns]
    wanted = seen.corrected[:, columns]
    np.testing.assert_allclose(found, wanted, rtol=0, atol=SINGLE * np.abs(wanted).max())


@pytest.mark.parametrize("to", ["kalibr", "openvins"])
@pytest.mark.parametrize("terms", SETS)
def test_kalibr_and_openvins_hold_the_matrices_beside_their_biases(to: str, terms: str):
    calibration = make_calibration(*SETS[terms])
    seen = random_readings(calibration)
    text = export(calibration, to).text
    one = kalibr_matrices(text)
    lower = (
        (one["accelerometers"]["M"], one["gyroscopes"]["M"])
        if to == "kalibr"
        else (one["Ta"], one["Tw"])
    )
    assert not any(np.triu(np.array(matrix), 1).any() for matrix in lower)
    names = [*(f"a{x}.k0" for x in "xyz"), *(f"g{x}.bias" for x in "xyz")]
    bias = [calibration.value(name) for name in names]
    found = LINEAR_TARGETS[to](text, seen._replace(output=seen.output - bias))
    error = np.abs(found - seen.corrected)
    what = "the same after subtracting the biases below"
    for k, kind in enumerate(("specific force", "angular rate")):
        mine, limit = error[:, 3 * k : 3 * k + 3].max(), stated(text, kind, what)
        if terms == "linear":
            assert mine <= 1e-9
        else:
            assert 0.5 * limit <= mine <= 1.03 * limit


@pytest.mark.parametrize("to", ["imu_tk", "imucal", "csv", "python", "matlab"])
def test_targets_of_the_output_take_counts(to: str):
    calibration = make_calibration(readouts=COUNTS)
    seen = random_readings(calibration)
    found = LINEAR_TARGETS[to](export(calibration, to).text, seen)[:, :3]
    np.testing.assert_allclose(found, seen.corrected[:, :3], rtol=0, atol=1e-8)


@pytest.mark.slow
def test_axes_of_another_frame_are_turned_with_their_channels():
    calibration = make_calibration(*SETS["full"])
    turn = np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    both = np.kron(np.eye(2), turn)
    for to in ("python", "imucal"):
        chosen = calibration if to == "python" else make_calibration()
        seen = random_readings(chosen, 2000)
        made = export_calibration(chosen, to, axes="y -x z")
        turned = Readings(seen.output @ both.T, seen.corrected @ both.T, seen.celsius)
        found = LINEAR_TARGETS[to](made.text, turned)
        np.testing.assert_allclose(found, turned.corrected, rtol=0, atol=1e-8)


@pytest.mark.slow
@pytest.mark.parametrize("form", ["reference", "tilted"])
def test_code_holds_the_model_in_both_forms(form: Form):
    calibration = make_calibration(*SETS["full"], readouts=COUNTS, form=form)
    seen = random_readings(calibration, 2000)
    for to in ("python", "matlab"):
        found = LINEAR_TARGETS[to](export(calibration, to).text, seen)
        np.testing.assert_allclose(found, seen.corrected, rtol=0, atol=1e-7)


def test_beyond_the_temperatures_of_the_calibration_corrections_stay_as_at_the_end():
    calibration = make_calibration("bias", *TEMPERATURE)
    for to in ("px4", "ardupilot", "python", "matlab"):
        text = export(calibration, to).text
        output = np.ones((4, 6))
        seen = Readings(output, output, np.array([-40.0, -10.0, 60.0, 95.0]))
        found = LINEAR_TARGETS[to](text, seen)
        np.testing.assert_allclose(found[[0, 3]], found[[1, 2]], rtol=0, atol=1e-12)
        assert np.abs(found[1] - found[2]).min() > 1e-5


def test_the_csv_has_every_coefficient_with_its_uncertainty():
    calibration = make_calibration(*SETS["full"])
    rows = csv.DictReader(
        x for x in StringIO(export(calibration, "csv").text) if not x.startswith("#")
    )
    found = {r["row"]: (float(r["value"]), float(r["std"])) for r in rows if r["std"]}
    assert set(found) == set(calibration.sensor.coefficients)
    for name, (value, std) in found.items():
        assert value == pytest.approx(calibration.value(name), rel=1e-14)
        assert std == pytest.approx(calibration.uncertainty(name), rel=1e-5)


def test_imucal_itself_applies_its_file():
    imucal_package = pytest.importorskip("imucal", reason="package imucal is not installed")
    pandas = pytest.importorskip("pandas")
    calibration = make_calibration()
    seen = random_readings(calibration)
    one = imucal_package.FerrarisCalibrationInfo.from_json(export(calibration, "imucal").text)
    names = ["acc_x", "acc_y", "acc_z", "gyr_x", "gyr_y", "gyr_z"]
    frame = pandas.DataFrame(seen.output, columns=names)
    found = one.calibrate_df(frame, "m/s^2", "rad/s").to_numpy()
    np.testing.assert_allclose(found, seen.corrected, rtol=0, atol=1e-9)
