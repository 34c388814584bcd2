"""The numbers of the examples and studies are those on record, up to rounding."""

import json
from contextlib import chdir
from pathlib import Path

import pytest
from tests.program import run_program
from tools import numbers

COMMANDS = ("reproduce centrifuge", "budget six_position", "plan ferraris", "qualify")


def run_in_process(arguments: tuple[str, ...], folder: Path) -> str:
    with chdir(folder):
        return run_program(*arguments).output


@pytest.mark.slow
def test_numbers_of_a_third_of_the_examples_are_those_on_record(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(numbers, "_program", run_in_process)
    folder = numbers.copy_examples(tmp_path)
    third = [*numbers.run_files(folder)][::3]
    commands = [("calibrate", one, "--json") for one in third]
    commands += [one for one in numbers.COMMANDS if " ".join(one).startswith(COMMANDS)]
    found = {" ".join(one): numbers.numbers_of(one, folder) for one in commands}
    after = {name: one for name, one in found.items() if one is not None}
    record = json.loads(numbers.RECORD.read_text(encoding="utf-8"))
    before = {name: one for name, one in record.items() if name in found}
    assert len(before) > 15
    assert numbers.beyond_rounding(before, after) == []


@pytest.mark.evidence
def test_numbers_of_examples_and_studies_are_those_on_record():
    before = json.loads(numbers.RECORD.read_text(encoding="utf-8"))
    assert numbers.beyond_rounding(before, numbers.all_numbers()) == []


def test_a_change_of_a_value_counts_by_its_uncertainty():
    before = {
        "a": [{"value": 5.0, "std": 1e-3}],
        "chi2": 8.0,
        "covariance": [[4.0, 0.0], [0.0, 9.0]],
    }
    after = {
        "a": [{"value": 5.001, "std": 1e-3}],
        "chi2": 8.0,
        "covariance": [[4.0, 0.6], [0.0, 9.0]],
    }
    found = sorted(numbers.differences(before, after))
    assert [size for size, _ in found] == [pytest.approx(0.1), pytest.approx(1.0)]
    assert list(numbers.differences(before, before)) == []
    assert [size for size, _ in numbers.differences(before, {"a": []})] == [float("inf")] * 3
