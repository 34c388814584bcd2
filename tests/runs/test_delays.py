"""The delay of one kind of sensors: found by a calibration of two files, and removed by apply."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from tests import generated_logs as logs

import inercal
from inercal.basics.errors import NotObserved
from inercal.basics.units import Measured
from inercal.calibration import Calibration
from inercal.calibration.delays import delay_condition, stated_delays, uncorrected_delays
from inercal.export import export_calibration
from inercal.methods.six_position import METHOD
from inercal.physics.sensors import Sensor, imu
from inercal.pipeline.run_calibration import calibrate_run
from inercal.runfile import read

LATE = 0.025  # s
UP = np.array([0.0, 0.0, logs.G])
RUN = """\
[sensor.accelerometer]
unit = "m/s²"
[sensor.gyro]
unit = "rad/s"
[bench]
gravity = "9.80665 m/s²"
[data]
file = "log.csv"
time = "t"
accelerometer = ["fx", "fy", "fz"]
gyro = ["wx", "wy", "wz"]
[method]
name = "multi_position"
"""


def device(late: float, sd: float, sensor: Sensor | None = None) -> Calibration:
    sensor = sensor or METHOD.prepare(imu())
    p = len(sensor.coefficients)
    conditions = delay_condition("w", Measured(late, sd))
    return Calibration(sensor, np.zeros(p), np.eye(p), "six_position", "gls", conditions, {}, ())


def motion(t: np.ndarray) -> np.ndarray:
    return np.stack([np.sin(7 * t), np.cos(5 * t), 0.1 * t], axis=1)


@pytest.mark.parametrize("late", [LATE, -LATE])
def test_apply_moves_late_rates_to_the_times_of_the_forces(late: float, tmp_path: Path):
    t = np.delete(np.arange(600) * 0.01, np.s_[200:260])  # with a gap
    columns = [t, *(motion(t) + UP).T, *motion(t - late).T]
    logs.write(tmp_path / "log.csv", ("t", "fx", "fy", "fz", "wx", "wy", "wz"), columns)
    (tmp_path / "run.toml").write_text(RUN)
    run = read(tmp_path / "run.toml")
    made = inercal.apply(device(late, 1e-4, run.sensor), run)
    assert [one.what for one in made.findings if one.what == "delay"] == ["delay"]
    assert len(made.time) == len(t) - 2 * 3  # at an end and at the gap
    assert made.data[:, :3] == pytest.approx(motion(made.time) + UP, abs=1e-4)
    assert made.data[:, 3:] == pytest.approx(motion(made.time), abs=1e-3)
    unclear = inercal.apply(device(late, 0.02, run.sensor), run)
    assert unclear.data[:, 3:] == pytest.approx(motion(t - late), abs=1e-4)


def test_an_export_states_a_delay_that_it_does_not_correct():
    made = export_calibration(device(LATE, 1e-4), "c", rate=(-1.0, 1.0), force=(-10.0, 10.0))
    (text,) = uncorrected_delays(device(LATE, 1e-4).conditions)
    assert text.split(" ±")[0] in made.text
    assert not uncorrected_delays(device(LATE, 0.02).conditions)


def two_files(folder: Path, later: float) -> tuple[np.ndarray, np.ndarray]:
    """Write unequal rests with a gyro file that begins later; return times and rates, rad/s."""
    log, rng = logs.by_hand(11, rests=16, still=5.5), np.random.default_rng(1)
    shorter = rng.integers(0, 250, 16)
    place = np.arange(len(log["t"])) % 650  # samples of a rest and the next turn
    used = (log["rest"] < 0) | (place >= shorter[log["rest"]])
    rate, t = np.radians(log["w"][used]), 0.01 * np.arange(used.sum())
    kept, force = t >= later, log["f"][used] * logs.G
    logs.write(folder / "log.csv", ("t", "fx", "fy", "fz"), [t, *force.T])
    head = ("t", "wx", "wy", "wz")
    logs.write(folder / "gyro.csv", head, [t[kept] - later, *rate[kept].T])
    text = RUN.replace('time = "t"', 'time = "t"\ngyro_file = "gyro.csv"\ngyro_time = "t"')
    (folder / "run.toml").write_text(text)
    (folder / "stated.toml").write_text(f"{text}time_offset = true\n")
    return t, rate


@pytest.mark.slow
def test_clocks_that_differ_by_more_than_the_rests_are_named_with_the_difference(tmp_path: Path):
    two_files(tmp_path, 9.8)
    with pytest.raises(NotObserved, match=r"the gyros' samples are 9\.8 s earlier"):
        calibrate_run(read(tmp_path / "run.toml"))


@pytest.mark.slow
def test_files_whose_clocks_start_at_their_own_zero_are_calibrated_and_corrected(tmp_path: Path):
    t, rate = two_files(tmp_path, 0.63)
    plain, stated = (
        calibrate_run(read(tmp_path / name), advise=False) for name in ("run.toml", "stated.toml")
    )
    assert "delay" in plain.verdict.warned
    assert "delay" not in stated.verdict.warned
    (found,) = stated_delays(stated.calibration.conditions).values()
    assert found.value == pytest.approx(-0.63, abs=4 * found.sd)
    zero = replace(stated.calibration, conditions=plain.calibration.conditions)
    off = []
    for one in (stated.calibration, zero):
        made = inercal.apply(one, tmp_path / "stated.toml")
        biases = np.array([one.value(f"g{axis}.bias") for axis in "xyz"])
        true = np.stack([np.interp(made.time, t, w) for w in (rate - biases).T], axis=1)
        off.append(float(np.std(made.data[:, 3:] - true)))
    assert off[0] < 0.01 < 0.3 < off[1]
