"""Figures of sequential filters: what they draw, and how small they stay."""

import re

import numpy as np
import pytest

from inercal.estimate import Course
from inercal.report.courses import POINTS, innovations, running, thinned


def course(epochs: int, nis: float = 3.0, *, pause: bool = False) -> Course:
    time = np.arange(epochs, dtype=np.float64) / 10
    if pause:
        time[epochs // 2 :] += 0.05 * epochs
    none = np.zeros((epochs, 0))
    return Course("gyros", (), time, none, none, np.zeros((epochs, 3)), np.full(epochs, nis))


def test_the_running_mean_of_three_components_as_stated_is_one():
    time, mean = running(course(1000))
    assert mean == pytest.approx(np.ones(mean.size))
    assert time[0] == pytest.approx(1.2)
    assert time.size == mean.size


def test_epochs_of_an_alignment_are_left_out():
    made = course(1000)
    made.nis[::10] = 0.0
    assert running(made)[1] == pytest.approx(np.ones(879), abs=1e-12)


@pytest.mark.parametrize("epochs", [1, 2, 39, 40, 41])
def test_a_short_course_is_drawn_too(epochs: int):
    assert "<svg" in innovations([course(epochs)])


def test_a_line_has_few_points_and_breaks_where_the_filter_paused():
    made = course(20_000, pause=True)
    made.nis[:] = np.random.default_rng(0).chisquare(3, made.nis.size)
    drawn = innovations([made])
    lines = [line for line in re.findall(r' d="([^"]*)"', str(drawn)) if line.count("L") > 20]
    assert len(lines) == 1
    assert lines[0].count("L") <= POINTS
    assert lines[0].count("M") == 2


def test_thinning_keeps_both_ends():
    assert thinned(10_000)[[0, -1]].tolist() == [0, 9_999]
    assert thinned(10_000).size == POINTS
    assert thinned(3).tolist() == [0, 1, 2]
