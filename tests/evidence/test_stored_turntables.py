"""The stored errors of turntable devices against what is stated; a sample is simulated again."""

from dataclasses import fields

import pytest
from tests.evidence import turntable_errors
from tests.evidence.turntable_errors import (
    DEVICES,
    FLICKER,
    SEEDS,
    SIMULATED,
    TurntableErrorRow,
    pool_rows,
)


@pytest.fixture(scope="module")
def stored_rows() -> list[TurntableErrorRow]:
    return turntable_errors.read_rows()


@pytest.mark.parametrize("case", FLICKER)
def test_errors_under_flicker_are_within_a_tenth_of_what_is_stated(
    stored_rows: list[TurntableErrorRow], case: str
):
    rows = [row for row in stored_rows if row.case == case]
    assert {row.seed for row in rows} == set(SEEDS)
    assert all(row.devices >= DEVICES for row in rows)
    whole = pool_rows(rows)
    for value in (whole.gyros, whole.accelerometers, whole.whole):
        assert 0.9 <= value <= 1.1


def test_a_simulated_turntable_errs_as_stated(stored_rows: list[TurntableErrorRow]):
    (row,) = (row for row in stored_rows if row.case == SIMULATED)
    assert row.devices >= DEVICES
    assert 0.89 <= row.whole <= 1.12
    assert row.consistent is not None
    assert row.consistent >= 0.95 * row.devices


@pytest.mark.evidence
def test_a_sample_of_the_simulation_comes_out_as_stated():
    row = turntable_errors.simulated_nees(6)
    assert abs(row.whole - 1) <= row.band


def test_pooling_weighs_by_devices():
    one = TurntableErrorRow("", 1, 1, 1.0, 2.0, 3.0, 1)
    two = TurntableErrorRow("", 2, 3, 2.0, 2.0, 1.0, 0)
    both = pool_rows([one, two])
    assert (both.devices, both.gyros, both.whole, both.consistent) == (4, 1.75, 1.5, 1)
    assert {field.name for field in fields(both)} >= {"case", "seed"}
