"""`inercal self-check`: every method has a case, and a wrong answer fails."""

import json
from pathlib import Path
from typing import Any

import pytest
from tests.program import run_program

import inercal.pipeline.self_check as known
from inercal.methods import METHODS
from inercal.pipeline.self_check import CASES, self_check, stored_answers

QUICK = ("six_position", "tumble", "ship_multi_angle")


def options(*methods: str) -> list[str]:
    return [word for name in methods for word in ("--method", name)]


def test_every_method_has_a_case_and_an_answer():
    assert set(CASES) == set(METHODS)
    assert set(stored_answers()["cases"]) == set(METHODS)


@pytest.mark.slow
def test_every_method_gives_its_known_answer():
    check = self_check()
    assert check.passed, [one.reason for one in check.results]
    assert len(check.results) == len(METHODS)
    assert sum(one.probability is not None for one in check.results) >= 6


@pytest.mark.slow
def test_the_report_has_date_versions_and_machine_and_names_each_method(tmp_path: Path):
    ended = run_program("self-check", *options(*QUICK), "--out", tmp_path)
    assert ended.status == 0
    (path,) = tmp_path.iterdir()
    text = path.read_text(encoding="utf-8")
    assert text in ended.output
    check = json.loads(run_program("self-check", *options(*QUICK), "--json").output)
    assert check["passed"] is True
    for word in (*QUICK, *check["versions"].values(), *check["machine"].values()):
        assert word in text


def changed(answers: dict[str, Any], method: str, key: str, by: float) -> dict[str, Any]:
    one = answers["cases"][method]
    one[key][0] += by * one["u"][0]
    return answers


@pytest.mark.parametrize(("key", "by"), [("values", 0.02), ("u", -0.02)])
def test_an_answer_that_moved_fails_with_its_size(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, key: str, by: float
):
    answers = changed(stored_answers(), "tumble", key, by)
    monkeypatch.setattr(known, "stored_answers", lambda: answers)
    ended = run_program("self-check", *options(*QUICK), "--json", "--out", tmp_path)
    assert ended.status == 3
    results = {one["method"]: one for one in json.loads(ended.output)["results"]}
    assert [name for name, one in results.items() if not one["passed"]] == ["tumble"]
    assert results["tumble"]["deviation"] == pytest.approx(0.02, rel=0.05)


def test_a_method_that_errs_from_the_truth_fails(monkeypatch: pytest.MonkeyPatch):
    compute = known.compute

    def wrong(method: str, folder: Path) -> Any:
        calibration, grade, truth = compute(method, folder)
        assert truth is not None
        return calibration, grade, truth + 6 * calibration.std

    monkeypatch.setattr(known, "compute", wrong)
    (result,) = self_check(("ferraris",)).results
    assert not result.passed
    assert result.deviation <= known.TOLERANCE
    assert result.probability is not None
    assert result.probability < known.LEAST_PROBABILITY


def test_an_unknown_method_is_refused_with_those_there_are(tmp_path: Path):
    ended = run_program("self-check", "--method", "tumbles", "--out", tmp_path)
    assert ended.status == 2
    assert "tumble" in ended.error
    assert not list(tmp_path.iterdir())
