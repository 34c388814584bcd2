"""Holds and turns of a turntable, found by what its axes read back."""

from dataclasses import replace
from math import pi, radians

import numpy as np
import pytest

from inercal.basics.units import Measured
from inercal.benches import Turntable
from inercal.benches.turntable.paths import fast_path
from inercal.benches.turntable.simulation import path_profile
from inercal.physics.plan import Position, Rotation, TableStep
from inercal.recordings.segments.turntable_segments import find_holds, find_turns

ARCSEC = radians(1 / 3600)
BENCH = Turntable(Measured(9.81, 0.0), radians(38))
HOME = (0.0, 0.0, 0.0)
STEPS: tuple[TableStep, ...] = (
    Position("a", HOME, 20.0),
    Position("b", (0.0, pi / 2, 0.0), 10.0),
    Rotation("twice", 0, 4 * pi, 0.5),
    Rotation("back", 0, -2 * pi, 0.5),
    Position("c", HOME, 5.0),
)


def moved(steps: tuple[TableStep, ...], hz: float, noise: float) -> tuple[np.ndarray, ...]:
    way = path_profile(BENCH, steps)
    labels = way.sample_labels(hz)
    time = np.arange(labels.size) / hz
    angles = way.evaluate(time)[0]
    return time, angles + noise * np.random.default_rng(0).standard_normal(angles.shape), labels


@pytest.mark.parametrize("hz", [20.0, 100.0, 1000.0])
@pytest.mark.parametrize("noise", [0.0, 0.5 * ARCSEC, 20 * ARCSEC])
def test_each_position_is_a_hold_and_each_long_turn_is_found(hz: float, noise: float):
    time, angles, labels = moved(STEPS, hz, noise)
    holds = find_holds(time, angles, None, 0.25)
    assert len(holds) == 3
    for (start, stop), label in zip(holds.tolist(), "abc", strict=True):
        assert set(labels[start:stop]) <= {label, ""}
        own = time[labels == label]
        at_ends = (label == "a", label == "c")
        assert time[start] - own[0] == pytest.approx(0.0 if at_ends[0] else 0.25, abs=0.15)
        assert own[-1] - time[stop - 1] == pytest.approx(0.0 if at_ends[1] else 0.25, abs=0.15)
    turns = find_turns(time, angles, None)
    assert [turn.axis for turn in turns] == [0, 0]
    assert [turn.angle for turn in turns] == pytest.approx([4 * pi, -2 * pi], abs=0.1)
    assert [turn.rate for turn in turns] == pytest.approx([0.5, -0.5], rel=0.02)


@pytest.mark.parametrize("hz", [50.0, 200.0])
def test_a_turn_goes_from_rest_to_rest_where_another_axis_starts_at_once(hz: float):
    other = Position("aside", (0.0, pi / 2, 0.0), 10.0)
    steps = (other, Rotation("there", 0, 2 * pi, 0.5), replace(other, angles=HOME))
    time, angles, labels = moved(steps, hz, 0.0)
    rates = np.abs(np.gradient(angles, 1 / hz, axis=0)).max(axis=1)
    (turn,) = find_turns(time, angles, labels)
    assert rates[[turn.start, turn.stop]].max() < radians(1)
    assert np.abs(np.gradient(rates, 1 / hz)[turn.stop - 20 : turn.stop]).max() > radians(10)


def test_a_coarse_readback_still_rests():
    time, angles, _ = moved(STEPS, 100.0, 5 * ARCSEC)
    step = radians(0.01)
    coarse = step * np.round((angles + 0.5 * step) / step)
    assert len(find_holds(time, coarse, None, 0.25)) == 3


def test_a_readback_that_comes_seldom_and_is_drawn_out_still_rests():
    time, angles, _ = moved(STEPS, 100.0, 2 * ARCSEC)
    seldom = np.stack([np.interp(time, time[::10], one[::10]) for one in angles.T], axis=-1)
    assert len(find_holds(time, seldom, None, 0.25)) == 3
    assert len(find_turns(time, seldom, None)) == 2


def test_a_hold_ends_where_samples_are_missing_and_where_labels_change():
    time, angles, labels = moved(STEPS, 100.0, ARCSEC)
    kept = (time < 8) | (time > 9)
    assert len(find_holds(time[kept], angles[kept], None, 0.25)) == 4
    parted = np.where(time < 12, "warm-up", labels)
    starts = find_holds(time, angles, parted, 0.25)[:, 0]
    assert time[starts[1]] == pytest.approx(12.0)


def test_settling_goes_where_a_label_follows_a_turn_at_once():
    steps = (STEPS[0], Rotation("turn", 0, 2 * pi, 0.5), STEPS[-1])
    time, angles, labels = moved(steps, 100.0, 0.5 * ARCSEC)
    start, _ = find_holds(time, angles, labels, 0.25)[-1]
    assert time[start] - time[labels == "c"][0] == pytest.approx(0.25, abs=0.15)


def test_the_path_of_the_catalogue_is_found_whole():
    path = fast_path()
    time, angles, labels = moved(path, 50.0, 0.5 * ARCSEC)
    found = find_turns(time, angles, labels)
    assert [turn.axis for turn in found] == [1, 1, 2, 2, 0, 0]
    held = [str(labels[(a + b) // 2]) for a, b in find_holds(time, angles, labels, 0.25).tolist()]
    assert held == [step.label for step in path if isinstance(step, Position)]
    assert len(find_holds(time, angles, None, 0.25)) == len(held) - 1  # warm-up and p1 are one


@pytest.mark.parametrize("n", [1, 2, 5])
def test_a_few_samples_are_no_hold(n: int):
    assert len(find_holds(np.arange(n) / 10, np.zeros((n, 3)), None, 0.25)) == 0
    assert find_turns(np.arange(n) / 10, np.zeros((n, 3)), None) == ()
