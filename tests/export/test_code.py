"""C, fixed-point C and C++ headers, compiled and run on random readings."""

import re
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
from tests.base_seeds import slow
from tests.export.calibrations import (
    COUNTS,
    LINEAR,
    SI,
    Readings,
    magnetometer_readings,
    make_calibration,
    make_magnetometer,
    random_readings,
)
from tests.export.test_formulas import SETS, SINGLE, stated

from inercal.basics.arrays import Array
from inercal.calibration import Calibration
from inercal.export import export_calibration
from inercal.physics.sensors import Readout

FLAGS = ("-Wall", "-Wextra", "-Werror", "-pedantic")
pytestmark = pytest.mark.skipif(shutil.which("gcc") is None, reason="gcc is not installed")

C_MAIN = """#include "{file}"
#include <stdio.h>
int main(void)
{{
    float reading[{n}], motion[{n}], t;
    if ({name}_self_test() != 0) return 3;
    while (fread(reading, sizeof reading, 1, stdin) == 1 && fread(&t, sizeof t, 1, stdin) == 1) {{
        {name}_correct(reading, {given} motion);
        fwrite(motion, sizeof motion, 1, stdout);
    }}
    return 0;
}}
"""
FIXED_MAIN = """#include "{file}"
#include <stdio.h>
int main(void)
{{
    int32_t reading[{n}], motion[{n}];
    if ({name}_self_test_fixed() != 0) return 3;
    while (fread(reading, sizeof reading, 1, stdin) == 1) {{
        {name}_correct_fixed(reading, motion);
        fwrite(motion, sizeof motion, 1, stdout);
    }}
    return 0;
}}
"""
START = """int test(void);
void _start(void);
__attribute__((force_align_arg_pointer)) void _start(void)
{
    int status = test();
    __asm__ volatile("int $0x80" : : "a"(1), "b"(status));
    for (;;) { }
}
"""
CPP_MAIN = """#include "{file}"
#include <cstdio>
int main()
{{
    double reading[{n}], motion[{n}], t;
    if ({name}::self_test<double>() != 0 || {name}::self_test<float>() != 0) return 3;
    while (std::fread(reading, sizeof reading, 1, stdin) == 1
           && std::fread(&t, sizeof t, 1, stdin) == 1) {{
        {name}::correct(reading, {given} motion);
        std::fwrite(motion, sizeof motion, 1, stdout);
    }}
    return 0;
}}
"""


def built(folder: Path, calibration: Calibration, to: str) -> Path:
    """Return the program that corrects what it reads by the header."""
    made = export_calibration(calibration, to, name="IMU-7")
    header = folder / f"imu{made.target.suffix}"
    header.write_text(made.text, encoding="ascii")
    no_library(made.text)
    main, compiler, standard = {
        "c": (C_MAIN, "gcc", "-std=c99"),
        "c_fixed": (FIXED_MAIN, "gcc", "-std=c99"),
        "cpp": (CPP_MAIN, "g++", "-std=c++11"),
    }[to]
    given = "t," if "float temperature" in made.text or "Real temperature" in made.text else ""
    if not given:
        main = (
            main.replace("motion);\n", "motion);\n        (void)t;\n") if to != "c_fixed" else main
        )
    source = folder / ("main.c" if compiler == "gcc" else "main.cpp")
    words = {"file": header.name, "name": "imu_7", "given": given}
    n = len(calibration.sensor.axes)
    source.write_text(main.format(n=n, **words), encoding="ascii")
    program = folder / "correct"
    command = [compiler, standard, *FLAGS, "-O2", str(source), "-o", str(program)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return program


def no_library(text: str) -> None:
    """Hold a header to constants and arithmetic: no include but stdint.h, and no call."""
    code = re.sub(r"/\*.*?\*/", "", text, flags=re.DOTALL)
    assert set(re.findall(r"#include (\S+)", code)) <= {"<stdint.h>"}
    calls = set(re.findall(r"\b([a-z_]\w*)\s*\(", code))
    assert calls <= {"for", "if", "imu_7_correct", "imu_7_self_test", "imu_7_correct_fixed",
                     "imu_7_self_test_fixed", "correct", "self_test"}  # fmt: skip


def run(program: Path, data: bytes, kind: str, n: int = 6) -> Array:
    done = subprocess.run([program], input=data, capture_output=True, check=False)
    assert done.returncode == 0
    return np.frombuffer(done.stdout, dtype=kind).reshape(-1, n).astype(float)


def rows(seen: Readings, kind: str) -> bytes:
    return np.column_stack([seen.output, seen.celsius]).astype(kind).tobytes()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("terms", "readouts"),
    [("linear", SI), ("full", COUNTS), slow("full", SI), slow("linear", COUNTS)],
)
def test_the_c_header_is_exact_to_single_precision(
    tmp_path: Path, terms: str, readouts: tuple[Readout, Readout]
):
    calibration = make_calibration(*SETS[terms], readouts=readouts)
    seen = random_readings(calibration)
    if readouts is SI:  # what a float can be given
        rounded = seen.output.astype(np.float32).astype(float)
        motion = calibration.correct(rounded, dT=seen.celsius + 273.15 - 293.15)
        seen = Readings(rounded, np.hstack([motion.f, motion.w]), seen.celsius)
    found = run(built(tmp_path, calibration, "c"), rows(seen, "f4"), "f4")
    for part in (slice(0, 3), slice(3, 6)):
        wanted = seen.corrected[:, part]
        np.testing.assert_allclose(
            found[:, part], wanted, rtol=0, atol=SINGLE * np.abs(wanted).max()
        )


@pytest.mark.slow
@pytest.mark.parametrize("terms", SETS)
def test_the_cpp_header_is_exact(tmp_path: Path, terms: str):
    calibration = make_calibration(*SETS[terms], readouts=COUNTS, form="tilted")
    seen = random_readings(calibration)
    found = run(built(tmp_path, calibration, "cpp"), rows(seen, "f8"), "f8")
    np.testing.assert_allclose(found, seen.corrected, rtol=0, atol=1e-8)


@pytest.mark.slow
@pytest.mark.parametrize(("to", "inertial"), [("c", True), ("cpp", False)])
def test_headers_correct_magnetometers(tmp_path: Path, to: str, inertial: bool):
    calibration = make_magnetometer("bias_dT", "scale_dT", inertial=inertial)
    seen = magnetometer_readings(calibration)
    kind = {"c": "f4", "cpp": "f8"}[to]
    found = run(built(tmp_path, calibration, to), rows(seen, kind), kind, 9 if inertial else 3)
    limit = {"c": 2 * SINGLE, "cpp": 1e-9}[to] * np.abs(seen.corrected[:, -3:]).max()
    np.testing.assert_allclose(found[:, -3:], seen.corrected[:, -3:], rtol=0, atol=limit)


def test_a_wrong_field_fails_the_self_test(tmp_path: Path):
    calibration = make_magnetometer()
    program = built(tmp_path, calibration, "c")
    header, main = tmp_path / "imu.h", tmp_path / "main.c"
    offset = re.search(r"offset\[3\] = \{(\S+)f,", header.read_text(encoding="ascii"))
    assert offset is not None
    wrong = f"{float(offset[1]) + 0.01}"  # 0.01 µT, the limit is 1 nT
    header.write_text(header.read_text(encoding="ascii").replace(offset[1], wrong))
    subprocess.run(["gcc", "-std=c99", str(main), "-o", str(program)], check=True)
    assert subprocess.run([program], stdin=subprocess.DEVNULL, check=False).returncode == 3


def test_integers_err_by_half_a_step_of_the_result(tmp_path: Path):
    calibration = make_calibration(*LINEAR, readouts=COUNTS)
    seen = random_readings(calibration)
    found = run(built(tmp_path, calibration, "c_fixed"), seen.output.astype("i4").tobytes(), "i4")
    steps = np.repeat([2.0**-16, 2.0**-20], 3)
    error = np.abs(found * steps - seen.corrected) / steps
    # The header states the rounding of a factor beside half a step: some 4e-3 of a step here.
    assert 0.49 < error.max() <= 0.53
    assert error.mean() == pytest.approx(0.25, abs=0.01)


@pytest.mark.slow
def test_integers_err_by_what_the_header_states_where_they_cannot_hold_a_term(tmp_path: Path):
    calibration = make_calibration(*SETS["full"], readouts=COUNTS)
    seen = random_readings(calibration)
    program = built(tmp_path, calibration, "c_fixed")
    found = run(program, seen.output.astype("i4").tobytes(), "i4")
    error = np.abs(found * np.repeat([2.0**-16, 2.0**-20], 3) - seen.corrected)
    text = (tmp_path / "imu.h").read_text(encoding="ascii")
    for k, kind in enumerate(("specific force", "angular rate")):
        limit = stated(text, kind)
        assert 0.5 * limit <= error[:, 3 * k : 3 * k + 3].max() <= 1.03 * limit


def test_integers_take_fractions_of_the_unit(tmp_path: Path):
    calibration = make_calibration(*LINEAR, readouts=SI)
    made = export_calibration(calibration, "c_fixed", options={"lsb": "0.001"})
    assert made.costs[0].largest < 0.51 * 2**-16
    assert not any(one.exceeds for one in made.costs)


@pytest.mark.slow
@pytest.mark.parametrize("to", ["c", "c_fixed", "cpp"])
def test_headers_compile_for_32_bits_without_a_library(tmp_path: Path, to: str):
    calibration = make_calibration(*SETS["full"], readouts=COUNTS)
    made = export_calibration(calibration, to)
    header = tmp_path / f"imu{made.target.suffix}"
    header.write_text(made.text, encoding="ascii")
    name = {"c": "imu_7_self_test", "c_fixed": "imu_7_self_test_fixed",
            "cpp": "imu_7::self_test<float>"}[to]  # fmt: skip
    source = tmp_path / ("main.cpp" if to == "cpp" else "main.c")
    entry = 'extern "C" int test(void);' if to == "cpp" else "int test(void);"
    source.write_text(f'#include "{header.name}"\n{entry}\nint test(void) {{ return {name}(); }}\n')
    compiler, standard = ("g++", "-std=c++11") if to == "cpp" else ("gcc", "-std=c99")
    # Freestanding: no header or library of 32 bits need be installed.
    command = [compiler, standard, *FLAGS, "-m32", "-msse2", "-mfpmath=sse", "-O2"]
    command += ["-ffreestanding", "-fno-pic", "-fno-asynchronous-unwind-tables", "-c"]
    empty = tmp_path / "empty.c"
    empty.write_text("int empty(void);\nint empty(void) { return 0; }\n")
    tried = subprocess.run(
        ["gcc", "-m32", "-c", empty, "-o", tmp_path / "empty.o"], capture_output=True, check=False
    )
    if tried.returncode:
        pytest.skip("this gcc has no -m32")
    built_object = tmp_path / "test.o"
    done = subprocess.run(
        [*command, str(source), "-o", str(built_object)],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    start = tmp_path / "start.c"
    start.write_text(START)
    program = tmp_path / "program"
    link = ["gcc", "-m32", "-O2", "-ffreestanding", "-fno-pic", "-nostdlib", "-static", "-no-pie"]
    done = subprocess.run(
        [*link, str(start), str(built_object), "-o", str(program)],
        capture_output=True,
        text=True,
        check=False,
    )
    # Nothing is linked but the header: what it needed of a library would be undefined here.
    assert done.returncode == 0, done.stderr
    try:
        ended = subprocess.run([program], check=False)
    except OSError:
        pytest.skip("compiled and linked; this machine runs no programs of 32 bits")
    assert ended.returncode == 0
