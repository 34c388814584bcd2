"""Rests found in simulated sessions, whose true rests are known, and in two real logs."""

from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from tests.accuracy.ferraris import DEGREE, mems
from tests.accuracy.handheld import Session, record
from tests.base_seeds import chosen, evidence
from tests.refusals import refused

from inercal.physics.sensors import G0, Noise, Readout, Sensor, imu, triad
from inercal.recordings import Recording
from inercal.recordings.segments.motion_thresholds import scatter
from inercal.recordings.segments.rest_detection import RestDetection, find_rests

Array = NDArray[np.float64]
Ranges = list[tuple[int, int]]
RATE = 100.0
IMU = imu("imu", (Readout(unit="m/s²"), Noise()), (Readout(unit="rad/s"), Noise()))
TRIAD = triad("triad", "f", "a", Readout(unit="m/s²"))
QUIET = np.repeat([0.01, 0.001], 3)  # m/s², rad/s


@dataclass(frozen=True, eq=False)
class Made:
    recording: Recording
    rests: Ranges

    def found(self, sensor: Sensor = IMU) -> Ranges:
        return ranges(find_rests(self.recording, sensor))

    def changed(self, data: Array) -> "Made":
        return replace(self, recording=recorded(data))


def recorded(data: Array, sensor: Sensor = IMU, time: Array | None = None) -> Recording:
    stamps = np.arange(len(data)) / RATE if time is None else time
    units = tuple(axis.readout.unit for axis in sensor.axes)
    return Recording(stamps, data, sensor.channels, units, source="log.csv")


def ranges(rests: RestDetection) -> Ranges:
    return [(mark.start, mark.stop) for mark in rests.marks]


@cache
def made(seed: int = 1, *, noise: float = 1.0, **changes: Any) -> Made:
    """Return a session of 16 rests of 3 s and moves of 1.5 s, but for the changes."""
    rng = np.random.default_rng(seed)
    sensor = mems(rng)
    quiet = replace(sensor, white_a=noise * sensor.white_a, white_g=noise * sensor.white_g)
    done = record(quiet, Session(**{"positions": 16, **changes}), rng)
    return Made(recorded(done.data[0].copy()), done.rests)


def still(seconds: float, at: Array, rng: np.random.Generator) -> Array:
    return at + QUIET * rng.standard_normal((round(seconds * RATE), 6))


def assert_recovered(session: Made, found: Ranges | None = None) -> None:
    """Assert that each true rest is found as one, within it."""
    got = session.found() if found is None else found
    assert len(got) == len(session.rests)
    for (start, stop), (first, last) in zip(session.rests, got, strict=True):
        assert start <= first < last <= stop
        assert last - first > stop - start - 1.4 * RATE


def seldom_at_rest(seed: int = 1, **changes: Any) -> Made:
    """Return a session of which seven rests in eight are left out: moves follow on moves."""
    whole = made(seed, positions=81, hold_seconds=1.6, **changes)
    kept, rests, lost = np.ones(len(whole.recording.data), dtype=np.bool_), [], 0
    for k, (start, stop) in enumerate(whole.rests):
        if k % 8:
            kept[start:stop] = False
            lost += stop - start
        else:
            rests.append((start - lost, stop - lost))
    return Made(recorded(whole.recording.data[kept]), rests)


@pytest.mark.parametrize("seed", chosen(range(4), (0, 1)))
@pytest.mark.parametrize("hold", [1.5, 2.0, 3.0, 10.0, 20.0])
def test_every_rest_of_a_session_is_found_within_itself(seed: int, hold: float):
    assert_recovered(made(seed, hold_seconds=hold))


@pytest.mark.parametrize("seed", chosen(range(4), (0, 1)))
def test_rests_are_found_that_take_an_eighth_of_the_time(seed: int):
    session = seldom_at_rest(seed)
    assert sum(b - a for a, b in session.rests) < 0.14 * len(session.recording.data)
    assert_recovered(session)


@pytest.mark.parametrize("degrees", [0.02, 0.1, 0.2])
@pytest.mark.parametrize("hold", [2.0, 3.0, 10.0])
def test_a_tremor_hides_no_rest(degrees: float, hold: float):
    push = 0.2 * degrees
    assert_recovered(made(hold_seconds=hold, tremor_deg=degrees, tremor_push=push))


@pytest.mark.parametrize("step", [0.01, 0.05, 0.2, 0.5])
@pytest.mark.parametrize("hold", [2.0, 3.0, 19.0])
def test_coarse_steps_hide_no_rest(step: float, hold: float):
    session = made(hold_seconds=hold)
    steps = np.repeat([step, 0.2 * step], 3)
    assert_recovered(session.changed(np.round(session.recording.data / steps) * steps))


def test_noise_that_differs_between_axes_hides_no_rest():
    session = made()
    noise = np.random.default_rng(3).standard_normal(session.recording.data.shape)
    sizes = np.array([0.3, 0.01, 0.01, 0.001, 0.05, 0.001])
    assert_recovered(session.changed(session.recording.data + sizes * noise))


@pytest.mark.parametrize("minutes", [1, evidence(10), 60])
def test_one_long_rest_on_a_table_does_not_hide_those_in_the_hand(minutes: int):
    session = made(tremor_deg=0.1, tremor_push=0.02)
    data, (_, first) = session.recording.data, session.rests[0]
    table = still(60.0 * minutes, data[0], np.random.default_rng(4))
    later = len(table) - first
    rests = [(0, len(table))] + [(a + later, b + later) for a, b in session.rests[1:]]
    assert_recovered(Made(recorded(np.concatenate([table, data[first:]])), rests))


def test_a_shock_hides_no_rest():
    session = made()
    shock = 1e4 * np.random.default_rng(5).standard_normal((20, 6))
    assert_recovered(session.changed(np.concatenate([session.recording.data, shock])))


def test_a_recording_may_begin_and_end_in_motion():
    session = made()
    start, stop = session.rests[0][1] + 40, session.rests[-1][0] - 40
    rests = [(a - start, b - start) for a, b in session.rests[1:-1]]
    assert_recovered(Made(recorded(session.recording.data[start:stop]), rests))


@pytest.mark.slow
def test_accelerometers_alone_find_the_rests():
    session = made()
    alone = recorded(session.recording.data[:, :3], TRIAD)
    found = find_rests(alone, TRIAD)
    assert_recovered(session, ranges(found))
    assert [level.kind for level in found.levels] == ["f"]


@pytest.mark.slow
def test_columns_between_the_axes_and_their_order_in_memory_do_not_matter():
    session = made()
    data = session.recording.data
    other = np.full((len(data), 1), np.nan)
    wide = np.asfortranarray(np.concatenate([data[:, 3:], other, data[:, :3]], axis=1))
    channels = (*IMU.channels[3:], "t", *IMU.channels[:3])
    units = ("rad/s",) * 3 + ("°C",) + ("m/s²",) * 3
    moved = replace(session.recording, data=wide, channels=channels, units=units)
    assert ranges(find_rests(moved, IMU)) == session.found()


@pytest.mark.parametrize(("gain", "offset"), [(411.0, 33000.0), (1 / G0, 0.0), (-3e-7, 5.0)])
def test_a_change_of_units_leaves_the_rests_and_scales_the_thresholds(gain: float, offset: float):
    session = made(tremor_deg=0.1)
    before = find_rests(session.recording, IMU)
    after = find_rests(recorded(offset + gain * session.recording.data), IMU)
    assert ranges(after) == ranges(before)
    for old, new in zip(before.levels, after.levels, strict=True):
        for name in ("quiet", "moving", "threshold"):
            assert getattr(new, name) == pytest.approx(abs(gain) * getattr(old, name), rel=1e-6)


def test_an_axis_in_units_of_its_own_weighs_as_much_as_the_others():
    session = made()
    x, y, z = IMU.axes[:3]
    own = replace(IMU, axes=(x, replace(y, readout=Readout(-4e4, 7.0, "LSB")), z, *IMU.axes[3:]))
    data = session.recording.data.copy()
    data[:, 1] = 7.0 - 4e4 * data[:, 1]
    assert session.changed(data).found(own) == session.found()


def test_levels_are_scatters_in_output_units():
    session = made(noise=0.0)
    noise = np.random.default_rng(6).standard_normal(session.recording.data.shape)
    found = find_rests(recorded(session.recording.data + 20 * QUIET * noise), IMU)
    assert [level.unit for level in found.levels] == ["m/s²", "rad/s"]
    for level, quiet in zip(found.levels, 20 * QUIET[[0, 3]], strict=True):
        assert level.quiet == pytest.approx(quiet, rel=0.05)
        assert 1.5 * level.quiet < level.threshold < level.moving
    assert found.window == pytest.approx(0.5)


def test_rests_are_labelled_and_a_note_gives_their_number():
    found = find_rests(made(hold_seconds=4.0).recording, IMU)
    assert [mark.label for mark in found.marks] == [f"r{k:02d}" for k in range(1, 17)]
    assert (found.finding.severity, found.finding.what) == ("note", "rests")
    assert found.finding.message.startswith("16 rests of 2.8")


def test_a_gap_within_a_rest_splits_it():
    session = made(hold_seconds=5.0)
    start, stop = session.rests[7]
    time = session.recording.time.copy()
    time[start + 250 :] += 3.0
    found = ranges(find_rests(replace(session.recording, time=time), IMU))
    assert len(found) == 17
    assert start <= found[7][0] < found[7][1] <= start + 250 <= found[8][0] < found[8][1] <= stop


def test_a_move_lost_in_a_gap_does_not_join_the_rests_around_it():
    session = made()
    data = session.recording.data
    kept = np.ones(len(data), dtype=np.bool_)
    kept[session.rests[3][1] : session.rests[4][0]] = False
    assert len(find_rests(session.recording.take(kept), IMU).marks) == 16


def crept(session: Made, rate: float, seconds: float = 6.0) -> Recording:
    """Return the session and, in the middle of a ninth move, a slow turn about a level axis."""
    angle = np.arange(round(seconds * RATE)) / RATE * rate * DEGREE
    at = np.zeros(6)
    slow = still(seconds, at, np.random.default_rng(8))
    slow[:, 0] += 9.81 * np.cos(0.7 + angle)
    slow[:, 1] += 9.81 * np.sin(0.7 + angle)
    slow[:, 5] += rate * DEGREE
    middle = (session.rests[8][1] + session.rests[9][0]) // 2
    data = session.recording.data
    return recorded(np.concatenate([data[:middle], slow, data[middle:]]))


@pytest.mark.parametrize("rate", [1.0, 2.0, 5.0])
def test_a_slow_creep_is_no_rest(rate: float):
    session = made()
    found = find_rests(crept(session, rate), IMU)
    assert len(found.marks) == 16
    assert "1 left out" in found.finding.message


def test_a_stay_without_creep_in_the_same_place_is_a_rest():
    assert len(find_rests(crept(made(), 0.0), IMU).marks) == 17


def test_a_slow_creep_is_no_rest_without_gyros():
    slow = crept(made(), 1.0)
    assert len(find_rests(recorded(slow.data[:, :3], TRIAD), TRIAD).marks) == 16


def test_the_creeping_end_of_a_rest_is_cut_off():
    session = made()
    start, stop = session.rests[8]
    data = session.recording.data
    creep = still(1.5, data[start:stop].mean(axis=0), np.random.default_rng(9))
    creep[:, :3] += 0.05 * np.arange(len(creep))[:, None] / RATE * 3
    longer = still(3.0, data[start:stop].mean(axis=0), np.random.default_rng(10))
    whole = recorded(np.concatenate([data[:stop], longer, creep, data[stop:]]))
    found = find_rests(whole, IMU)
    assert len(found.marks) == 16
    assert start <= found.marks[8].start
    assert stop + 250 < found.marks[8].stop < stop + 380
    assert "1 shortened" in found.finding.message


def test_a_steady_turn_about_the_vertical_is_no_rest():
    session = made()
    middle = (session.rests[4][1] + session.rests[5][0]) // 2
    data = session.recording.data
    turn = still(4.0, np.array([0, 0, 9.81, 0, 0, 20 * DEGREE]), np.random.default_rng(11))
    whole = recorded(np.concatenate([data[:middle], turn, data[middle:]]))
    assert len(find_rests(whole, IMU).marks) == 16


def test_a_dead_axis_does_not_disturb():
    session = made()
    data = session.recording.data.copy()
    data[:, 1] = 512.0
    assert_recovered(session.changed(data))


def test_one_step_of_a_dead_axis_is_not_taken_for_its_resolution():
    session = made()
    data = session.recording.data.copy()
    data[:, 1] = 512.0
    data[session.rests[2][1] + 75 :, 1] = 600.0
    assert_recovered(session.changed(data))


def test_dead_gyros_have_no_say():
    session = made()
    data = session.recording.data.copy()
    data[:, 3:] = 0.0
    found = find_rests(recorded(data), IMU)
    assert_recovered(session, ranges(found))
    assert np.isinf(found.levels[1].threshold)


@pytest.mark.parametrize("step", [1e-9, 0.05])
def test_a_recording_of_one_position_is_refused(step: float):
    data = still(300.0, np.arange(6.0), np.random.default_rng(12))
    with refused():
        find_rests(recorded(np.round(data / step) * step), IMU)


def test_one_position_in_a_swaying_hand_is_refused():
    session = made(positions=2, hold_seconds=120.0, tremor_deg=0.3, tremor_push=0.05)
    with refused():
        find_rests(recorded(session.recording.data[: session.rests[0][1]]), IMU)


def test_a_constant_recording_is_refused():
    with refused():
        find_rests(recorded(np.ones((1000, 6))), IMU)


@pytest.mark.parametrize("seed", chosen(range(8), range(2)))
@pytest.mark.parametrize("hold", [0.01, 0.05])
def test_a_recording_without_a_rest_is_refused(seed: int, hold: float):
    whole = made(seed, positions=60, hold_seconds=hold)
    moving = slice(whole.rests[0][1], whole.rests[-1][0])
    with refused():
        find_rests(recorded(whole.recording.data[moving]), IMU)


def test_a_recording_too_short_to_judge_is_refused():
    with refused():
        find_rests(made().recording.slice(0, 150), IMU)


def test_a_trial_axis_is_refused():
    session = made()
    trials = replace(session.recording, data=session.recording.data[None])
    with refused():
        find_rests(trials, IMU)
    with refused():
        scatter(trials, IMU, "f")


def test_the_scatter_of_reports_is_that_which_the_thresholds_limit():
    session = made()
    found = find_rests(session.recording, IMU)
    for level in found.levels:
        drawn = scatter(session.recording, IMU, level.kind)
        assert drawn.shape == session.recording.time.shape
        assert np.isfinite(drawn).all()
        assert all((drawn[a:b] < level.threshold).all() for a, b in ranges(found))
        assert (drawn > level.threshold).any()


def test_the_scatter_of_a_kind_that_the_sensor_lacks_is_refused():
    session = made()
    with refused(names=["w"]):
        scatter(recorded(session.recording.data[:, :3], TRIAD), TRIAD, "w")


def test_rates_other_than_100_hz_find_the_same_rests():
    slow, fast = made(rate_hz=50.0), made(rate_hz=400.0)
    for session, rate in ((slow, 50.0), (fast, 400.0)):
        time = np.arange(len(session.recording.data)) / rate
        found = ranges(find_rests(recorded(session.recording.data, time=time), IMU))
        assert len(found) == 16
        for (start, stop), (first, last) in zip(session.rests, found, strict=True):
            assert start <= first < last <= stop


def test_rests_of_an_xsens_in_raw_counts_are_found(data_dir: Path):
    folder = data_dir / "xsens_mti_multiposition"
    if not folder.is_dir():
        pytest.skip(f"no {folder}")
    force, rate = (np.loadtxt(folder / f"xsens_{name}.mat") for name in ("acc", "gyro"))
    counts = imu("mti", *[(Readout(unit="LSB"), Noise())] * 2)
    log = recorded(np.column_stack([force[:, 1:], rate[:, 1:]]), counts, force[:, 0])
    found = find_rests(log, counts)
    assert len(found.marks) == 38  # as imu_tk, which tries thresholds until the residuals are least
    assert found.marks[0].stop - found.marks[0].start > 5000
    assert found.levels[0].quiet == pytest.approx(3.2, rel=0.05)
    assert 7 * found.levels[0].quiet < found.levels[0].threshold < 0.2 * found.levels[0].moving


def test_rests_of_an_mpu9150_now_in_the_hand_now_on_a_table_are_found(data_dir: Path):
    path = data_dir / "mpu9150_multiposition" / "imu0.log"
    if not path.is_file():
        pytest.skip(f"no {path}")
    found = find_rests(recorded(np.loadtxt(path)), IMU)
    assert len(found.marks) == 22
    assert all(mark.stop - mark.start > 1.9 * RATE for mark in found.marks)
