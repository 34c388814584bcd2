"""A session of six positions and three turns in Python: from its CSV to corrected readings."""

import json
from pathlib import Path

import pandas as pd

import inercal

FOLDER = Path(__file__).parents[3] / "shared" / "data" / "ferraris_imucal"
readings = pd.read_csv(FOLDER / "example_ferraris_session.csv")
marks = json.loads((FOLDER / "example_ferraris_session_list.json").read_text(encoding="utf-8"))
outcome = inercal.calibrate(
    readings,
    method={"name": "ferraris", "turn": "-360 °"},
    sensor={"accelerometer": {"unit": "m/s²"}, "gyro": {"unit": "°/s"}},
    bench={
        "gravity": "9.81 m/s² ± 5 mm/s²",
        "tilt": "0.5 °",
        "turn_angle": "2 °",
        "turn_tilt": "1 °",
    },
    time="n_samples",
    time_unit="sample",
    rate="102.4 Hz",
    marks=marks,
)
print(outcome.verdict)
print(outcome.calibration.to_dataframe())
motion = outcome.calibration.correct(
    readings[["acc_x", "acc_y", "acc_z", "gyr_x", "gyr_y", "gyr_z"]].to_numpy()
)
print(motion.f[:3], motion.w[:3])  # m/s², rad/s
