"""Figures of an input-output table: definitions on exact readings, and which rows are used."""

from dataclasses import replace

import numpy as np
import pytest
from tests.refusals import refused

from inercal.basics.arrays import Array
from inercal.estimation.input_output_tests import (
    InputOutput,
    asymmetry,
    composite_error,
    hysteresis,
    linearity_error,
    scale_factor,
)
from inercal.estimation.response_band import response_band, small_inputs

UP = np.arange(-5.0, 6.0)
LOOP = np.concatenate([UP, UP[-2::-1]])
SMALL = np.array([0.0, 0.1, 0.2, 0.1, 0.0, -0.1, -0.2, -0.1, 0.0])


def table(x: Array, y: Array, sd: float = 1e-3) -> InputOutput:
    rising = np.sign(np.diff(x, prepend=x[0]))
    level = np.unique(x, return_inverse=True)[1]
    return InputOutput(
        x, y, sd**2 * np.eye(len(x)), np.zeros((len(x), len(x))), rising, level, 0 * level
    )


def test_a_straight_line_has_its_slope_and_no_effect():
    exact = table(LOOP, 0.3 + 1.001 * LOOP)
    assert scale_factor(exact).value == pytest.approx(1.001, rel=1e-12)
    assert composite_error(exact).value == pytest.approx(0.305 / 5.005, rel=1e-12)
    loop, senses = hysteresis(exact), asymmetry(exact)
    assert loop is not None
    assert senses is not None
    for one in (loop, senses, linearity_error(exact)):
        assert one.value == pytest.approx(0.0, abs=1e-12)
        assert not one.detected
        assert one.bound > 0


def test_an_effect_that_changes_its_sign_when_the_sensor_is_turned_over_is_no_linearity_error():
    x, side = np.r_[UP, -UP, UP], np.repeat([1.0, -1.0, 1.0], 11)
    cross = np.where(side > 0, 0.7, 0.2) * x  # of an axis that is inclined to the input
    others = np.c_[9.81 * side, cross, np.full_like(x, 96.2)]
    y = 0.3 + 1.001 * x + 0.01 * side + 3e-3 * cross
    plain = table(x, y)
    kinked = table(x, y + np.where(x > 0, 0.01, -0.01) * x)
    assert linearity_error(plain).detected
    assert not linearity_error(replace(plain, others=others)).detected
    assert linearity_error(replace(plain, others=others)).value == pytest.approx(0.0, abs=1e-12)
    found = asymmetry(replace(kinked, others=others))
    assert found is not None
    assert found.value == pytest.approx(0.02, rel=0.01)
    assert linearity_error(replace(kinked, others=others)).detected


def test_an_effect_that_acts_like_the_line_is_not_subtracted():
    one = table(UP, 0.3 + 1.001 * UP)
    same = replace(one, others=np.c_[np.full_like(UP, 9.81), 0.5 * UP])
    assert scale_factor(same) == scale_factor(one)
    assert composite_error(same).value == pytest.approx(composite_error(one).value, rel=1e-12)


def test_a_kink_at_zero_is_the_asymmetry():
    found = asymmetry(table(LOOP, np.where(LOOP > 0, 1.01, 0.99) * LOOP))
    assert found is not None
    assert found.value == pytest.approx(0.02, rel=1e-9)
    assert found.detected


def test_a_reading_that_lags_has_a_positive_hysteresis():
    sense = np.sign(np.diff(LOOP, prepend=LOOP[0]))
    found = hysteresis(table(LOOP, LOOP + 1e-3 * LOOP**3 - 0.1 * sense * (1 - (LOOP / 5) ** 2)))
    assert found is not None
    assert found.value == pytest.approx(0.2, rel=1e-9)
    assert found.detected


def test_inputs_that_are_reached_from_one_side_show_no_hysteresis():
    assert hysteresis(table(UP, UP)) is None


@pytest.mark.parametrize("first", [[], [0.0], [5.0], [0.0, 5.0]])
def test_a_small_input_after_a_large_one_is_left_out(first: list[float]):
    x = np.array([*first, *(4.0 + SMALL), *SMALL])
    ((centre, rows), (other, others)) = small_inputs(table(x, x), 0.5)
    assert (centre, other) == (0.0, pytest.approx(4.0, abs=1e-8))
    start = len(first) + len(SMALL)
    assert rows.tolist() == list(range(start + 1, start + len(SMALL)))
    begin = len(first) + (1 if first else 0)
    assert others.tolist() == list(range(begin, start))


def test_a_jump_lies_between_the_inputs_around_it():
    small = np.concatenate([SMALL, 3 * SMALL, 5 * SMALL])
    found = response_band(table(small, np.where(np.abs(small) < 0.25, 0.0, small)), 0.0, None)
    assert found.law == "jump"
    assert found.threshold.detected
    assert found.threshold.low >= 0.2 - 0.005
    assert found.threshold.high <= 0.3 + 0.005


def test_a_table_that_does_not_fit_is_refused():
    with refused():
        InputOutput(UP, LOOP, np.eye(11), np.eye(11), UP, UP.astype(np.int64), UP.astype(np.int64))
    with refused():
        table(UP, UP, sd=0.0)


def test_a_linearity_error_is_only_a_value_if_it_is_significant():
    bent = UP + 0.01 * UP**3
    assert linearity_error(table(UP, bent)).detected
    sd = np.where(UP == 0, 3.0, 1e-3)  # one bad reading has the largest residual
    off = replace(table(UP, bent + 3.0 * (UP == 0)), covariance=np.diag(sd**2))
    assert linearity_error(off).low < 0
    assert not linearity_error(off).detected
