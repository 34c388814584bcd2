"""Sections found in the signal of simulated recordings, whose true sections are known."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import pi, sqrt

import numpy as np
import pytest
from tests.refusals import refused

from inercal.basics.units import Measured
from inercal.benches import Hand
from inercal.benches.hand.bench import DEGREE
from inercal.benches.hand.simulation import PAUSE_SECONDS, simulate_hand_motion
from inercal.physics.plan import HandStep, Hold, Turn, ferraris_plan, six_positions
from inercal.physics.sensors import G0, Noise, Readout, Sensor, imu, triad
from inercal.pipeline import read_out
from inercal.recordings import Mark, Recording
from inercal.recordings.segments import find_sections
from inercal.recordings.segments.section_detection import SectionDetection

RATE = 100.0
ACCELEROMETER = (Readout(1 / G0, 0.0, "g"), Noise(white=150e-6 * G0))
GYRO = (Readout(180 / pi, 0.0, "°/s"), Noise(white=0.3 * DEGREE / 60))
IMU = imu("imu", ACCELEROMETER, GYRO)
TRIAD = triad("triad", "f", "a", *ACCELEROMETER)
HAND = Hand(
    Measured(9.81, 0.0),
    latitude=0.8,
    tilt=1.0 * DEGREE,
    turn_angle=2.0 * DEGREE,
    turn_tilt=1.0 * DEGREE,
)
PLAN = ferraris_plan(seconds=5.0, turn_seconds=5.0)


@dataclass(frozen=True, eq=False)
class Session:
    recording: Recording
    plan: tuple[HandStep, ...]
    sensor: Sensor

    def found(self, plan: Sequence[HandStep] | None = None) -> dict[str, Mark]:
        marks = find_sections(
            self.recording, self.sensor, self.plan if plan is None else plan
        ).marks
        assert len({mark.label for mark in marks}) == len(marks)
        return {mark.label: mark for mark in marks}

    def section(self, label: str) -> tuple[int, int]:
        assert self.recording.labels is not None
        inside = np.flatnonzero(self.recording.labels == label)
        return int(inside[0]), int(inside[-1]) + 1


def session(
    plan: tuple[HandStep, ...] = PLAN,
    sensor: Sensor = IMU,
    seed: int = 3,
    bench: Hand = HAND,
    **truth: float,
) -> Session:
    """Return a simulated session; `truth` are coefficients with _ for the dot."""
    rng = np.random.default_rng(seed)
    done = simulate_hand_motion(bench, plan, RATE, rng)
    by_name = {name.replace("_", ".", 1): value for name, value in truth.items()}
    modelled = sensor.with_coefficients(*by_name) if by_name else sensor
    c = np.array([by_name[name] for name in modelled.coefficients])
    data = read_out(modelled, done.motion, c, RATE, rng)[0]
    units = tuple(axis.readout.unit for axis in sensor.axes)
    made = Recording(done.time, data, sensor.channels, units, done.labels, source="log.csv")
    return Session(made, plan, sensor)


def assert_recovered(made: Session, plan: Sequence[HandStep] | None = None) -> None:
    """Assert that each step is found, within its own section and most of it."""
    steps = made.plan if plan is None else plan
    found = made.found(steps)
    assert list(found) == [step.label for step in steps]
    for step in steps:
        mark, (start, stop) = found[step.label], made.section(step.label)
        if isinstance(step, Hold):
            # Half a second at either end is lost to the window and to the margin.
            assert start <= mark.start < mark.stop <= stop
            assert mark.stop - mark.start > stop - start - 1.3 * RATE
        else:
            # The pauses around a turn are at rest and add no angle.
            pause = round(PAUSE_SECONDS * RATE)
            assert start - pause < mark.start < mark.stop < stop + pause
            still = round(0.9 * RATE)  # of min. jerk, the first and last second turn by 6 %
            assert mark.start < start + still
            assert mark.stop > stop - still
            gyros = [made.sensor.channels.index(a) for a in ("gx", "gy", "gz")]
            rates = made.sensor.to_si(made.recording.data)[:, gyros]
            rest = made.found(steps)[steps[0].label]
            bias = rates[rest.start : rest.stop].mean(axis=0)
            whole = ((rates[start:stop] - bias).sum(axis=0) @ np.array(step.axis)) / RATE
            marked = (rates[mark.start : mark.stop] - bias).sum(axis=0) @ np.array(step.axis) / RATE
            assert marked == pytest.approx(whole, abs=1e-3 * abs(step.angle))


def with_noise(sensor: Sensor, force: Noise, rate: Noise) -> Sensor:
    axes = tuple(
        replace(axis, noise=force if axis.measures == "f" else rate) for axis in sensor.axes
    )
    return replace(sensor, axes=axes)


@pytest.mark.parametrize("seed", range(6))
def test_every_step_of_a_session_is_found_within_its_section(seed: int):
    assert_recovered(session(seed=seed))


@pytest.mark.parametrize("angle", [-2 * pi, pi / 2, -pi, 4 * pi])
def test_turns_of_any_angle_and_sense_are_found(angle: float):
    assert_recovered(session(ferraris_plan(seconds=5.0, angle=angle, turn_seconds=6.0)))


def test_a_turn_made_the_other_way_is_found_all_the_same():
    made = session(ferraris_plan(seconds=5.0, angle=-2 * pi, turn_seconds=5.0))
    assert made.found(PLAN) == made.found()


@pytest.mark.parametrize("step_of_a_reading", [1e-3, 4e-3, 16e-3])
def test_coarse_quantisation_hides_no_section(step_of_a_reading: float):
    force = Noise(white=150e-6 * G0, quantisation=step_of_a_reading * G0)
    rate = Noise(white=0.3 * DEGREE / 60, quantisation=0.1 * DEGREE)
    assert_recovered(session(sensor=with_noise(IMU, force, rate)))


def test_channels_that_stand_still_at_rest_hide_no_section():
    # Quantisation a hundred times the noise: at rest a reading is one number.
    force = Noise(white=10e-6 * G0, quantisation=10e-3 * G0)
    rate = Noise(white=0.01 * DEGREE / 60, quantisation=0.1 * DEGREE)
    assert_recovered(session(sensor=with_noise(IMU, force, rate)))


@pytest.mark.parametrize("signs", [(1, 1, 1), (-1, 1, -1), (1, -1, -1), (-1, -1, -1)])
def test_biases_of_a_fifth_of_gravity_hide_no_section(signs: tuple[int, int, int]):
    x, y, z = (0.2 * G0 * sign for sign in signs)
    assert_recovered(session(ax_k0=x, ay_k0=y, az_k0=z))


def test_gyro_biases_and_scale_errors_of_a_cheap_sensor_hide_no_section():
    assert_recovered(
        session(gx_bias=0.05, gy_bias=-0.05, gz_bias=0.05, gx_scale=0.03, gz_scale=-0.03)
    )


def test_sensitivity_of_gyros_to_gravity_hides_no_section():
    large = 0.1 * DEGREE / G0  # 0.1 °/s per g
    assert_recovered(session(gx_g_i=large, gy_g_p=-large, gz_g_o=large))


def test_gyros_that_see_the_earth_turn_find_the_same_sections():
    # At 0.002 °/√h the ±11 °/h of the earth's rate on a face stand far above the noise.
    rate = Noise(white=0.002 * DEGREE / 60)
    assert_recovered(session(sensor=with_noise(IMU, IMU.axes[0].noise, rate)))


@pytest.mark.parametrize("seconds", [2.5, 3.0])
def test_short_rests_are_found(seconds: float):
    assert_recovered(session(ferraris_plan(seconds=seconds, turn_seconds=4.0)))


@pytest.mark.parametrize("seed", range(3))
def test_positions_are_found_without_gyros(seed: int):
    assert_recovered(session(six_positions(4.0), TRIAD, seed))


def test_positions_are_found_without_gyros_and_with_large_biases():
    assert_recovered(
        session(six_positions(4.0), TRIAD, ax_k0=0.2 * G0, ay_k0=-0.2 * G0, az_k0=0.2 * G0)
    )


def test_rests_that_belong_to_no_step_are_left_alone():
    edge, corner = sqrt(0.5), sqrt(1 / 3)
    others = (
        Hold("on an edge", (edge, edge, 0.0), 9.0),
        Hold("on a corner", (corner, -corner, corner), 9.0),
        Hold("on another edge", (0.0, -edge, edge), 9.0),
    )
    plan = (others[0], *PLAN[:4], others[1], *PLAN[4:7], others[2], *PLAN[7:])
    assert_recovered(session(plan), PLAN)


def test_the_longest_of_several_rests_in_one_position_is_taken():
    again = Hold("again", (0.0, 0.0, 1.0), 3.0)
    plan = (again, *PLAN[:5], replace(again, label="once more"), *PLAN[5:])
    assert_recovered(session(plan), PLAN)


def test_a_turn_by_half_the_angle_is_not_taken_for_the_step():
    aside = Turn("aside", (1.0, 0.0, 0.0), pi, 5.0)
    plan = (*PLAN[:6], aside, *PLAN[6:])
    assert_recovered(session(plan), PLAN)


@pytest.mark.parametrize("missing", [["z_a"], ["x_p", "x_a"], ["y_p", "z_p"], ["z_rot"]])
def test_what_was_not_carried_out_is_not_found(missing: list[str]):
    plan = tuple(step for step in PLAN if step.label not in missing)
    made = session(plan)
    # The pauses before and after a turn are rests with its axis up: too short, or truly that face.
    turned_up = {f"{a}_p" for a in "xyz" if f"{a}_rot" in {step.label for step in plan}}
    found = made.found(PLAN)
    assert set(found) - turned_up == {step.label for step in plan} - turned_up
    for label in set(found) & set(missing):
        mark = found[label]
        force = made.recording.data[mark.start : mark.stop, :3].mean(axis=0)
        assert force["xyz".index(label[0])] > 0.95


def test_positions_that_were_not_carried_out_are_not_found_without_gyros():
    plan = tuple(step for step in six_positions(4.0) if step.label != "z_a")
    made = session(plan, TRIAD, ax_k0=0.1 * G0, az_k0=-0.1 * G0)
    assert set(made.found(six_positions(4.0))) == {step.label for step in plan}


def test_samples_lost_in_a_rest_leave_its_longer_part():
    made = session()
    start, stop = made.section("y_p")
    time = made.recording.time.copy()
    time[start + 150 :] += 7.0
    mark = replace(made, recording=replace(made.recording, time=time)).found()["y_p"]
    assert start + 150 <= mark.start < mark.stop <= stop


def test_rests_too_short_to_average_are_refused():
    made = session(six_positions(1.0), TRIAD)
    with refused(names=[step.label for step in six_positions(1.0)]):
        made.found()


def test_a_recording_too_short_to_judge_is_refused():
    made = session().recording.slice(0, 150)
    with refused(names=()):
        find_sections(made, IMU, PLAN)


def test_sections_are_found_for_triads_only():
    pair = replace(IMU, axes=IMU.axes[:2])
    with refused(names=pair.channels):
        find_sections(session().recording, pair, PLAN)


def soaked(off: float, second_part: slice = slice(None)) -> SectionDetection:
    """Return the sections of two files; the gyros' bias of the second differs by `off`, °/s."""
    one = session(six_positions(seconds=4.0)).recording
    n, data = one.time.size, one.data.copy()
    data[:, 3:] += off
    data = np.vstack([one.data, data[second_part]])
    labels = np.array(["cold.csv"] * n + ["hot.csv"] * (len(data) - n))
    both = Recording(np.arange(len(data)) / RATE, data, one.channels, one.units, labels)
    return find_sections(both, IMU, six_positions(seconds=4.0), [(0, n), (n, len(data))])


def test_a_soak_whose_gyros_have_another_bias_is_at_rest():
    assert len(soaked(1.0).marks) == 12
    assert not soaked(1.0).findings


def test_a_soak_without_rests_is_named_by_its_file():
    found = soaked(0.0, slice(0, 1200))
    assert found.missing
    assert all(label.endswith("(2)") for label in found.missing)
    assert "hot.csv" in found.findings[0].message
    assert "cold.csv" not in found.findings[0].message
