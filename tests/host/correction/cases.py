"""A sensor of six channels, its calibration, and samples, for the tests of live correction."""

from pathlib import Path

import numpy as np

from inercal.calibration import Calibration
from inercal.calibration.validity import Validity
from inercal.runfile import Run, read

RUN = """
[sensor]
name = "imu"
{sensor}
[sensor.accelerometer]
unit = "g"
full_scale = "4 g"

[sensor.gyro]
unit = "°/s"

[bench]
latitude = "48.1 °"

[data]
file = "samples.csv"
{data}

[method]
name = "ferraris"
"""
NUMBERED = "time = 1\naccelerometer = [2, 3, 4]\ngyro = [5, 6, 7]"
NAMED = """
time = "t"
accelerometer = ["ax", "-ay", "az"]
gyro = ["gx", "gy", "gz"]
temperature = "temp"
"""
HEADER = "t,ax,ay,az,gx,gy,gz,temp"


def run_of(folder: Path, data: str = NUMBERED, sensor: str = "") -> Run:
    """Return a run with this section [data]; its file does not exist."""
    path = folder / "run.toml"
    path.write_text(RUN.format(data=data, sensor=sensor), encoding="utf-8")
    return read(path)


def calibration_of(run: Run, *terms: str, validity: Validity | None = None) -> Calibration:
    """Return a calibration whose coefficients are a thousandth of their unit scales, at random."""
    sensor = run.sensor.with_coefficients(*(terms or ("bias", "scale", "misalignment")))
    p = len(sensor.coefficients)
    values = 1e-3 * sensor.unit_scale * np.random.default_rng(0).normal(size=p)
    return Calibration(sensor, values, 1e-12 * np.eye(p), validity=validity, method="ferraris")


def lines(count: int, columns: int = 7) -> list[str]:
    """Return lines at 1 kHz with their ends; the eighth column is a temperature."""
    rng = np.random.default_rng(1)
    readings = rng.normal(size=(count, 6)).round(5)
    kelvin = rng.uniform(15, 25, size=(count, 1)).round(2)
    rows = np.hstack([readings, kelvin])[:, : columns - 1].tolist()
    return [f"{k / 1000:.3f}," + ",".join(map(str, row)) + "\n" for k, row in enumerate(rows)]
