"""Exports of sensors with one or two axes of a kind take only what the sensor measures."""

import csv
import re
import shutil
import subprocess
from contextlib import suppress
from io import StringIO
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.export.calibrations import OPTIONS, RANGES
from tests.refusals import refused

from inercal.basics.arrays import Array
from inercal.basics.errors import InputError
from inercal.calibration import Calibration
from inercal.export import TARGETS, export_calibration
from inercal.physics.sensors import G0, Readout, Sensor, axes_along

VOLTS, COUNTS = Readout(0.3 / G0, 1.5, "V"), Readout(1000.0, -40.0, "LSB")


def made(readout: Readout, *terms: str, gyro: bool = True) -> Calibration:
    """Return a calibration of accelerometers along z and -x and, if asked for, a gyro along y."""
    axes = axes_along(["z", "-x"], "f", "a", readout)
    axes += axes_along(["y"], "w", "g", readout) * gyro
    sensor = Sensor("Pair", axes).with_coefficients("bias", "scale", "misalignment", *terms)
    values = np.random.default_rng(4).normal(size=len(sensor.coefficients))
    values *= 3e-3 * sensor.unit_scale
    return Calibration(sensor, values, np.diag((1e-6 * sensor.unit_scale) ** 2), validity=RANGES)


def readings(one: Calibration, n: int = 200) -> tuple[Array, Array]:
    """Return outputs of the axes in their own order, and the corrected f and ω in the frame."""
    rng, sensor = np.random.default_rng(8), one.sensor
    span = [20.0 if axis.measures == "f" else 2.0 for axis in sensor.axes]
    si = rng.uniform(-1, 1, (n, len(span))) * span
    output = sensor.to_output(si)
    if sensor.axes[0].readout.unit == "LSB":
        output = np.rint(output)
    seen, zero = one.correct(output), np.zeros(n)
    parts = [-seen.f[:, 1], zero, seen.f[:, 0]]
    if len(span) == 3:
        parts += [zero, seen.w[:, 0], zero]
    return output, np.stack(parts, axis=-1)


@pytest.mark.parametrize("gyro", [False, True])
@pytest.mark.parametrize("terms", [(), ("k2", "k3")])
def test_python_takes_the_readings_in_the_order_of_the_calibration(
    terms: tuple[str, ...], gyro: bool
):
    one = made(VOLTS, *terms, gyro=gyro)
    output, wanted = readings(one)
    export = export_calibration(one, "python")
    module: dict[str, Any] = {}
    exec(compile(export.text, "export.py", "exec"), module)
    found = np.array([module["correct"](row) for row in output.tolist()])
    np.testing.assert_allclose(found, wanted, rtol=0, atol=1e-8)
    assert export.costs[0].largest < 1e-8
    for wrong in (output[0].tolist()[:-1], [*output[0].tolist(), 1.5]):
        with pytest.raises(ValueError, match="readings"):
            module["correct"](wrong)
    assert "az, ax" + ", gy" * gyro in export.unmeasured
    assert all(name in export.unmeasured for name in ("fy", *["wx", "wz"] * gyro))
    assert export.unmeasured in " ".join(line.strip() for line in export.header)


def test_one_gyro_is_corrected_along_its_own_axis():
    sensor = Sensor("fog", axes_along(["z"], "w", "g", COUNTS)).with_coefficients("bias", "scale")
    one = Calibration(sensor, np.array([1e-3, 2e-2]), np.eye(2) * 1e-12, validity=RANGES)
    module: dict[str, Any] = {}
    exec(compile(export_calibration(one, "python").text, "export.py", "exec"), module)
    assert module["correct"]((960.0,)) == pytest.approx((0, 0, (1.0 - 1e-3) / 1.02), rel=1e-12)


def test_the_csv_has_a_column_for_each_axis_that_is_measured():
    one = made(VOLTS)
    output, wanted = readings(one)
    lines = [x for x in export_calibration(one, "csv").text.splitlines() if x[:1] != "#"]
    rows = list(csv.DictReader(StringIO("\n".join(lines))))
    matrix = [row for row in rows if row["quantity"] == "C"]
    assert [row["column"] for row in matrix[:3]] == ["az", "ax", "gy"]
    c = np.array([float(row["value"]) for row in matrix]).reshape(6, 3)
    offset = np.array([float(row["value"]) for row in rows if row["quantity"] == "offset"])
    np.testing.assert_allclose((output - offset) @ c.T, wanted, rtol=0, atol=1e-8)


@pytest.mark.skipif(shutil.which("gcc") is None, reason="gcc is not installed")
@pytest.mark.parametrize(
    ("to", "number", "suffix"),
    [("c", "float", ""), ("c_fixed", "int32_t", "_fixed"), ("cpp", "double", "")],
)
def test_a_header_takes_one_reading_for_each_axis(
    tmp_path: Path, to: str, number: str, suffix: str
):
    one = made(COUNTS, *[] if to == "c_fixed" else ["k2"])
    output, wanted = readings(one)
    text = export_calibration(one, to).text
    # The self-test states as many readings as the function takes.
    stated = re.search(r"reading\[\w*\] = \{(.*?)\}", text)
    assert stated is not None
    assert stated[1].count(",") == 2
    (tmp_path / "pair.h").write_text(text, encoding="ascii")
    space = "pair::" if to == "cpp" else "pair_"
    test = f"{space}self_test{suffix}" + ("<double>" if to == "cpp" else "")
    main = (
        f'#include "pair.h"\n#include <stdio.h>\nint main(void)\n{{\n'
        f"    {number} reading[3], motion[6];\n    if ({test}() != 0) return 3;\n"
        "    while (fread(reading, sizeof reading, 1, stdin) == 1) {\n"
        f"        {space}correct{suffix}(reading, motion);\n"
        "        fwrite(motion, sizeof motion, 1, stdout);\n    }\n    return 0;\n}\n"
    )
    source = tmp_path / ("main.cpp" if to == "cpp" else "main.c")
    source.write_text(main, encoding="ascii")
    compiler = "g++" if to == "cpp" else "gcc"
    command = [compiler, "-Wall", "-Wextra", "-Werror", "-pedantic", source, "-o", tmp_path / "a"]
    built = subprocess.run(command, capture_output=True, text=True, check=False)
    assert built.returncode == 0, built.stderr
    kind = {"float": "f4", "int32_t": "i4", "double": "f8"}[number]
    data = output.astype(kind).tobytes()
    done = subprocess.run([tmp_path / "a"], input=data, capture_output=True, check=True)
    found = np.frombuffer(done.stdout, dtype=kind).reshape(-1, 6).astype(float)
    steps = np.repeat([2.0**-16, 2.0**-20], 3) if to == "c_fixed" else np.ones(6)
    limit = {"c": 2e-5, "c_fixed": 2e-5, "cpp": 1e-8}[to]
    np.testing.assert_allclose(found * steps, wanted, rtol=0, atol=limit)


def test_a_target_with_three_channels_says_what_to_feed_for_the_one_that_is_not_measured():
    one = made(VOLTS, gyro=False)
    output, wanted = readings(one)
    export = export_calibration(one, "imu_tk")
    assert "fy = 1.5" in export.unmeasured
    blocks = [np.loadtxt(StringIO(part)) for part in export.text.split("\n\n")[:3]]
    channels = np.stack([output[:, 1], np.full(len(output), 1.5), output[:, 0]], axis=-1)
    scale = np.diag(1 / np.diag(blocks[1])) if abs(blocks[1][0, 0]) < 1 else blocks[1]
    found = (channels - blocks[2]) @ scale.T @ blocks[0].T
    np.testing.assert_allclose(found, wanted, rtol=0, atol=1e-5)
    si = export_calibration(made(Readout(1.0, 0.2, "m/s^2"), gyro=False), "imu_calib")
    assert "fy = 0" in si.unmeasured


def test_integers_need_the_size_of_a_count_unless_the_readings_are_counts():
    with refused(key="--set", names=("lsb",)):
        export_calibration(made(VOLTS), "c_fixed")
    stated = export_calibration(made(VOLTS), "c_fixed", options={"lsb": 1e-5})
    assert "1e-05 V" in stated.text
    assert stated.costs[0].largest < 2.0**-16
    assert "1 LSB" in export_calibration(made(COUNTS), "c_fixed").text


def test_turned_axes_turn_the_channels_that_are_measured():
    one = made(VOLTS, "k2", gyro=False)
    output, wanted = readings(one)
    export = export_calibration(one, "python", axes="x -y -z")
    assert "only ax, -az, in this order" in export.unmeasured
    module: dict[str, Any] = {}
    exec(compile(export.text, "export.py", "exec"), module)
    turned = np.stack([output[:, 1], -output[:, 0]], axis=-1)
    found = np.array([module["correct"](row) for row in turned.tolist()])
    np.testing.assert_allclose(found, wanted * [1, -1, -1], rtol=0, atol=1e-8)


FEWER = {
    "one accelerometer": (["-y"], []),
    "one gyro": ([], ["z"]),
    "two accelerometers": (["z", "-x"], []),
    "one of each": (["x"], ["y"]),
    "four axes": (["x", "y", "z"], ["z"]),
    "six axes": (["x", "y", "z"], ["x", "y", "z"]),
}


@pytest.mark.usefixtures("few_samples")
@pytest.mark.parametrize("to", TARGETS)
def test_a_refit_of_linear_terms_changes_nothing_whichever_axes_are_measured(to: str):
    for forces, rates in FEWER.values():
        axes = axes_along(forces, "f", "a", COUNTS) + axes_along(rates, "w", "g", COUNTS)
        sensor = Sensor("Few", axes).with_coefficients("bias", "scale", "misalignment")
        values = np.random.default_rng(4).normal(size=len(sensor.coefficients))
        one = Calibration(
            sensor,
            values * 1e-3 * sensor.unit_scale,
            np.diag((1e-6 * sensor.unit_scale) ** 2),
            validity=RANGES,
        )
        try:
            plain = export_calibration(one, to, options=OPTIONS.get(to))
            refitted = export_calibration(one, to, options=OPTIONS.get(to), refit=True)
        except InputError:  # this target has no place for this sensor, or needs no refit
            continue
        for before, after in zip(plain.costs, refitted.costs, strict=True):
            assert after.rms == pytest.approx(before.rms, rel=1e-3, abs=1e-7)
        for lossless in (False, True):
            with suppress(InputError):
                export_calibration(
                    one, to, options=OPTIONS.get(to), refit=True, lossless=lossless, axes="y z x"
                )
