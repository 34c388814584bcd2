"""A check standard before each job for 30 days; from day 26 on the voltmeter of x reads low.

Enters all calibrations into a register and charts REF-1 by `inercal control`.
"""

import subprocess
import sys
from datetime import date, timedelta
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

import inercal
from inercal.laboratory.store import Register

HERE = Path(__file__).parent
FACES = np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]], float)
LABELS = ["x_p", "x_a", "y_p", "y_a", "z_p", "z_a"]
rng = np.random.default_rng(26)


def readings(offset: float) -> dict[str, list[object]]:
    """Return six faces in g: own bias and scale factor, a new turn-on and mounting each day."""
    bias = np.array([5e-3, -3e-3, 8e-3]) + 60e-6 * rng.standard_normal(3)
    scale = 1 + np.array([1e-3, -2e-3, 5e-4]) + 30e-6 * rng.standard_normal(3)
    force = FACES + np.cross(40e-6 * rng.standard_normal(3), FACES)
    noise = 10e-6 * rng.standard_normal((6, 3))
    columns = (force * scale + bias + noise).T
    columns[0] += offset
    table: dict[str, list[object]] = {"position": [*LABELS]}
    for axis, column in zip("xyz", columns, strict=True):
        table[f"acc_{axis}"] = column.tolist()
    return table


def calibrate(name: str, offset: float) -> inercal.Calibration:
    """Return a calibration of one session on bench "plate 1"."""
    return inercal.calibrate(
        readings(offset),
        method="six_position",
        sensor={"name": name, "accelerometer": {"unit": "g"}},
        bench={"name": "plate 1", "gravity": "9.80775 m/s² ± 0.2 mm/s²", "tilt": "0.003 °"},
        kind="means",
        label="position",
        sd={"accelerometer": "10 µg"},
    ).calibration


with TemporaryDirectory() as folder:
    path = f"{folder}/register.db"
    with Register(path, by="Ada") as register:
        for day in range(30):
            offset = -400e-6 if day >= 25 else 0.0
            when = date(2026, 3, 1) + timedelta(days=day)
            register.enter_calibration(calibrate("REF-1", offset), measured=f"{when}T08:00:00")
            if day in (22, 26, 28):
                job = calibrate(f"JOB-{day}", offset)
                register.enter_calibration(job, measured=f"{when}T10:00:00")
    verb = ["control", "--sensor", "REF-1", "--register", path, "--out", ".", "--force"]
    program = [sys.executable, "-m", "inercal"]
    subprocess.run([*program, *verb], check=True)
