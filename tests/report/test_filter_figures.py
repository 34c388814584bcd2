"""Figures of sequential filters: what they draw, and how small they stay."""

import re
from dataclasses import replace
from math import radians

import numpy as np
import pytest

from inercal.estimation import FilterHistory, SmoothedStates
from inercal.estimation.lazy_value import LazyValue
from inercal.physics.sensors import imu
from inercal.report.filter_figures import (
    MAX_POINTS,
    innovation_figure,
    running_nis,
    smoothed_figure,
    thin_indices,
)


def course(epochs: int, nis: float = 3.0, *, pause: bool = False) -> FilterHistory:
    time = np.arange(epochs, dtype=np.float64) / 10
    if pause:
        time[epochs // 2 :] += 0.05 * epochs
    none = np.zeros((epochs, 0))
    return FilterHistory("gyros", (), time, none, none, np.zeros((epochs, 3)), np.full(epochs, nis))


def test_the_running_mean_of_three_components_as_stated_is_one():
    time, mean = running_nis(course(1000))
    assert mean == pytest.approx(np.ones(mean.size))
    assert time[0] == pytest.approx(1.2)
    assert time.size == mean.size


def test_epochs_of_an_alignment_are_left_out():
    made = course(1000)
    made.nis[::10] = 0.0
    assert running_nis(made)[1] == pytest.approx(np.ones(879), abs=1e-12)


@pytest.mark.parametrize("epochs", [1, 2, 39, 40, 41])
def test_a_short_course_is_drawn_too(epochs: int):
    assert "<svg" in innovation_figure([course(epochs)])


def test_a_line_has_few_points_and_breaks_where_the_filter_paused():
    made = course(20_000, pause=True)
    made.nis[:] = np.random.default_rng(0).chisquare(3, made.nis.size)
    drawn = innovation_figure([made])
    lines = [line for line in re.findall(r' d="([^"]*)"', str(drawn)) if line.count("L") > 20]
    assert len(lines) == 1
    assert lines[0].count("L") <= MAX_POINTS
    assert lines[0].count("M") == 2


def test_thinning_keeps_both_ends():
    assert thin_indices(10_000)[[0, -1]].tolist() == [0, 9_999]
    assert thin_indices(10_000).size == MAX_POINTS
    assert thin_indices(3).tolist() == [0, 1, 2]


def of_gyros(epochs: int, *, pause: bool = False) -> FilterHistory:
    """Return a course whose attitude is off by 3″ ± 1″ and whose drift is 2 °/h ± 0.5 °/h."""
    states = ("phi_e", "phi_n", "phi_u", "drift[gx]", "drift[gy]", "drift[gz]")
    units = np.array([radians(1 / 3600)] * 3 + [radians(1) / 3600] * 3)
    value = np.tile(units * [3, 3, 3, 2, 2, 2], (epochs, 1))
    std = np.tile(units * [1, 1, 1, 0.5, 0.5, 0.5], (epochs, 1))
    made = course(epochs, pause=pause)
    smoothing = LazyValue(lambda: SmoothedStates(states, value, std))
    return replace(made, names=("gx.bias", *states[3:]), smoothing=smoothing)


def test_what_varies_is_drawn_in_seconds_of_arc_and_in_the_units_of_the_bias():
    drawn = smoothed_figure([of_gyros(500)], imu().with_coefficients("bias"))
    assert drawn is not None
    assert {"gyros: attitude error, ″", "gyros: drift, °/h"} <= set(_texts(drawn))
    assert {"east", "north", "up", "gx", "gy", "gz"} <= set(_texts(drawn))
    # 3″ ± 2″ and 2 °/h ± 1 °/h: what is beyond has no tick.
    assert {"5", "3.0"} <= set(_texts(drawn))
    assert "6" not in _texts(drawn)


def _texts(drawn: str) -> list[str]:
    return re.findall(r"<text[^>]*>([^<]*)<", drawn)


@pytest.mark.parametrize(("pause", "pieces"), [(False, 1), (True, 2)])
def test_what_varies_breaks_where_the_filter_paused(pause: bool, pieces: int):
    drawn = smoothed_figure([of_gyros(20_000, pause=pause)], imu().with_coefficients("bias"))
    paths = re.findall(r' d="([^"]*)"', str(drawn))
    bands = [one.count("L") for one in paths if one.count("L") > 100]
    assert len(bands) == 6 * pieces
    assert sum(bands) <= 6 * (2 * MAX_POINTS + 2 * pieces)  # there and back


def test_of_a_course_that_is_not_smoothed_nothing_is_drawn():
    assert smoothed_figure([course(10)], imu()) is None
