"""A new accelerometer triad, and when to calibrate it next: by six others of its type.

Each of the six was calibrated in three years; their biases drift by some 60 µg a year, each by its
own rate. Of the new one there is one calibration.
"""

from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

import inercal
from inercal.calibration import Calibration
from inercal.laboratory.store import Register
from inercal.laboratory.store.history_text import interval_text, recalibration_lines
from inercal.laboratory.store.recalibration import recalibration
from inercal.laboratory.store.type_pool import type_pool

rng = np.random.default_rng(1)
positions = ["x_p", "x_a", "y_p", "y_a", "z_p", "z_a"]
up = np.repeat(np.eye(3), 2, axis=0) * np.array([1.0, -1.0] * 3)[:, None]  # g
noise = 20e-6  # g, of a mean


def session(name: str, bias: np.ndarray) -> Calibration:
    """Return a calibration of a triad with biases in g, by six positions."""
    means = up + bias + noise * rng.standard_normal(up.shape)
    outcome = inercal.calibrate(
        {"position": positions} | {f"acc_{axis}": means[:, k] for k, axis in enumerate("xyz")},
        method="six_position",
        sensor={"name": name, "accelerometer": {"unit": "g"}},
        bench={"gravity": "9.80665 m/s² ± 0.0001 m/s²", "tilt": "0.01 °"},
        kind="means",
        label="position",
        sd={"accelerometer": "20 µg"},
    )
    return replace(outcome.calibration, job={"maker": "Q-Flex", "model": "QA 2000"})


with TemporaryDirectory() as folder, Register(str(Path(folder) / "register.db")) as register:
    for k in range(6):
        drift = 60e-6 * rng.standard_normal(3)  # g a year
        for year in range(3):
            found = session(f"TRIAD-{k}", year * drift)
            register.enter_calibration(found, measured=f"{2022 + year}-03-01")
    register.enter_calibration(session("TRIAD-9", np.zeros(3)), measured="2026-03-01")
    history = register.history("TRIAD-9")
    pool = type_pool(register, history)

next_one = recalibration(history, {"bias": "300 µg"}, pool=pool)
for row in next_one.rows:
    print(f"{row.name}: {interval_text(row.prediction)} days, by {row.sensors} sensors")
for line in recalibration_lines(next_one):
    print(line)
