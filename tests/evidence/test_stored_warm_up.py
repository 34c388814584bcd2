"""The stored errors, coverage and alarms of a warm-up, and a sample worked out anew."""

import numpy as np
import pytest
from tests.evidence.characteristics import sampling_band
from tests.evidence.warm_up import CASES, DEVICES, NAMES, PAGE, SEEDS, outcomes

ROWS = [
    [cell.strip() for cell in line.strip("|").split("|")]
    for line in PAGE.read_text(encoding="utf-8").splitlines()
    if line.startswith(tuple(f"| {size}" for size in CASES))
]
MOST_BIAS = 0.15  # of the mean u


def test_every_effect_is_stored_in_two_sizes():
    assert {(row[0], row[1]) for row in ROWS} == {(size, name) for size in CASES for name in NAMES}


@pytest.mark.parametrize("row", ROWS, ids=lambda row: " ".join(row[:2]))
def test_stored_errors_are_small_and_covered_and_alarms_are_rare(row: list[str]):
    if row[0] == "none":
        assert float(row[6]) <= 1.0
        return
    low, high = sampling_band(DEVICES * len(SEEDS))
    assert low <= float(row[5]) / 100 <= high
    assert abs(float(row[4])) < MOST_BIAS


@pytest.mark.parametrize("size", CASES)
def test_a_sample_is_covered(size: str):
    count = 15
    found = outcomes(size, count, 100)
    for name in NAMES:
        one = found[name]
        if size == "none":
            assert one.reported.sum() <= 1
            continue
        assert one.reported.sum() >= count - 3
        assert np.sum(one.covered[np.isfinite(one.u)]) >= count - 3
        assert abs(np.nanmean(one.error / one.u)) < 1.2
