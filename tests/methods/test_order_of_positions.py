"""Steps, hysteresis and a constant vibration in six positions: told where they cannot be seen."""

from collections.abc import Sequence
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from tests.base_seeds import evidence

import inercal
from inercal.pipeline import Outcome

ROOT = Path(__file__).parents[2]
UPS = {a + s: k * np.eye(3)[i] for i, a in enumerate("xyz") for s, k in (("_p", 1), ("_a", -1))}
SIX = tuple(UPS)
SD, TILT, PLACEMENT = 30e-6, 0.1, 0.002  # g, °, °
MG = 1e-3  # g
EFFECTS = {
    "step": "step of the accelerometers between two positions",
    "before": "hysteresis of the accelerometers",
    "sense": "hysteresis of the accelerometers",
    "vibration": "vibration rectification of the accelerometers",
}


def readings(order: Sequence[str], effect: str, size: float, seed: int) -> np.ndarray:
    """Return mean readings of positions in their order, (r, 3) g, with one effect of a size."""
    rng = np.random.default_rng(seed)
    faces = {name: np.radians(TILT) * rng.standard_normal(3) for name in UPS}
    ups = np.array([UPS[name] for name in order])
    lean = [faces[n] + np.radians(PLACEMENT) * rng.standard_normal(3) for n in order]
    f = ups + np.cross(np.array(lean), ups)
    f /= np.linalg.norm(f, axis=1)[:, None]
    y = f * (1 + 2e-3 * rng.standard_normal(3)) + 0.02 * rng.standard_normal(3)
    y += SD * rng.standard_normal(y.shape)
    before = np.vstack([np.zeros(3), ups[:-1]])
    if effect == "step":
        y[3:] += size
    if effect == "before":
        y += size / 2 * before
    if effect == "sense":
        sense = np.zeros(3)
        for k, here in enumerate(ups):
            sense = np.where(here != before[k], np.sign(here - before[k]), sense)
            y[k] += size / 2 * sense
    if effect == "vibration":
        y += size
    return y


def labelled(order: Sequence[str]) -> list[str]:
    """Return the label of each visit: the second of "x_p" is "x_p (2)"."""
    seen = [order[:k].count(name) for k, name in enumerate(order)]
    return [f"{n} ({k + 1})" if k else n for n, k in zip(order, seen, strict=True)]


def calibrated(order: Sequence[str], effect: str = "", size: float = 0.0, seed: int = 1) -> Outcome:
    y = readings(list(order), effect, size, seed)
    columns = {f"acc_{a}": y[:, k] for k, a in enumerate("xyz")}
    return inercal.calibrate(
        {"position": labelled(list(order)), **columns},
        method="six_position",
        sensor={"accelerometer": {"unit": "g"}},
        bench={
            "gravity": "9.80665 m/s² ± 0.2 mm/s²",
            "tilt": f"{TILT} °",
            "placement": f"{PLACEMENT} °",
        },
        kind="means",
        label="position",
        sd={"accelerometer": f"{SD * 1e6:g} µg"},
    )


@cache
def usual_session() -> Outcome:
    return calibrated(SIX)


def unseen(outcome: Outcome) -> dict[str, str]:
    """Return what is told to be unseen, with what would show it."""
    told = [one.message for one in outcome.findings if one.what == "unseen"]
    return {name: rest for name, _, rest in (t.partition(": ") for t in told)}


@pytest.mark.slow
@pytest.mark.parametrize(("effect", "size"), [("step", 2 * MG), ("before", MG), ("sense", MG)])
def test_six_positions_tell_an_effect_of_their_order_that_they_cannot_see(effect: str, size: float):
    usual = usual_session().calibration
    moved = [calibrated(SIX, effect, size, seed) for seed in range(6)]
    quiet = [one for one in moved if one.verdict.grade == "consistent"]
    assert len(quiet) >= 4
    shifts = np.abs(moved[1].calibration.values - usual.values) / usual.std
    assert shifts.max() > 5
    assert all(EFFECTS[effect] in unseen(one) for one in quiet)
    notes = (" ".join(one.calibration.notes) for one in quiet)
    assert all(EFFECTS[effect] in text for text in notes)


@pytest.mark.slow
@pytest.mark.parametrize(("effect", "size"), [("step", 2 * MG), ("before", MG), ("sense", MG)])
@pytest.mark.parametrize("more", [("x_p", "y_p", "z_p"), evidence(SIX[::-1])])
def test_positions_that_are_visited_again_show_it(effect: str, size: float, more: Sequence[str]):
    for seed in range(4):
        assert calibrated((*SIX, *more), effect, size, seed).verdict.grade != "consistent"


@pytest.mark.slow
@pytest.mark.parametrize("sessions", [8, evidence(20)])
def test_positions_that_are_visited_again_raise_no_false_alarm(sessions: int):
    grades = [calibrated((*SIX, *SIX[::-1]), seed=seed).verdict.grade for seed in range(sessions)]
    assert grades.count("consistent") >= sessions - 1


@pytest.mark.slow
def test_a_size_that_is_told_shifts_a_coefficient_by_five_u():
    outcome = usual_session()
    told = next(o.message for o in outcome.findings if EFFECTS["step"] in o.message)
    size = float(told.partition(": ")[2].partition(" µg")[0]) * 1e-6
    usual = outcome.calibration
    worst = 0.0
    for first in range(1, 6):
        y = readings(SIX, "", 0.0, 1)
        y[first:] += size
        there = calibrated_from(y)
        worst = max(worst, float(np.max(np.abs(there.values - usual.values) / usual.std)))
    assert worst == pytest.approx(5.0, rel=0.1)


def calibrated_from(y: np.ndarray) -> inercal.Calibration:
    columns = {f"acc_{a}": y[:, k] for k, a in enumerate("xyz")}
    return inercal.calibrate(
        {"position": list(SIX), **columns},
        method="six_position",
        sensor={"accelerometer": {"unit": "g"}},
        bench={
            "gravity": "9.80665 m/s² ± 0.2 mm/s²",
            "tilt": f"{TILT} °",
            "placement": f"{PLACEMENT} °",
        },
        kind="means",
        label="position",
        sd={"accelerometer": f"{SD * 1e6:g} µg"},
    ).calibration


def test_a_constant_vibration_is_told_in_any_order():
    for order in (SIX, (*SIX, *SIX[::-1])):
        outcome = calibrated(order, "vibration", 2 * MG)
        assert outcome.verdict.grade == "consistent"
        assert EFFECTS["vibration"] in unseen(outcome)


def test_no_size_is_told_that_no_bias_has(data_dir: Path, tmp_path: Path):
    # A step before a turn acts on the mean force of the turn alone: it moves no coefficient.
    example = ROOT / "examples" / "ferraris_recordings" / "session_a.toml"
    text = example.read_text(encoding="utf-8").replace("../../../shared/data", str(data_dir))
    run_file = tmp_path / "session_a.toml"
    run_file.write_text(text.replace('tilt = "0.5 °"', 'tilt = "0.01 °"'), encoding="utf-8")
    told = [one.message for one in inercal.calibrate(run_file).findings if one.what == "unseen"]
    sizes = [float(one.partition(": ")[2].partition(" µg")[0]) for one in told if "µg" in one]
    assert sizes
    assert max(sizes) < 1e5
