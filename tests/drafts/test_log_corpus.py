"""Logs in the forms of public exporters: drafted and calibrated at the first try.

The truth of each log is known. The data decide the columns and units; what they cannot tell, such
as the rate of a log without times, is stated, at most one value for each log.
"""

from functools import partial
from pathlib import Path

import numpy as np
import pytest
from scipy.special import chdtri
from tests.base_seeds import evidence, slow
from tests.log_corpus.cases import CASES, Case, gravities
from tests.log_corpus.judge import Judgement, judge
from tests.log_corpus.motion import Motion, by_hand
from tests.log_corpus.text_forms import Form, Written, write_text

from inercal.basics.errors import InputError
from inercal.pipeline.drafts import draft_run_file

NAMES = tuple(CASES)
GRAVITIES = dict(zip(NAMES, gravities(len(NAMES)).tolist(), strict=True))
FEW = NAMES[3::24]
FIRST_SEED = 2000


def judged(name: str, folder: Path) -> Judgement:
    """Return what becomes of a log."""
    own = folder / f"case_{NAMES.index(name)}"
    own.mkdir()
    return judge(CASES[name], own, FIRST_SEED + NAMES.index(name), GRAVITIES[name])


def test_the_corpus_is_large_and_asks_little():
    assert len(CASES) >= 60
    assert all(len(case.stated) <= 1 for case in CASES.values())


@pytest.mark.slow
@pytest.mark.parametrize("name", FEW)
def test_a_log_is_calibrated_at_the_first_try(name: str, tmp_path: Path):
    found = judged(name, tmp_path)
    assert (found.refusal, found.asked) == ("", ())
    assert (found.wrong_columns, found.wrong_units) == ((), ())
    assert max(map(abs, found.errors.values())) < 5


@pytest.mark.parametrize("names", [slow(NAMES[1::8]), evidence(NAMES)], ids=["an eighth", "all"])
def test_logs_are_calibrated_at_the_first_try_and_u_is_right(
    names: tuple[str, ...], tmp_path: Path
):
    found = {name: judged(name, tmp_path) for name in names}
    wrong = {name: one for name, one in found.items() if one.wrong_columns or one.wrong_units}
    assert not wrong
    failed = {name: one for name, one in found.items() if one.refusal or one.asked}
    assert len(failed) <= 0.05 * len(found), failed
    doubted = [name for name, one in found.items() if one.grade == "unreliable"]
    assert len(doubted) <= 0.05 * len(found), doubted
    errors = np.array([error for one in found.values() for error in one.errors.values()])
    # Of few errors, within the two-sided 99.9 % band of χ².
    low, high = np.sqrt(chdtri(errors.size, [0.9995, 0.0005]) / errors.size)
    assert min(low, 0.9) < np.sqrt(np.mean(errors**2)) < max(high, 1.1)


AW = ("a|a{x}", "w|g{x}")
REFUSED: dict[str, tuple[Form, Motion, str, tuple[str, ...]]] = {
    "gravity was removed": (
        Form(("t|t", "l|Linear Acceleration {x} (m/s^2)", "w|g{x}")),
        Motion(),
        "data.accelerometer",
        (),
    ),
    "gravity was removed, without names": (Form(("t|t", "l|{x}")), Motion(), "", ("t", "x")),
    "only gyros": (Form(("t|t", "w|g{x}")), Motion(), "data.accelerometer", ("t", "gx")),
    "only a magnetometer": (Form(("t|t", "m|mag_{x}")), Motion(), "", ("t", "mag_x")),
    "two accelerometers": (
        Form(("t|t", "a.xy|a{x}", "w|g{x}")),
        Motion(),
        "data.accelerometer",
        ("t", "ax"),
    ),
    "three rests": (Form(("t|t", *AW)), Motion(rests=3), "", ("method",)),
}


@pytest.mark.parametrize("name", REFUSED)
def test_a_log_that_cannot_be_calibrated_is_refused_for_its_reason(name: str, tmp_path: Path):
    form, motion, key, names = REFUSED[name]
    written = write_text(by_hand(5, motion), form, tmp_path, "log")
    with pytest.raises(InputError) as caught:
        draft_run_file(written.files, tmp_path / "run.toml", {})
    assert (caught.value.key or "") == key
    assert caught.value.names[: len(names)] == names
    assert "\n" not in str(caught.value)


ASKED: dict[str, tuple[Form, Motion, str]] = {
    "no clock": (Form(AW), Motion(), "[data] rate"),
    "whole seconds": (Form(("date|date", *AW)), Motion(), "[data] rate"),
    "no rest shows the gyros": (
        Form(("t|t", *AW)),
        Motion(rests=1, still=20),
        "[sensor.gyro] unit",
    ),
    "an unusual unit": (
        Form(("t|t", *AW), counts=(7.7, 131.0)),
        Motion(),
        "[sensor.accelerometer] unit",
    ),
}


@pytest.mark.parametrize("name", ASKED)
def test_what_the_data_cannot_tell_is_asked_for(name: str, tmp_path: Path):
    form, motion, key = ASKED[name]
    found = judge(Case(partial(_written, form, motion)), tmp_path, 5, 9.8)
    assert found.asked == (key,)
    assert not found.wrong_columns


def _written(form: Form, motion: Motion, folder: Path, seed: int, gravity: float) -> Written:
    return write_text(by_hand(seed, motion, gravity), form, folder, "log")
