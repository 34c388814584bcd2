"""A qualification changes U, or the result says that it does not: of every estimator.

How U changes is in `test_qualified_benches`; here are the estimators that take the bench as exact.
"""

import shutil
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from tests.methods.test_bench_sensitivities import CERTAIN
from tests.qualification.test_qualified_benches import QUALIFIED, by_cost, given_case, names_of
from tests.refusals import refused

from inercal.benches.qualification.input_file import qualify
from inercal.benches.qualification.result import save
from inercal.methods import METHODS
from inercal.methods.temperature_ramp import METHOD as RAMP
from inercal.pipeline import calibrate
from inercal.pipeline.stated_values import uncounted_notes
from inercal.runfile import read

EXAMPLES = Path(__file__).parents[2] / "examples"
COUNTED = by_cost(QUALIFIED)


def notes(method: str, estimator: str, names: tuple[str, ...]) -> tuple[str, ...]:
    """Return the notes of a calibration with a qualification of these parameters."""
    given = given_case(method, estimator)
    run: Any = SimpleNamespace(
        estimator=estimator,
        qualified=SimpleNamespace(files=("q.json",), each=(SimpleNamespace(names=names),)),
    )
    expected = given.bench.nuisances(given.steps, given.sensor)
    return uncounted_notes(run, given.found(), expected)


@pytest.mark.parametrize(("method", "estimator"), COUNTED)
def test_what_counts_the_bench_has_no_note(method: str, estimator: str):
    assert notes(method, estimator, names_of(method, estimator)) == ()


@pytest.mark.parametrize(("method", "estimator"), CERTAIN)
def test_what_takes_the_bench_as_exact_says_so(method: str, estimator: str):
    given = given_case(method, estimator)
    acting = given.bench.nuisances(given.steps, given.sensor)
    names = tuple(dict.fromkeys(one.name for one in acting.values() if one.sd > 0))
    (note,) = notes(method, estimator, names)
    assert all(name in note for name in names)
    assert f"estimator {estimator} does not take it into account" in note


def test_every_estimator_is_in_one_of_the_lists():
    every = {(name, one) for name, method in METHODS.items() for one in method.estimators}
    rest = every - {*QUALIFIED, *CERTAIN}
    # A ramp refuses qualifications, below; a systematic run is in tests/methods/test_systematic.py.
    # `field_and_rates` uses no error of a bench.
    assert rest == {
        ("field_and_rates", "gls"),
        ("temperature_ramp", "gls"), ("systematic", "batch"), ("systematic", "kalman"),
    }  # fmt: skip
    assert list(RAMP.estimators) == ["gls"]


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Return a folder with a qualification of gravity, and the same with 100 times its variance."""
    found = qualify(EXAMPLES / "qualify" / "gravity.toml")
    save(found, tmp_path / "gravity.qualification.json")
    wide = replace(found, covariance=100 * found.covariance)
    save(wide, tmp_path / "wide.qualification.json")
    shutil.copy(EXAMPLES / "six_position" / "positions.csv", tmp_path)
    return tmp_path


@pytest.mark.parametrize("estimator", ["ml", "classical"])
def test_a_run_changes_its_u_or_says_that_it_does_not(folder: Path, estimator: str):
    text = (EXAMPLES / "six_position" / "run.toml").read_text(encoding="utf-8")
    begin, end = text.index("latitude = "), text.index("tilt = ")
    found: list[np.ndarray] = []
    said: list[bool] = []
    for name in ("gravity", "wide"):
        key = f'qualification = "{name}.qualification.json"\n'
        path = folder / f"{name}.toml"
        path.write_text(f'{text[:begin]}{key}{text[end:]}\nestimator = "{estimator}"\n')
        calibration = calibrate(path).calibration
        found.append(calibration.std)
        said.append(
            any("is not included in U" in one and "of g " in one for one in calibration.notes)
        )
    assert said == [estimator == "classical"] * 2
    changed = np.abs(found[1] / found[0] - 1).max() > 1e-6
    assert changed == (estimator == "ml")


def test_a_ramp_at_rest_refuses_a_qualification(folder: Path):
    text = (EXAMPLES / "temperature" / "ramp.toml").read_text(encoding="utf-8")
    path = folder / "ramp.toml"
    key = 'qualification = "wide.qualification.json"'
    path.write_text(text.replace('kind = "hand"', f'kind = "hand"\n{key}'), encoding="utf-8")
    with refused(key="[bench] qualification"):
        read(path)
