"""`init` asks for the unit of a thermometer that cannot be in °C, and for its scale and zero."""

from pathlib import Path

import numpy as np
import pytest

import inercal
from inercal.pipeline.drafts import draft_run_file
from inercal.pipeline.drafts.quiet_sections import find_quiet_sections

COUNTS = {
    "data.temperature_unit": "LSB",
    "data.temperature_scale": "340 LSB/K",
    "data.temperature_zero": "36.53 °C",
}

PARTS = ((0, 0, 1), None, (0, 1, 0), (1, 0, 0), None, (0, 0, -1), (0, -1, 0))


def log(path: Path, temperature: float) -> Path:
    """Write a log of six positions with a movement after each."""
    rng = np.random.default_rng(0)
    blocks = [
        np.concatenate(
            [9.8 * up + 0.01 * rng.normal(size=(200, 3)), 9.8 * rng.normal(size=(60, 3))]
        )
        for up in (*np.eye(3), *-np.eye(3))
    ]
    force = np.concatenate(blocks)
    time = 0.01 * np.arange(len(force))
    rows = np.column_stack([time, force, np.full(time.size, temperature)])
    np.savetxt(path, rows, "%.6g", ",", header="t,ax,ay,az,temp", comments="")
    return path


def questions(tmp_path: Path, temperature: float, stated: dict[str, str]) -> list[str]:
    draft = draft_run_file([log(tmp_path / "a.csv", temperature)], tmp_path / "a.toml", stated)
    return [f"{one.section}.{one.key}" for one in draft.questions]


def test_raw_counts_are_asked_for_their_unit_then_for_scale_and_zero(tmp_path: Path):
    unit, *others = COUNTS
    assert questions(tmp_path, -1812, {}) == [unit]
    assert questions(tmp_path, -1812, {unit: "LSB"}) == others
    draft = draft_run_file([tmp_path / "a.csv"], tmp_path / "a.toml", COUNTS)
    assert not draft.questions
    draft.path.write_text(draft.text, encoding="utf-8")
    outcome = inercal.calibrate(draft.path)
    assert outcome.calibration.validity is not None
    low, high = outcome.calibration.validity.temperature or (0.0, 0.0)
    assert low == high == np.float64(36.53 - 1812 / 340 + 273.15)


@pytest.mark.slow
def test_degrees_need_no_question_and_kelvin_are_recognised(tmp_path: Path):
    assert not questions(tmp_path, 25, {})
    for kelvin in (295, 310):
        draft = draft_run_file([log(tmp_path / "b.csv", kelvin)], tmp_path / "b.toml")
        assert [one.value for one in draft.entries if one.key == "temperature_unit"] == ["K"]


def test_the_name_of_the_thermometer_states_its_unit(tmp_path: Path):
    path = log(tmp_path / "a.csv", 77)
    path.write_text(path.read_text(encoding="utf-8").replace("temp", "temp_F", 1), encoding="utf-8")
    draft = draft_run_file([path], tmp_path / "a.toml")
    assert [one.value for one in draft.entries if one.key == "temperature_unit"] == ["°F"]


def test_rests_of_two_files_stay_apart():
    block = np.random.default_rng(0).normal(0, 1e-3, (240, 3))
    moved = np.random.default_rng(1).normal(0, 1.0, (60, 3))
    data = np.concatenate([block + up if up is not None else moved for up in PARTS])
    assert len(find_quiet_sections(data, 24)) == 5
