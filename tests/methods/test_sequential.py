"""The contract of sequential estimators: a run and its recording are the same samples in pieces."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import cycle
from math import radians

import numpy as np
import pytest
from tests import rest_bias_method

from inercal.basics.keys import CoefficientName
from inercal.basics.units import Measured
from inercal.benches import Turntable
from inercal.benches.turntable.attitude import motion
from inercal.benches.turntable.paths import systematic_path
from inercal.benches.turntable.simulation import path_profile
from inercal.methods import METHODS, Method, PartialEstimate, Sequential
from inercal.methods.turntable_kalman.combined_estimate import run_filter
from inercal.methods.turntable_kalman.filter_config import FILTER_CONFIGS
from inercal.physics.plan import Position, Rotation
from inercal.physics.sensors import Noise, Sensor, imu
from inercal.recordings import Track

RATE = 50.0  # Hz
TABLE = Turntable(
    Measured(9.81, 1e-4), 0.7, Measured(0.1, 1e-4),
    lean=2e-5, square=1e-5, harmonics=(1e-5,), latency=Measured(0.0, 2e-3), white=2e-6,
)  # fmt: skip
STEPS = (
    Position("warm-up", (0.0, 0.0, 0.0), 22.0),
    Position("up", (0.0, radians(90), 0.0), 3.0),
    Rotation("turn", 2, radians(90), radians(30)),
)
# Without angles of the table: rests about two axes until the azimuth shows, and turns after them
STILL_STEPS = systematic_path(6.0)[:14]
NOISE = {
    "f": Noise(white=6e-4, bias_instability=1.5e-4),
    "w": Noise(white=3e-5, bias_instability=2e-6),
}
CASES = [
    pytest.param(one, estimator, id=f"{one.name}-{estimator}")
    for one in (*METHODS.values(), rest_bias_method.METHOD)
    if one.sequential is not None
    for estimator in one.estimators
]


def sensor_of(method: Method[Turntable, Position | Rotation]) -> Sensor:
    whole = imu()
    axes = tuple(replace(axis, noise=NOISE[axis.measures]) for axis in whole.axes)
    return method.prepare(replace(whole, axes=axes))


def begun(method: Method[Turntable, Position | Rotation], estimator: str) -> Sequential:
    assert method.bench is Turntable, f"{method.name}: this test needs a track of its bench"
    assert method.sequential is not None
    return method.sequential(estimator, sensor_of(method), TABLE, steps_of(method), (), RATE)


def steps_of(method: Method[Turntable, Position | Rotation]) -> Sequence[Position | Rotation]:
    return STILL_STEPS if method.without_angles else STEPS


def track_by(method: Method[Turntable, Position | Rotation]) -> Track:
    return track_of(sensor_of(method), steps_of(method), whole_turns=method.without_angles)


def track_of(
    sensor: Sensor,
    steps: Sequence[Position | Rotation] = STEPS,
    rate: float = RATE,
    *,
    whole_turns: bool = False,
) -> Track:
    rng = np.random.default_rng(7)
    way = path_profile(TABLE, steps)
    time = np.arange(0, way.ends[-1], 1 / rate)
    lost = np.array([30, 31, 700, 1210, 1211])  # some samples are lost
    positions = {one.label for one in steps if isinstance(one, Position)}
    rests = [k for k, label in enumerate(way.labels) if label in positions]
    if whole_turns:
        lost = lost[np.isin(np.searchsorted(way.ends, time[lost]), rests)]
        assert lost.size
    time = np.delete(time, lost)
    angles, rates, accelerations = way.evaluate(time)
    c = 1e-3 * rng.standard_normal(len(sensor.coefficients))
    reading = sensor.forward(motion(TABLE, angles, rates, accelerations, {}), c)
    noise = [axis.noise.draw(rng, (time.size,), rate) for axis in sensor.axes]
    section = np.searchsorted(way.ends, time)
    hold = np.where(np.isin(section, rests), section, -1)
    said = angles + TABLE.white * rng.standard_normal(angles.shape)
    return Track(time, reading + np.stack(noise, axis=-1), said, hold)


def in_pieces(track: Track, lengths: Iterable[int]) -> Iterator[Track]:
    """Yield pieces of these lengths, over and over, until the track ends."""
    start, n = 0, track.time.size
    for length in cycle(lengths):
        if start >= n:
            return
        yield track.slice(start, min(start + length, n))
        start += length


def bits(found: Mapping[str, PartialEstimate]) -> dict[str, tuple[object, ...]]:
    return {
        part: (one.names, one.value.tobytes(), one.covariance.tobytes(), one.nis, one.components)
        for part, one in found.items()
    }


@pytest.mark.slow
@pytest.mark.parametrize(
    ("method", "estimator"),
    [
        one if k % 2 == 0 else pytest.param(*one.values, marks=pytest.mark.evidence, id=one.id)
        for k, one in enumerate(CASES)
    ],
)
def test_pieces_of_any_length_are_the_whole_to_the_last_bit(
    method: Method[Turntable, Position | Rotation], estimator: str
):
    track = track_by(method)
    whole = begun(method, estimator)
    whole.feed(track)
    found = bits(whole.estimate())
    assert found
    rng = np.random.default_rng(1)
    for lengths in ([1], rng.permutation([1, 2, 3, 7, 50, 400]).tolist()):
        pieces = begun(method, estimator)
        for piece in in_pieces(track, lengths):
            pieces.feed(piece)
            pieces.estimate()  # to look at it changes nothing
        assert bits(pieces.estimate()) == found


@pytest.mark.parametrize(("method", "estimator"), CASES)
def test_estimates_are_of_the_sensors_coefficients_by_part(
    method: Method[Turntable, Position | Rotation], estimator: str
):
    sensor = sensor_of(method)
    made, track = begun(method, estimator), track_by(method)
    late = int((0.95 if method.without_angles else 0.85) * track.time.size)
    assert made.estimate() == {}
    made.feed(track.slice(0, 10))
    assert made.estimate() == {}
    made.feed(track.slice(10, late))
    before = made.estimate()
    kept = bits(before)
    made.feed(track.slice(late, track.time.size))
    assert bits(before) == kept  # what was returned is not written to
    found = made.estimate()
    assert bits(found) != kept
    assert set(found) in ({"all"}, {"f", "w"}, {"f"}, {"w"})
    named = [name for one in found.values() for name in one.names]
    measures = {axis.name: axis.measures for axis in sensor.axes}
    assert sorted(named) == sorted(sensor.coefficients)
    for part, one in found.items():
        p = len(one.names)
        assert (one.value.shape, one.covariance.shape) == ((p,), (p, p))
        assert np.linalg.eigvalsh(one.covariance).min() > 0
        kinds = ("f", "w") if part == "all" else (part,)
        assert {measures[CoefficientName(name).axis] for name in one.names} <= {*kinds}
        assert one.components > 0


def test_the_parts_of_a_sensor_are_estimated_as_each_by_itself():
    # So that what they need is compiled in two processes.
    method = METHODS["turntable_kalman"]
    assert method.sequential is not None
    sensor = sensor_of(method)
    track = track_of(sensor)
    whole = begun(method, "full")
    whole.feed(track)
    for kind in ("f", "w"):
        part = sensor.select_axes(kind)
        made = method.sequential("full", part, TABLE, STEPS, (), RATE)
        at = [sensor.channels.index(name) for name in part.channels]
        made.feed(replace(track, reading=track.reading[:, at]))
        assert bits(made.estimate()) == {kind: bits(whole.estimate())[kind]}


@pytest.mark.slow
def test_a_plan_of_hours_has_the_states_of_the_recording_that_it_leaves():
    method = METHODS["turntable_kalman"]
    assert method.sequential is not None
    steps, rate = (replace(STEPS[0], seconds=1.1e4),), 5.0  # beyond 10⁴ s flicker has one more
    sensor = sensor_of(method).select_axes("w")
    track = track_of(sensor, steps, rate)
    after = run_filter("w", sensor, TABLE, track, FILTER_CONFIGS["full"])
    p = len(sensor.coefficients)
    found: list[bool] = []
    for planned in (steps, STEPS):
        made = method.sequential("full", sensor, TABLE, planned, (), rate)
        for piece in in_pieces(track, [1000]):
            made.feed(piece)
        found.append(made.estimate()["w"].value.tobytes() == after.value[:p].tobytes())
    assert found == [True, False]
