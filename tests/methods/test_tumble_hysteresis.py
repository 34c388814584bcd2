"""A hysteresis of the accelerometer in a tumble test is named, beside what looks like it."""

from pathlib import Path

import numpy as np
import pytest

import inercal

ARCSEC = np.pi / 648_000
RUN_FILE = """
[sensor.accelerometer]
unit = "g"

[bench]
kind = "dividing_head"
gravity = "9.80665 m/s² ± 10 µm/s²"
division = "1 ″"
base = "8 ″"
drift = "20 µg"

[data]
kind = "means"
file = "means.csv"
accelerometer = ["a"]
angle = "angle"

[data.sd]
accelerometer = "30 µg"

[method]
name = "tumble"
"""


def tumbled(folder: Path, *, loop: float = 0.0, creep: float = 0.0, seed: int = 1) -> Path:
    """Write a tumble test of 36 positions there and back; `loop` in g, `creep` in ″ a pass."""
    rng = np.random.default_rng(seed)
    step = np.arange(36)
    angle, way = np.r_[step, step[::-1]] * 10, np.repeat([1, -1], 36)
    division = rng.normal(scale=ARCSEC, size=36)
    slow = np.linspace(-1.0, 1.0, 72) * creep * ARCSEC
    at = np.radians(angle) + np.r_[division, division[::-1]] + slow
    nominal = np.cos(np.radians(angle))
    rising = np.sign(np.where(np.abs(nominal) > 1e-9, nominal, 0.0)) * way
    read = 0.012 + 1.004 * np.sin(at) + 0.003 * np.cos(at) + 2e-4 * np.sin(at) ** 2
    read += -0.5 * loop * rising * (1 - np.sin(np.radians(angle)) ** 2)
    read += rng.normal(scale=30e-6, size=72)
    rows = [f"{a},{one:.9f}" for a, one in zip(angle, read, strict=True)]
    (folder / "means.csv").write_text("\n".join(["angle,a", *rows]) + "\n")
    path = folder / "run.toml"
    path.write_text(RUN_FILE, encoding="utf-8")
    return path


@pytest.mark.parametrize("size", [100e-6, 400e-6])
def test_a_hysteresis_is_named_with_its_size_and_no_creep_is_advised(tmp_path: Path, size: float):
    outcome = inercal.calibrate(tumbled(tmp_path, loop=size))
    found = outcome.verdict.suspect
    assert found is not None
    assert found.name == "hysteresis of a"
    assert abs(found.sizes[0] / 9.80665 - size) < 3 * found.sds[0] / 9.80665
    assert not any(one.changes for one in outcome.verdict.advice)
    assert any("hysteresis" in note for note in outcome.calibration.notes)


@pytest.mark.parametrize("seed", [1, 2, 5])
def test_a_small_hysteresis_cannot_be_distinguished_from_creep(tmp_path: Path, seed: int):
    found = inercal.calibrate(tumbled(tmp_path, loop=60e-6, seed=seed)).verdict.suspect
    assert found is not None
    assert {found.name, *found.indistinguishable} == {"hysteresis of a", "creep"}


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_creep_is_not_called_a_hysteresis(tmp_path: Path, seed: int):
    found = inercal.calibrate(tumbled(tmp_path, creep=40.0, seed=seed)).verdict.suspect
    assert found is not None
    assert found.name == "creep"


def test_without_either_the_data_are_consistent(tmp_path: Path):
    outcome = inercal.calibrate(tumbled(tmp_path))
    assert outcome.verdict.grade == "consistent"
    assert not any("hysteresis" in note for note in outcome.calibration.notes)
