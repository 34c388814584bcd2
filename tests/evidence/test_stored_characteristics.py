"""The stored errors, coverage and alarms of characteristics, and a sample worked out anew."""

import numpy as np
import pytest
from tests.base_seeds import evidence, slow
from tests.evidence.characteristics import (
    CASES,
    DEVICES,
    NAMES,
    PAGE,
    SEEDS,
    Case,
    outcomes,
    sampling_band,
)

ROWS = [
    [cell.strip() for cell in line.strip("|").split("|")]
    for line in PAGE.read_text(encoding="utf-8").splitlines()
    if line.startswith(("| gyro", "| accelerometer"))
]
MOST_BIAS = 0.15  # of the mean u


def test_every_effect_is_stored_in_two_sizes():
    found = {(row[0], row[2], row[3]) for row in ROWS}
    for sensor in ("gyro", "accelerometer"):
        for effect in NAMES:
            assert {(sensor, size, effect) for size in ("none", "small", "large")} <= found


@pytest.mark.parametrize("row", [r for r in ROWS if r[2] != "none"], ids=lambda r: " ".join(r[:4]))
def test_stored_errors_are_small_and_covered(row: list[str]):
    low, high = sampling_band(DEVICES * len(SEEDS))
    assert low <= float(row[7]) / 100 <= high
    assert abs(float(row[6])) < MOST_BIAS


@pytest.mark.parametrize("row", [r for r in ROWS if r[2] == "none"], ids=lambda r: " ".join(r[:4]))
def test_stored_false_alarms_are_rare(row: list[str]):
    assert float(row[8]) <= 1.0


@pytest.mark.slow
@pytest.mark.parametrize(
    ("sensor", "law"),
    [
        ("gyro", "play"),
        ("accelerometer", "none"),
        slow("gyro", "none"),
        slow("accelerometer", "play"),
    ],
)
def test_a_sample_is_covered(sensor: str, law: str):
    count = 12
    found = outcomes(Case(sensor, law, "large"), count, 100)
    for name in ("hysteresis",) if law == "none" else NAMES[1:]:
        one = found[name]
        assert one.reported.all()
        assert one.covered.sum() >= count - 3
        assert abs(np.mean(one.error / one.u)) < 1.2


@pytest.mark.slow
@pytest.mark.parametrize(
    "case",
    [one if k % 10 == 0 else evidence(one) for k, one in enumerate(CASES)],
    ids=lambda case: " ".join(case),
)
def test_a_larger_sample_agrees_with_what_is_stored(case: Case):
    count = 50
    found = outcomes(case, count, 101)
    if case.size == "none":
        assert max(one.reported.sum() for one in found.values()) <= 3
        return
    low, high = sampling_band(count)
    for name in ("hysteresis",) if case.law == "none" else NAMES[1:]:
        assert low <= found[name].covered.mean() <= high, name
