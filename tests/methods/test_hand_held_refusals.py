"""What rests and turns in the hand leave open is refused by name, with what to add."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from tests.accuracy.ferraris import mems
from tests.accuracy.handheld import Session, about_one_axis, directions, planar, record

from inercal.basics.errors import NotObserved
from inercal.basics.units import Measured
from inercal.benches import Hand
from inercal.estimation import Estimate
from inercal.methods import METHODS
from inercal.methods.multi_position.attitude_coverage import CUBE_DIRECTIONS
from inercal.physics.plan import Hold
from inercal.physics.sensors import imu
from inercal.recordings import Mark, Recording
from inercal.recordings.segments import (
    average_sections,
    holds_from_marks,
    holds_from_observations,
    transitions_between_rests,
)

Array = NDArray[np.float64]
METHOD = METHODS["multi_position"]


def calibrated(ups: Array, also: Sequence[str] = (), gz: float = 1.0, **session: float) -> Estimate:
    rng = np.random.default_rng(5)
    made = record(mems(rng), Session(**session), rng, ups=ups)  # type: ignore[arg-type]
    sensor = METHOD.prepare(imu(), also=also)
    units = ("m/s²",) * 3 + ("rad/s",) * 3
    data = made.data[0] * [1, 1, 1, 1, 1, gz]
    recording = Recording(made.time, data, sensor.channels, units)
    marks = [Mark(f"r{k:02d}", a + 10, b - 10) for k, (a, b) in enumerate(made.rests)]
    seen = average_sections(recording, sensor, marks, holds_from_marks(marks), by_hand=True)
    seen = replace(seen, transitions=transitions_between_rests(recording, sensor, marks))
    bench = Hand(Measured(9.81, 1e-3))
    return METHOD.estimator("")(seen, sensor, bench, holds_from_observations(seen, sensor))


def test_one_gyro_in_another_unit_is_named_before_attitudes_to_add():
    with pytest.raises(NotObserved) as refusal:
        calibrated(directions(24, np.random.default_rng(0)), gz=np.radians(1))
    assert str(refusal.value).startswith("gz changes ")


def test_eight_rests_are_too_few_for_nine_coefficients():
    with pytest.raises(NotObserved) as refusal:
        calibrated(directions(8, np.random.default_rng(0)))
    assert "; add: hold " in str(refusal.value)


def test_three_rests_say_what_to_add_before_a_short_list_of_combinations():
    with pytest.raises(NotObserved) as refusal:
        calibrated(directions(4, np.random.default_rng(0)))
    said, _, combinations = str(refusal.value).partition(" (undetermined combinations")
    assert "; add: hold " in said
    assert combinations.count(";") == 3
    assert isinstance(refusal.value, NotObserved)
    assert f"and {len(refusal.value.directions) - 3} more" in combinations


@pytest.mark.parametrize(
    ("normal", "named"), [((0, 0, 1), "az.k1"), ((1, 1, 1), "az.delta_o"), ((1, -2, 0), "ay.k1")]
)
def test_twenty_rests_in_one_plane_are_refused(normal: tuple[float, ...], named: str):
    across = np.array(normal) / np.linalg.norm(normal)
    with pytest.raises(NotObserved) as refusal:
        calibrated(planar(20, across, 1.0, np.random.default_rng(0)))
    assert named in str(refusal.value).partition("(undetermined combinations")[0]
    assert "; add: hold " in str(refusal.value)


@pytest.mark.slow
def test_attitudes_added_to_a_plane_as_advised_are_accepted():
    plane = planar(20, np.array([0.0, 0.0, 1.0]), 1.0, np.random.default_rng(0))
    with pytest.raises(NotObserved) as refusal:
        calibrated(plane)
    said = str(refusal.value).partition(" (undetermined combinations")[0]
    advised = said.partition("add: hold ")[2].split("; ")
    by_words = {Hold("", tuple(up), 0.0).describe(): up for up in CUBE_DIRECTIONS.tolist()}
    added = np.array([by_words[words] for words in advised])
    assert calibrated(np.concatenate([plane, added])).converged


def test_gyros_turned_about_one_axis_are_refused_by_name():
    ups = about_one_axis(20, np.array([1.0, 0.0, 0.0]), np.random.default_rng(0))
    with pytest.raises(NotObserved) as refusal:
        calibrated(ups, yaw_deg=0.0)
    named = str(refusal.value).partition("(undetermined combinations")[0]
    assert {"gy.scale", "gz.scale", "ax.k0", "ax.k1"} <= set(named.replace(",", " ").split())
    assert "no rest has +x or −x within 45° of straight up" in str(refusal.value)


@pytest.mark.slow
def test_a_hemisphere_is_accepted_and_what_would_make_it_better_is_said():
    ups = directions(40, np.random.default_rng(0))
    found = calibrated(ups[ups[:, 2] > 0.1], also=("g",))
    assert any(
        "These attitudes would reduce its U" in note and "hold −z up" in note
        for note in found.notes
    )
