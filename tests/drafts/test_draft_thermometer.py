"""`init` asks for the unit of a thermometer that cannot be in °C, and for its scale and zero."""

from pathlib import Path

import numpy as np

import inercal
from inercal.pipeline.drafts import draft_run_file

COUNTS = {
    "data.temperature_unit": "LSB",
    "data.temperature_scale": "340 LSB/K",
    "data.temperature_zero": "36.53 °C",
}


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


def test_degrees_need_no_question_and_kelvin_are_recognised(tmp_path: Path):
    assert not questions(tmp_path, 25, {})
    for kelvin in (295, 310):
        draft = draft_run_file([log(tmp_path / "b.csv", kelvin)], tmp_path / "b.toml")
        assert [one.value for one in draft.entries if one.key == "temperature_unit"] == ["K"]
