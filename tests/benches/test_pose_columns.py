"""Mistakes in the columns of a table of poses are named."""

from pathlib import Path

import numpy as np
import pytest
from tests.refusals import refused

from inercal.benches.rate_platform.kind import KIND
from inercal.runfile import read

HEAD = """
[sensor.accelerometer]
unit = "g"
axis = ["x", "y"]
[bench]
kind = "rate_platform"
gravity = "9.81 m/s²"
attitude = "0.02 °"
mounting = "0.1 °"
[data]
kind = "means"
file = "poses.csv"
roll = "roll"
pitch = "pitch"
accelerometer = ["x", "y"]
[data.sd]
accelerometer = "0.1 mg"
[method]
name = "rates_and_poses"
"""
CORRECT = "roll,pitch,x,y"


@pytest.mark.parametrize(
    ("header", "times", "angle", "key", "words"),
    [
        (CORRECT, 1.0, np.pi / 180, "[data] angle_unit", ["rad"]),
        (CORRECT, 1000.0, 1.0, "[data] accelerometer", ["mg"]),
        ("roll,pitch,y,x", 1.0, 1.0, "[data] accelerometer", ['["y", "x"]']),
        ("pitch,roll,x,y", 1.0, 1.0, "[data] roll", ["exchange"]),
        (CORRECT, 1.0, 1.0, "", []),
    ],
)
def test_a_wrong_unit_or_exchanged_columns_of_poses_are_named(
    tmp_path: Path, header: str, times: float, angle: float, key: str, words: list[str]
):
    tilts = [-30, -20, -10, 10, 20, 30]
    poses = [(a, 0) for a in tilts] + [(0, a) for a in tilts]
    rows = [header]
    for roll, pitch in poses:
        x, y = (-np.sin(np.radians(pitch)), np.sin(np.radians(roll)) * np.cos(np.radians(pitch)))
        rows.append(f"{roll * angle:.6f},{pitch * angle:.6f},{x * times:.6f},{y * times:.6f}")
    (tmp_path / "poses.csv").write_text("\n".join(rows) + "\n", encoding="utf-8")
    (tmp_path / "run.toml").write_text(HEAD, encoding="utf-8")
    run = read(tmp_path / "run.toml")
    if not key:
        KIND.observe(run)
        return
    with refused(key=key) as raised:
        KIND.observe(run)
    assert all(word in str(raised.value) for word in words)
