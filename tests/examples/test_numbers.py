"""The numbers of the examples and studies are those on record, up to rounding."""

import json

import pytest
from tools import numbers


@pytest.mark.slow
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
