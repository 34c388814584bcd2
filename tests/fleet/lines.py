"""Lines for tests: sensors of known errors in six positions, by code apart from the package."""

import csv
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from inercal.fleet import results
from inercal.fleet.latest import latest_results
from inercal.fleet.line import read_line

FACES = ("x_p", "x_a", "y_p", "y_a", "z_p", "z_a")
TEMPLATE = """
[sensor]
[sensor.accelerometer]
unit = "g"
[bench]
gravity = "9.81 m/s² ± 0.1 mm/s²"
tilt = "0.1 °"
[data]
time = "t"
accelerometer = ["x", "y", "z"]
label = "face"
marks = "labels"
[method]
name = "six_position"
"""
# What differs from one time to another though the result is the same.
_PASSING = ("created", "seconds", "calibration", "mark", "generation")


def readings(seed: int, each: int = 100) -> tuple[dict[str, np.ndarray], np.ndarray]:
    """Return the columns of a recording and the biases of its sensor, g."""
    rng = np.random.default_rng([7, seed])
    bias, scale = rng.normal(0, 0.01, 3), 1 + rng.normal(0, 0.003, 3)
    face = np.repeat(FACES, each)
    f = np.zeros((face.size, 3))
    for name in FACES:
        f[face == name, "xyz".index(name[0])] = 1.0 if name.endswith("_p") else -1.0
    a = f * scale + bias + rng.normal(0, 1e-4, f.shape)
    columns = dict(zip("xyz", a.T, strict=True))
    return {"t": np.arange(face.size) / 100, **columns, "face": face}, bias


def write_recording(path: Path, seed: int, each: int = 100) -> None:
    """Write the recording of a sensor."""
    columns, _ = readings(seed, each)
    path.parent.mkdir(parents=True, exist_ok=True)
    np.savez(path, allow_pickle=False, **columns)


def write_table(folder: Path, rows: Sequence[Sequence[str]], more: Sequence[str] = ()) -> None:
    """Write the table of sensors: id, recording and further columns."""
    with (folder / "sensors.csv").open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(("id", "recording", *more))
        writer.writerows(rows)


def make_line(folder: Path, number: int, each: int = 100, template: str = TEMPLATE) -> Path:
    """Write a line of so many sensors."""
    names = [f"S{k:03d}" for k in range(number)]
    for k, name in enumerate(names):
        write_recording(folder / "recordings" / f"{name}.npz", k, each)
    (folder / "run.toml").write_text(template, encoding="utf-8")
    write_table(folder, [(name, f"recordings/{name}.npz") for name in names])
    return folder


def rows_of(folder: Path) -> list[dict[str, Any]]:
    """Return the results of a line without what passes."""
    found = latest_results(read_line(folder), folder / results.FOLDER).to_pylist()
    return [{key: row[key] for key in row if key not in _PASSING} for row in found]
