"""The level earth rate turns in the case while the table turns, and is neither noise nor a change.

The recordings are plain numpy: one gyro along z, with the axes x, y and z up in turn.
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from inercal.pipeline import calibrate
from inercal.pipeline.design.worksheet import build_worksheet
from inercal.pipeline.outcome import Outcome
from inercal.runfile import read

HZ = 20.0
EARTH = 7.292115e-5  # rad/s
DEG = np.pi / 180
RATES = (0, 10, 20, 50, 100, 50, 20, 10, 0, -10, -20, -50, -100, -50, -20, -10, 0)
WHITE = 0.02  # °/√h
RUN = """
[sensor]
name = "F"
[sensor.gyro]
axis = "z"
unit = "rad/s"
white = "0.02 °/√h"
[bench]
kind = "rate_platform"
latitude = "{latitude} °"
rate_scale = "10 ppm"
rate_asymmetry = "2 ppm"
rate_stability = "2 ppm"
setting = "0.02 °"
[data]
file = "log.csv"
rate = "20 Hz"
gyro = ["gz"]
label = "label"
marks = "labels"
[method]
name = "rates_and_poses"
"""


def session(
    folder: Path,
    seed: int,
    latitude: float,
    *,
    same_start: bool,
    rates: Sequence[float] = RATES,
    jump: float = 0.0,
) -> Outcome:
    """Calibrate a gyro whose readings jump by `jump` rad/s within the section "x +20 (2)"."""
    rng = np.random.default_rng(seed)
    time = (np.arange(round(36 * HZ)) + 0.5) / HZ
    white = WHITE * DEG / 60 * np.sqrt(HZ)
    readings: list[NDArray[np.float64]] = []
    labels: list[str] = []
    for axis in "xyz":
        rest, seen = rng.uniform(0, 2 * np.pi), dict[float, int]()
        for rate in rates:
            azimuth = rest if same_start or not rate else rng.uniform(0, 2 * np.pi)
            w = np.full(time.size, rate * DEG + EARTH * np.sin(latitude * DEG))
            if axis != "z":
                w = EARTH * np.cos(latitude * DEG) * np.cos(azimuth + rate * DEG * time)
            seen[rate] = seen.get(rate, 0) + 1
            label = f"{axis} {rate:+g} ({seen[rate]})"
            read_ = w + white * rng.standard_normal(time.size)
            if label == "x +20 (2)":
                read_[time.size // 2 :] += jump
            readings.append(read_)
            labels += [label] * time.size
    lines = [f"{x:.12g},{label}" for x, label in zip(np.concatenate(readings), labels, strict=True)]
    (folder / "log.csv").write_text("\n".join(["gz,label", *lines]))
    (folder / "run.toml").write_text(RUN.format(latitude=latitude))
    return calibrate(read(folder / "run.toml"))


@pytest.mark.slow
@pytest.mark.parametrize("same_start", [True, False])
def test_the_turning_earth_rate_is_no_noise(tmp_path: Path, same_start: bool):
    made = session(tmp_path, 1, 52.0, same_start=same_start)
    pole = session(tmp_path, 1, 90.0, same_start=same_start)
    assert made.verdict.grade == "consistent"
    expected = pole.calibration.uncertainty("gz.bias")
    assert made.calibration.uncertainty("gz.bias") < 1.2 * expected


def test_a_jump_within_a_section_still_shows(tmp_path: Path):
    jump = 10 * DEG / 3600
    made = session(tmp_path, 1, 52.0, same_start=True, jump=jump)
    assert made.verdict.grade != "consistent"


@pytest.mark.parametrize(("rates", "partial"), [('["5 °/s", "20 °/s"]', 6), ('["20 °/s"]', 0)])
def test_a_plan_of_a_recording_names_sections_of_less_than_a_turn(
    tmp_path: Path, rates: str, partial: int
):
    (tmp_path / "run.toml").write_text(RUN.format(latitude=52) + f"positions = 3\nrates = {rates}")
    made = build_worksheet(read(tmp_path / "run.toml"))
    noted = [note for note in made.sheet.notes if "less than one turn" in note]
    assert [int(note.split()[0]) for note in noted] == [partial] * bool(partial)
    assert all("takes 72 s" in note for note in noted)
