"""The sketch for Arduino and the project for ESP-IDF, compiled against stand-ins and run."""

import os
import re
import shutil
import subprocess
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from tests.base_seeds import slow
from tests.export.calibrations import COUNTS, LINEAR, RANGES, TEMPERATURE, make_calibration
from tests.export.test_formulas import SINGLE

from inercal.basics.arrays import Array
from inercal.basics.units import ZERO_CELSIUS
from inercal.calibration import Calibration
from inercal.export import export_calibration
from inercal.physics.sensors import triad

EXAMPLE = Path(__file__).parents[2] / "examples" / "arduino"
BOARDS = Path(__file__).with_name("boards")
PERIODS = 1000
FLAGS = ("-O1", "-Wall", "-Wextra", "-Werror", f"-DPERIODS={PERIODS}")
pytestmark = pytest.mark.skipif(
    shutil.which("gcc") is None or shutil.which("g++") is None, reason="gcc is not installed"
)


def accelerometers() -> Calibration:
    sensor = triad("three", "f", "a", COUNTS[0]).with_coefficients("bias", "scale")
    values = np.array([0.3, -0.2, 0.1, 2e-3, -3e-3, 1e-3])
    return Calibration(sensor, values, np.eye(6) * 1e-12, validity=RANGES)


CALIBRATIONS = {
    "linear": lambda: make_calibration(*LINEAR, readouts=COUNTS),
    "temperature": lambda: make_calibration(*LINEAR, *TEMPERATURE, readouts=COUNTS),
    "accelerometers": accelerometers,
}


@dataclass
class Project:
    """A copy of the example, with the header of a calibration in its sketch."""

    folder: Path
    calibration: Calibration

    def compiled(self, name: str, *sources: Path) -> Path:
        """Return a program of sources in C, C++ and Arduino's language."""
        sketch, objects = self.folder / "calibrated_imu", list[Path]()
        for source in sources:
            objects.append(self.folder / f"{name}_{source.stem}.o")
            language = ["-x", "c++", "-include", "Arduino.h"] * (source.suffix == ".ino")
            standard = "-std=c99" if source.suffix == ".c" else "-std=c++11"
            command = ["gcc" if source.suffix == ".c" else "g++", standard, *FLAGS]
            command += ["-I", str(sketch), "-I", str(BOARDS), *language, "-c", str(source)]
            done([*command, "-o", str(objects[-1])])
        program = self.folder / name
        done(["g++", *map(str, objects), "-o", str(program)])
        return program

    def require_corrected(self, printed: str) -> None:
        """Compare what a program printed with inercal's correction of the driver's samples."""
        driver = self.folder / "calibrated_imu" / "imu_source.c"
        samples = table(done([self.compiled("samples", BOARDS / "samples.c", driver)]))
        sensor = self.calibration.sensor
        assert samples.shape == (PERIODS, len(sensor.axes) + 1)
        dT = samples[:, -1] + ZERO_CELSIUS - sensor.reference_temperature
        seen = self.calibration.correct(samples[:, :-1], dT=dT if sensor.uses("dT") else None)
        found, kinds = table(printed), dict.fromkeys(axis.measures for axis in sensor.axes)
        assert found.shape == (PERIODS, 3 * len(kinds))
        for k, kind in enumerate(kinds):
            part, wanted = found[:, 3 * k : 3 * k + 3], getattr(seen, kind)
            limit = SINGLE * np.abs(wanted).max() + 0.5e-6  # six digits are printed
            np.testing.assert_allclose(part, wanted, rtol=0, atol=limit)


def done(command: list[str] | list[Path], **more: str) -> str:
    ended = subprocess.run(
        command, capture_output=True, text=True, check=False, env=os.environ | more
    )
    assert ended.returncode == 0, ended.stderr + ended.stdout
    return ended.stdout


def table(text: str) -> Array:
    return np.array([[float(x) for x in line.split(",")] for line in text.splitlines()])


@pytest.fixture(params=[slow(name) if name == "linear" else name for name in CALIBRATIONS])
def project(request: pytest.FixtureRequest, tmp_path: Path) -> Project:
    folder = tmp_path / "arduino"
    shutil.copytree(EXAMPLE, folder)
    calibration = CALIBRATIONS[request.param]()
    made = export_calibration(calibration, "c", name="imu")
    (folder / "calibrated_imu" / "imu.h").write_text(made.text, encoding="ascii")
    return Project(folder, calibration)


@pytest.mark.slow
def test_the_sketch_prints_the_corrected_samples(project: Project):
    sketch = project.folder / "calibrated_imu"
    sources = (sketch / "calibrated_imu.ino", sketch / "imu_source.c", BOARDS / "arduino_main.cpp")
    project.require_corrected(done([project.compiled("sketch", *sources)]))


@pytest.mark.slow
def test_the_project_for_esp_idf_prints_the_corrected_samples(project: Project):
    if shutil.which("cmake") is None:
        pytest.skip("cmake is not installed")
    source, build = project.folder / "esp_idf", project.folder / "build"
    stated = {"IDF_PATH": str(BOARDS), "PERIODS": str(PERIODS)}
    done(["cmake", "-S", str(source), "-B", str(build)], **stated)
    done(["cmake", "--build", str(build)], **stated)
    project.require_corrected(done([build / "main" / "calibrated_imu"]))


def test_the_sketch_stops_if_the_board_does_not_reproduce_the_check(tmp_path: Path):
    folder = tmp_path / "arduino"
    shutil.copytree(EXAMPLE, folder)
    made = export_calibration(make_calibration(*LINEAR, readouts=COUNTS), "c", name="imu")
    text, count = re.subn(r"(expected\[\] = \{)([-\d.e]+)f", r"\g<1>123.0f", made.text)
    assert count == 1
    sketch = folder / "calibrated_imu"
    (sketch / "imu.h").write_text(text, encoding="ascii")
    sources = (sketch / "calibrated_imu.ino", sketch / "imu_source.c", BOARDS / "arduino_main.cpp")
    program = Project(folder, make_calibration()).compiled("sketch", *sources)
    lines = set(done([program]).splitlines())
    assert len(lines) == 1
    assert "check" in lines.pop()


def test_the_header_states_the_numbers_of_readings_and_results():
    made = export_calibration(CALIBRATIONS["temperature"](), "c", name="left arm")
    for line in ("LEFT_ARM_READINGS 6", "LEFT_ARM_RESULTS 6", "LEFT_ARM_TAKES_TEMPERATURE 1"):
        assert f"#define {line}\n" in made.text
