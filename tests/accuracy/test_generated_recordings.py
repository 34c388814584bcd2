"""The full path, from files to a calibration, on sessions simulated without inercal."""

import json
from pathlib import Path

import numpy as np
import pytest
from tests.accuracy.ferraris import DEGREE, G0, FerrarisSession, Handling, Imu, mems, record

from inercal.pipeline import Outcome, calibrate

HANDS = Handling(
    gravity=9.8072,
    gravity_sd=2e-4,
    latitude=47 * DEGREE,
    tilt=0.3 * DEGREE,
    turn_tilt=0.3 * DEGREE,
    turn_angle=0.5 * DEGREE,
    table=0.3 * DEGREE,
    timebase=1e-4,
)
RUN = """
[sensor]
[sensor.accelerometer]
{accelerometer}
[sensor.gyro]
{gyro}
[bench]
gravity = "9.8072 m/s² ± 0.2 mm/s²"
latitude = "47 °"
tilt = "0.3 °"
turn_angle = "0.5 °"
turn_tilt = "0.3 °"
[data]
file = "session.csv"
time = "time"
marks = "{marks}"
[method]
name = "ferraris"
turn = "{turn} °"
"""
SI = {"accelerometer": 'unit = "m/s²"', "gyro": 'unit = "rad/s"', "turn": "360"}


def session(seed: int, **changes: object) -> tuple[Imu, FerrarisSession]:
    rng = np.random.default_rng(seed)
    device = mems(rng, arm=np.array([0.03, -0.02, 0.05]))
    return device, record(device, HANDS, rng, moves=True, **changes)  # type: ignore[arg-type]


def calibrated(folder: Path, made: FerrarisSession, **settings: str) -> Outcome:
    made.write_csv(folder / "session.csv")
    path = folder / "run.toml"
    path.write_text(RUN.format(**(SI | settings)), encoding="utf-8")
    return calibrate(path)


def deviations(outcome: Outcome, device: Imu) -> np.ndarray:
    """Return (found − true) / stated standard uncertainty of every coefficient."""
    named = device.coefficients()
    names = outcome.calibration.sensor.coefficients
    truth = np.array([named[name] for name in names])
    return (outcome.calibration.values - truth) / outcome.calibration.std


@pytest.mark.parametrize("seed", [51, 52])
@pytest.mark.parametrize("turn", [360, -360])
def test_sections_found_in_a_file_lead_to_the_truth(tmp_path: Path, seed: int, turn: int):
    device, made = session(seed, angle=turn * DEGREE)
    outcome = calibrated(tmp_path, made, marks="found", turn=str(turn))
    assert {mark.label for mark in outcome.marks} == set(made.marks)
    for mark in outcome.marks:
        start, stop = made.marks[mark.label]
        # Half a second of uncertain edges at either end, of ten and eight seconds.
        assert mark.start == pytest.approx(start, abs=60)
        assert mark.stop == pytest.approx(stop, abs=60)
    apart = deviations(outcome, device)
    assert np.abs(apart).max() < 4
    # Of 33 deviations of one, summed squares: 4 sd of chi squared.
    assert np.mean(apart**2) < 1 + 4 * np.sqrt(2 / apart.size)


@pytest.mark.slow
def test_marks_of_a_file_and_counts_of_an_adc_change_nothing(tmp_path: Path):
    device, made = session(53)
    scale = np.repeat([2048 / G0, 16.4 / DEGREE], 3)
    counts = FerrarisSession(made.time, made.data * scale, made.marks, made.gravity)
    listed = {name: {"start": a, "end": b} for name, (a, b) in made.marks.items()}
    (tmp_path / "marks.json").write_text(json.dumps(listed), encoding="utf-8")
    si = calibrated(tmp_path, made, marks="marks.json")
    raw = calibrated(
        tmp_path,
        counts,
        marks="marks.json",
        accelerometer='unit = "LSB"\nscale = "2048 LSB/g"',
        gyro='unit = "LSB"\nscale = "16.4 LSB/(°/s)"',
    )
    assert np.abs(deviations(si, device)).max() < 4
    apart = np.abs(raw.calibration.values - si.calibration.values)
    assert (apart < 1e-4 * si.calibration.std).all()
    np.testing.assert_allclose(raw.calibration.std, si.calibration.std, rtol=1e-4)


def test_a_corrected_recording_reads_gravity_at_rest_and_the_angle_of_a_turn(tmp_path: Path):
    """Applied to its own recording the calibration gives |f| = g and what the hand turned."""
    _, made = session(54)
    outcome = calibrated(tmp_path, made, marks="found")
    motion = outcome.calibration.correct(made.data[0])
    for label, (start, stop) in made.marks.items():
        if "rot" in label:
            angle = motion.w[start:stop].mean(axis=0) * (stop - start) / 100
            assert np.linalg.norm(angle) == pytest.approx(2 * np.pi, abs=4 * HANDS.turn_angle)
        else:
            force = np.linalg.norm(motion.f[start:stop].mean(axis=0))
            assert force == pytest.approx(made.gravity[0], rel=2e-4)
