"""What counts as a recording that moves, and what still passes as a rest."""

import tomllib
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from tests.program import run_program

from inercal.basics.arrays import Array
from inercal.noise.recording_checks import movement
from inercal.recordings import Recording

RATE = 50.0  # Hz
SECONDS = 600.0
G = 9.81
UNITS = ("--set", "sensor.gyro.unit=°/s", "--set", "sensor.accelerometer.unit=m/s²")
Change = Callable[[Array, Array, Array], None]


def rest(seed: int = 1) -> tuple[Array, Array]:
    """Return time, and three accelerometers in m/s² beside three gyros in °/s, at rest."""
    rng = np.random.default_rng(seed)
    time = np.arange(round(SECONDS * RATE)) / RATE
    data = np.concatenate(
        [
            [0.1, -0.2, G] + 0.02 * rng.standard_normal((time.size, 3)),
            [0.5, -0.3, 0.1] + 0.1 * rng.standard_normal((time.size, 3)),
        ],
        axis=1,
    )
    return time, data


def found(change: Change) -> str:
    time, data = rest()
    change(time, data[:, :3], data[:, 3:])
    channels = ("ax", "ay", "az", "gx", "gy", "gz")
    return movement(Recording(time, data, channels, ("m/s²",) * 3 + ("°/s",) * 3))


def burst(t: Array, f: Array, w: Array) -> None:
    on = (t > 200) & (t < 230)
    vibration = np.sin(2 * np.pi * 17 * t[on])
    f[on] += 5 * vibration[:, None]
    w[on] += 50 * vibration[:, None]


def knock(t: Array, f: Array, w: Array) -> None:
    on = (t > 300) & (t < 300.4)
    f[on] += 30
    w[on] += 15 * np.sign(300.2 - t[on])[:, None]


def tilt_drift(t: Array, f: Array, w: Array) -> None:
    angle = np.radians(5) * t / SECONDS
    f[:, 0] += G * np.sin(angle)
    w[:, 1] += 5 / SECONDS


def temperature_ramp(t: Array, f: Array, w: Array) -> None:
    f += 0.8 * (t / SECONDS)[:, None]
    w += 20 * (t / SECONDS)[:, None]


def step_of_a_bias(t: Array, f: Array, w: Array) -> None:
    f[t > 250, 1] += 0.05
    w[t > 250, 1] += 0.5


def other_face(t: Array, f: Array, w: Array) -> None:
    f[t > 400] = f[t > 400][:, [2, 0, 1]]


def one_face_for_ten_seconds(t: Array, f: Array, w: Array) -> None:
    on = (t > 400) & (t < 410)
    f[on] = f[on][:, [2, 0, 1]]


def turn_about_gravity(t: Array, f: Array, w: Array) -> None:
    on = (t > 100) & (t < 104)
    w[on, 2] += 90


def swing_in_a_hand(t: Array, f: Array, w: Array) -> None:
    w[:, 2] += 60 * np.cos(2 * np.pi * 0.7 * t)


def steps_of_a_rate_table(t: Array, f: Array, w: Array) -> None:
    w[:, 2] += 10 * np.floor(t / 60)


@pytest.mark.parametrize("change", [burst, knock, tilt_drift, temperature_ramp, step_of_a_bias])
def test_a_disturbed_or_drifting_rest_passes(change: Change):
    assert found(change) == ""


@pytest.mark.parametrize("change", [other_face, one_face_for_ten_seconds])
def test_gravity_that_turns_in_the_case_is_a_movement(change: Change):
    text = found(change)
    assert "accelerometers read" in text
    assert " 0 %" not in text
    assert "gyros" not in text


@pytest.mark.parametrize("change", [turn_about_gravity, swing_in_a_hand, steps_of_a_rate_table])
def test_gyros_that_turn_are_a_movement_where_gravity_stays(change: Change):
    text = found(change)
    assert "accelerometers" not in text
    assert "gyros" in text


def test_ten_degrees_of_gravity_is_the_limit():
    def tilted(degrees: float) -> Change:
        def change(t: Array, f: Array, w: Array) -> None:
            later, angle = t > 500, np.radians(degrees)
            f[later, 0] += G * np.sin(angle)

        return change

    assert found(tilted(9)) == ""
    assert "0.17 g" in found(tilted(11))


def test_white_noise_of_any_size_is_a_rest():
    rng = np.random.default_rng(3)
    time = np.arange(5000) / 100
    for size in (1.0, 100.0):
        data = size * rng.standard_normal((5000, 2))
        assert movement(Recording(time, data, ("ax", "gx"), ("m/s²", "rad/s"))) == ""


def write_log(path: Path, change: Change) -> Path:
    time, data = rest()
    change(time, data[:, :3], data[:, 3:])
    head = "time,ax,ay,az,gx,gy,gz"
    rows = np.column_stack([time, data])[::4]
    np.savetxt(path, rows, "%.6g", ",", header=head, comments="")
    return path


@pytest.mark.parametrize(
    "options",
    [("--write", "run.toml"), ("--to", "kalibr"), ("--register", "reg.db", "--sensor", "imu 7")],
)
def test_noise_of_a_sensor_that_moved_is_not_stored(tmp_path: Path, options: tuple[str, ...]):
    log = write_log(tmp_path / "log.csv", other_face)
    given = [str(tmp_path / one) if "." in one else one for one in options]
    done = run_program("noise", log, *UNITS, "--out", tmp_path, "--report", *given)
    assert done.status == 2
    assert done.error.count("\n") == 1
    assert "not at rest" in done.error
    assert options[0] in done.error
    assert [one.name for one in tmp_path.iterdir()] == ["log.csv"]


@pytest.mark.slow
def test_noise_of_a_sensor_that_moved_begins_with_that_it_moved(tmp_path: Path):
    log = write_log(tmp_path / "log.csv", other_face)
    options = (*UNITS, "--report", "--out", tmp_path)
    done = run_program("noise", log, *options)
    assert done.status == 3, done.error
    assert done.output.startswith("NOT AT REST")
    assert 'class="verdict bad"' in (tmp_path / "log.noise.html").read_text()


@pytest.mark.slow
@pytest.mark.parametrize("json", [False, True])
def test_a_script_sees_by_the_exit_status_that_the_sensor_moved(tmp_path: Path, json: bool):
    log = write_log(tmp_path / "log.csv", other_face)
    done = run_program("noise", log, *UNITS, "--terms", "N", *("--json",) * json)
    assert done.status == 3
    assert done.output


@pytest.mark.slow
def test_a_disturbed_rest_is_stored(tmp_path: Path):
    log = write_log(tmp_path / "log.csv", knock)
    target = tmp_path / "run.toml"
    options = (*UNITS, "--terms", "NB", "--write", target)
    assert run_program("noise", log, *options).status == 2  # the knock changes N by more than U
    assert not target.exists()
    done = run_program("noise", log, *options, "--skip-disturbed")
    assert done.status == 0, done.error
    assert tomllib.loads(target.read_text())["sensor"]["gyro"]["white"]
