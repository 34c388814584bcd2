"""Only scale factors that change alike point to gravity; calibrations are made without inercal."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from tests.store.calibration_generator import DRIFTING, G0, IMU, Truth, content, write

from inercal.calibration.comparison import compare
from inercal.calibration.comparison.common_scale import common_scale_lines
from inercal.calibration.files import load
from inercal.laboratory.store import Register
from inercal.laboratory.store.history_text import history_lines

STEADY = replace(DRIFTING, drift={})
ALL = {f"{axis}.{'k1' if axis[0] == 'a' else 'scale'}": 0.0 for axis in IMU}


def lines(folder: Path, seed: int, drift: dict[str, float], scale: float = 1.0) -> list[str]:
    """Compare two calibrations a year apart, the second with U multiplied by `scale`."""
    rng = np.random.default_rng(seed)
    truth = Truth("IMU", IMU, STEADY.start, drift)
    made = [
        write(folder / f"{k}.json", content(truth, k, rng, factor=scale if k else 1.0))
        for k in (0, 1)
    ]
    return list(common_scale_lines(compare(*map(load, made))))


def changed(letter: str, size: float) -> dict[str, float]:
    return {name: size for name in ALL if name[0] == letter}


@pytest.mark.parametrize(("letter", "words"), [("a", "gravity"), ("g", "clock")])
def test_a_common_change_of_the_scale_factors_is_named(letter: str, words: str, tmp_path: Path):
    found = [lines(tmp_path, seed, changed(letter, 500e-6)) for seed in range(20)]
    # One of 24 other coefficients beyond 3 u by chance withholds the line.
    assert sum(len(one) == 1 and words in one[0] for one in found) >= 16


def test_the_equivalent_gravity_is_stated_with_its_direction(tmp_path: Path):
    (line,) = lines(tmp_path, 0, changed("a", 500e-6))
    size = float(line.partition("stated ")[2].split()[0])
    assert size == pytest.approx(500e-6 * G0 * 1e3, rel=0.1)
    assert "low in the second" in line
    (line,) = lines(tmp_path, 0, changed("a", -500e-6))
    assert "high in the second" in line


@pytest.mark.parametrize(
    "drift",
    [
        {},
        {"ax.k1": 500e-6},
        {"ax.k1": 500e-6, "ay.k1": 500e-6},
        {"ax.k1": 500e-6, "ay.k1": 500e-6, "az.k1": 700e-6},
        changed("a", 500e-6) | {"ax.k0": 1e-3 * G0},
    ],
)
def test_other_changes_are_not(drift: dict[str, float], tmp_path: Path):
    assert not any(lines(tmp_path, seed, drift) for seed in range(20))


def test_a_history_names_it_for_its_two_newest_calibrations(tmp_path: Path):
    rng = np.random.default_rng(0)
    drifts: tuple[dict[str, float], ...] = ({}, {}, changed("a", 250e-6))
    paths = [
        write(
            tmp_path / f"{k}.calibration.json",
            content(Truth("IMU", IMU, STEADY.start, drift), float(k), rng),
        )
        for k, drift in enumerate(drifts)
    ]
    with Register(str(tmp_path / "register.db")) as register:
        register.enter_calibrations(paths)
        found = " ".join(history_lines(register.history("IMU")))
    assert "gravity stated" in found
