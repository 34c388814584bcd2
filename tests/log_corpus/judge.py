"""Draft a run file for a log of the corpus, calibrate with it, and compare with the truth."""

from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
from tests.log_corpus.cases import Case, Written
from tests.log_corpus.motion import in_accelerometer_frame

import inercal
from inercal.basics.errors import InputError
from inercal.basics.units import si_factor
from inercal.pipeline.drafts import Draft, draft_run_file
from inercal.pipeline.drafts.log_files import read_logs
from inercal.pipeline.drafts.stated_keys import stated_values

_LIKE = {"accelerometer": "m/s²", "gyro": "rad/s"}
_WITHOUT_SCALE = ("LSB", "V", "mA")


class Judgement(NamedTuple):
    """What became of a log."""

    errors: Mapping[str, float] = MappingProxyType({})  # (estimate − truth) / u, by coefficient
    asked: tuple[str, ...] = ()
    wrong_columns: tuple[str, ...] = ()
    wrong_units: tuple[str, ...] = ()
    refusal: str = ""
    method: str = ""
    grade: str = ""


def judge(case: Case, folder: Path, seed: int, gravity: float) -> Judgement:
    """Draft and calibrate at the first try."""
    written = case.write(folder, seed, gravity)
    run = folder / "run.toml"
    try:
        draft = draft_run_file(written.files, run, case.stated, typical=case.typical)
    except InputError as error:
        return Judgement(refusal=str(error))
    keys = {f"{one.section}.{one.key}": one.value for one in draft.entries}
    wrong = _wrong_columns(written, keys, stated_values(case.stated))
    units, ratios = _units(written, keys)
    asked = tuple(one.name for one in draft.questions)
    if asked:
        return Judgement({}, asked, wrong, units)
    run.write_text(draft.text, encoding="utf-8")
    try:
        outcome = inercal.calibrate(run)
    except InputError as error:
        return Judgement({}, asked, wrong, units, str(error))
    method = str(keys["method.name"])
    found = outcome.calibration
    truth = dict(written.truth)
    if method == "multi_position":
        truth = in_accelerometer_frame(truth)
    errors: dict[str, float] = {}
    # The magnetometers of the logs have no truth, and other tests judge theirs.
    for name in found.sensor.select_axes("f", "w").coefficients:
        ratio = ratios["accelerometer" if name.startswith("a") else "gyro"]
        true = truth.get(name, 0.0) * ratio
        if name.endswith((".k1", ".scale")):
            true += ratio - 1
        errors[name] = (found.value(name) - true) / found.uncertainty(name)
    return Judgement(errors, (), wrong, units, "", method, outcome.verdict.grade)


def _wrong_columns(
    written: Written, keys: dict[str, object], stated: dict[str, object]
) -> tuple[str, ...]:
    """Return the triads of a draft that are not those of the log."""
    wrong: list[str] = []
    for kind, true in written.columns.items():
        found = keys.get(f"data.{kind}")
        found = found if isinstance(found, list) else []
        if true and isinstance(true[0], int):
            second = kind == "gyro" and "data.gyro_file" in keys
            read = read_logs(written.files, stated)
            names = (read.gyros if second and read.gyros else read.table).names
            found = [_place(names, str(one)) for one in found]
        if tuple(found) != tuple(true):
            wrong.append(f"{kind}: {found} instead of {true}")
    drafted = {key for key in ("data.accelerometer", "data.gyro") if keys.get(key)}
    if extra := drafted - {f"data.{kind}" for kind in written.columns}:
        wrong.append(f"{extra} does not exist")
    return tuple(wrong)


def _place(names: tuple[str, ...], column: str) -> int:
    """Return the place of a column, given by name or number; negative if it is reversed."""
    if column in names:
        return names.index(column) + 1
    if column.startswith("-"):
        return -_place(names, column[1:])
    return int(column) if column.isdecimal() else 0


def _units(written: Written, keys: dict[str, object]) -> tuple[tuple[str, ...], dict[str, float]]:
    """Return wrong units, and by how much a drafted nominal scale differs from that of the log."""
    wrong: list[str] = []
    ratios = dict.fromkeys(_LIKE, 1.0)
    for kind, true in written.units.items():
        found = str(keys.get(f"sensor.{kind}.unit"))
        if found == "?":
            continue
        scale = str(keys.get(f"sensor.{kind}.scale", ""))
        if true not in _WITHOUT_SCALE:
            if found in _WITHOUT_SCALE or si_factor(found, _LIKE[kind]) != si_factor(true):
                wrong.append(f"{kind}: {found} instead of {true}")
            continue
        number, _, unit = scale.partition(f" {found}/")
        size = float(number) / si_factor(unit.strip("()")) if unit else 1 / si_factor(found)
        ratios[kind] = written.scales[kind] / size
        if not np.isclose(ratios[kind], 1, atol=0.05):
            wrong.append(f"{kind}: {scale or found} instead of {written.scales[kind]:g}")
    return tuple(wrong), ratios


__all__ = ["Draft", "Judgement", "judge"]
