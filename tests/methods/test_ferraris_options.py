"""Ferraris with an angle per axis, with biases of each recording, and of gyros alone.

Devices are of a generator that imports nothing of inercal, `tests.accuracy.ferraris`.
"""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from tests.accuracy.ferraris import DEGREE, TURNS, FerrarisSession, Handling, mems, record
from tests.accuracy.inercal_inputs import make_bench, make_observations, true_coefficients
from tests.refusals import refused

from inercal.benches import Hand
from inercal.estimation import Estimate
from inercal.methods import METHODS
from inercal.physics.sensors import Sensor, imu
from inercal.pipeline import Outcome, apply_data_columns, calibrate, simulate
from inercal.recordings.io.write import write_recording
from inercal.runfile import read

METHOD = METHODS["ferraris"]
HANDS = Handling(
    gravity_sd=2e-4,
    latitude=47 * DEGREE,
    tilt=0.05 * DEGREE,
    turn_tilt=0.3 * DEGREE,
    turn_angle=0.5 * DEGREE,
    timebase=1e-4,
)
ANGLES = (2 * np.pi, 4 * np.pi, -2 * np.pi)
TRIALS, RATE = 20, 25.0


def solved(
    made: FerrarisSession, sensor: Sensor, bench: Hand, angles: tuple[float, ...] = ANGLES[:1] * 3
) -> Estimate:
    steps = METHOD.plan(angle=angles)
    seen = make_observations(made, sensor, steps)
    return METHOD.estimator("ml")(seen, sensor, bench, steps)


def nees(found: Estimate, sensor: Sensor, truth: NDArray[np.float64]) -> float:
    p = len(sensor.coefficients)
    error = found.value[:, :p] - truth
    weighed = np.linalg.solve(found.covariance[:, :p, :p], error[..., None])[..., 0]
    return float((error * weighed).sum(axis=-1).mean() / p)


def joined(sessions: list[FerrarisSession]) -> FerrarisSession:
    """Return sessions of one sensor as one, one after the other."""
    marks: dict[str, tuple[int, int]] = {}
    start = 0
    for one in sessions:
        marks |= {label: (start + a, start + b) for label, (a, b) in one.marks.items()}
        start += one.time.size
    data = np.concatenate([one.data for one in sessions], axis=1)
    return FerrarisSession(np.arange(start) / RATE, data, marks, sessions[0].gravity)


@pytest.mark.slow
def test_each_axis_may_turn_by_an_angle_of_its_own(seed: int):
    rng = np.random.default_rng([seed, 1])
    device, hands = mems(rng), replace(HANDS, gravity_sd=0.0, timebase=0.0)
    parts = [record(device, hands, rng, trials=TRIALS, rate_hz=RATE, hold_seconds=4.0, turns={})]
    parts += [
        record(
            device,
            hands,
            rng,
            trials=TRIALS,
            rate_hz=RATE,
            faces={},
            turns={label: axis},
            angle=angle,
        )
        for (label, axis), angle in zip(TURNS.items(), ANGLES, strict=True)
    ]
    sensor = METHOD.prepare(imu())
    found = solved(joined(parts), sensor, make_bench(hands), ANGLES)
    assert 0.8 < nees(found, sensor, true_coefficients(device, sensor)) < 1.25
    # Two turns halve the error of the angle.
    sd = [found.std[..., found.names.index(f"g{a}.scale")].mean() for a in "xyz"]
    assert sd[1] == pytest.approx(sd[0] / 2, rel=0.05)
    assert sd[2] == pytest.approx(sd[0], rel=0.05)


@pytest.mark.parametrize("count", [2, 4])
def test_other_numbers_of_angles_are_refused(count: int):
    with refused(key="[method] turn"):
        METHOD.plan(angle=(6.0,) * count)


@pytest.mark.slow
def test_gyros_alone_take_positions_as_stated(seed: int):
    rng = np.random.default_rng([seed, 2])
    device = mems(rng, arm=np.array([0.03, -0.02, 0.05]))
    made = record(device, HANDS, rng, trials=TRIALS, rate_hz=RATE, hold_seconds=4.0)
    sensor = METHOD.prepare(imu().select_axes("w"))
    assert {axis.measures for axis in sensor.axes} == {"w"}
    found = solved(made, sensor, make_bench(HANDS))
    assert 0.8 < nees(found, sensor, true_coefficients(device, sensor)) < 1.25
    assert 0.8 < np.mean(found.chi2) / found.dof < 1.2


@pytest.mark.slow
def test_the_biases_may_differ_from_recording_to_recording(seed: int):
    rng, sd = np.random.default_rng([seed, 3]), 0.05 * DEGREE
    device = mems(rng)
    made = record(device, HANDS, rng, trials=TRIALS, rate_hz=RATE, hold_seconds=4.0)
    for start, stop in made.marks.values():
        made.data[:, start:stop, 3:] += sd * rng.standard_normal((TRIALS, 1, 3))
    sensor = METHOD.prepare(imu())
    truth = true_coefficients(device, sensor)
    found = solved(made, sensor, make_bench(HANDS, turn_on=sd))
    assert 0.8 < nees(found, sensor, truth) < 1.25
    assert 0.8 < np.mean(found.chi2) / found.dof < 1.2
    taken_as_one = solved(made, sensor, make_bench(HANDS))
    assert nees(taken_as_one, sensor, truth) > 2
    assert np.mean(taken_as_one.chi2) / taken_as_one.dof > 5


RUN = """[sensor]
name = "gyros"
[sensor.gyro]
unit = "°/s"
white = "0.01 °/s/√Hz"
[sensor.truth]
"gx.bias" = "0.3 °/s"
"gy.scale" = "-0.8 %"
[bench]
latitude = "48 °"
tilt = "0.2 °"
turn_angle = "0.3 °"
turn_tilt = "0.2 °"
[data]
file = "log.npz"
rate = "50 Hz"
time = "time"
accelerometer = []
label = "label"
marks = "labels"
[method]
name = "ferraris"
seconds = "5 s"
turn = ["360 °", "720 °", "-360 °"]
"""


def calibrated(folder: Path, *changes: tuple[str, str]) -> Outcome:
    path = folder / "run.toml"
    text = RUN
    path.write_text(text, encoding="utf-8")
    run = read(path)
    write_recording(apply_data_columns(run, simulate(run, 1)), run.file(run.data.file))
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    path.write_text(text, encoding="utf-8")
    return calibrate(path)


def test_a_run_file_of_gyros_alone_is_consistent(tmp_path: Path):
    outcome = calibrated(tmp_path)
    assert outcome.verdict.grade == "consistent"
    found = outcome.calibration
    truth = {"gx.bias": np.radians(0.3), "gy.scale": -0.008}
    for name in found.sensor.coefficients:
        assert abs(found.value(name) - truth.get(name, 0.0)) < 4.5 * found.uncertainty(name)


FILES = """[sensor.accelerometer]
unit = "m/s²"
[sensor.gyro]
unit = "rad/s"
[bench]
gravity = "9.81 m/s² ± 0.2 mm/s²"
latitude = "47 °"
tilt = "0.05 °"
turn_angle = "0.5 °"
turn_tilt = "0.3 °"
turn_on = "0.05 °/s"
[data]
file = "part_*.csv"
time = "time"
marks = "labels"
[method]
name = "ferraris"
"""


def test_a_file_for_each_section_may_have_biases_of_its_own(tmp_path: Path):
    rng = np.random.default_rng(5)
    device = mems(rng)
    made = record(device, HANDS, rng, rate_hz=RATE)
    for label, (start, stop) in made.marks.items():
        own = made.data[:1, start:stop].copy()
        own[..., 3:] += 0.05 * DEGREE * rng.standard_normal(3)
        part = FerrarisSession(made.time[: stop - start], own, {}, made.gravity)
        part.write_csv(tmp_path / f"part_{label}.csv")
    path = tmp_path / "run.toml"
    path.write_text(FILES, encoding="utf-8")
    outcome = calibrate(path)
    assert outcome.verdict.grade != "unreliable"
    found, truth = outcome.calibration, device.coefficients()
    error = [(found.value(n) - truth[n]) / found.uncertainty(n) for n in found.sensor.coefficients]
    assert np.abs(error).max() < 4


REFUSED: Mapping[str, tuple[str, str, str]] = {
    "marks": ('marks = "labels"', 'marks = "found"', "[data] marks"),
    "one recording": ("[data]", 'turn_on = "60 °/h"\n[data]', "[bench] turn_on"),
    "closed formulas": ('"ferraris"', '"ferraris"\nestimator = "classical"', "[method] estimator"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_what_gyros_alone_cannot_have_is_refused(tmp_path: Path, name: str):
    old, new, key = REFUSED[name]
    with refused(key=key):
        calibrated(tmp_path, (old, new))


def test_a_turn_by_another_angle_than_stated_is_refused(tmp_path: Path):
    with refused(names=["y_rot"]):
        calibrated(tmp_path, ('["360 °", "720 °", "-360 °"]', '["360 °", "300 °", "-360 °"]'))
