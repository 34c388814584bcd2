"""The noise of magnetometers at rest is found; counts that are stated as µT are named."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.base_seeds import evidence
from tests.magnetometer import generator as sim
from tests.magnetometer.recorded import recording
from tests.program import run_program
from tests.refusals import refused

from inercal.basics.errors import InputError
from inercal.noise import NoiseAnalysis, analyse_noise
from inercal.noise.noise_files import ros_text
from inercal.noise.sensor_noise import sensor_noise
from inercal.pipeline import calibrate
from inercal.pipeline.drafts.rest_recording import read_rest_recording

RATE, N, SIGMA = 100.0, 3000, 0.3  # Hz, samples, µT
WHITE = 1e-6 * SIGMA / np.sqrt(RATE)  # T/√Hz
GYRO = {"sensor.gyro.unit": "rad/s"}
STATED = {"data.magnetometer": "m1,m2,m3", "sensor.magnetometer.unit": "µT"}


def log(folder: Path, names: str, every: int = 1) -> Path:
    """Write a log of nine axes at rest, with a new value of the field in `every` samples."""
    rng = np.random.default_rng(1)
    f = [0, 0, 9.81] + 0.01 * rng.standard_normal((N, 3))
    w = 0.001 * rng.standard_normal((N, 3))
    m = [20, 5, -40] + SIGMA * rng.standard_normal((N, 3))
    rows = np.column_stack([np.arange(N) / RATE, f, w, m[np.arange(N) // every * every]])
    path = folder / "log.csv"
    header = f"t,ax,ay,az,gx,gy,gz,{names}"
    np.savetxt(path, rows, delimiter=",", header=header, comments="", fmt="%.7g")
    return path


def analysed(path: Path, **stated: str) -> NoiseAnalysis:
    return analyse_noise(read_rest_recording(path, {**GYRO, **stated}), terms="N")


@pytest.mark.slow
@pytest.mark.parametrize("names", [evidence("mag_x_uT,mag_y_uT,mag_z_uT"), "m1,m2,m3"])
def test_columns_are_found_by_their_units_or_as_stated(names: str, tmp_path: Path):
    found = analysed(log(tmp_path, names), **(STATED if names == "m1,m2,m3" else {}))
    field = found.of("magnetometer")
    assert [one.channel[0] for one in field] == ["m"] * 3
    noise = sensor_noise(found)
    value, u = noise.triads["magnetometer"].values["N"]
    assert u is not None
    assert abs(value - WHITE) < 4 * u
    text = ros_text(noise)
    (line,) = (one for one in text.splitlines() if one.startswith("magnetic_field_covariance: "))
    stated = np.array(line.partition("[")[2].rstrip("]").split(","), dtype=float).reshape(3, 3)
    np.testing.assert_allclose(stated, (1e-6 * SIGMA) ** 2 * np.eye(3), atol=1e-14)


@pytest.mark.slow
def test_without_a_unit_or_with_repeated_values_they_are_left_out(tmp_path: Path):
    assert not analysed(log(tmp_path, "mx,my,mz")).of("magnetometer")
    assert not analysed(log(tmp_path, "mx_uT,my_uT,mz_uT", 5)).of("magnetometer")
    with refused(InputError, key="sensor.magnetometer.unit"):
        analysed(log(tmp_path, "m1,m2,m3"), **{"data.magnetometer": "m1,m2,m3"})
    with refused(InputError, key="data.magnetometer"):
        analysed(log(tmp_path, "m1,m2,m3", 5), **STATED)


@pytest.mark.slow
@pytest.mark.parametrize("every", [1, 5])
def test_those_of_a_run_file_are_analysed_if_no_value_is_repeated(every: int, tmp_path: Path):
    log(tmp_path, "mx,my,mz", every)
    path = tmp_path / "run.toml"
    path.write_text(
        '[sensor.accelerometer]\nunit = "m/s²"\n[sensor.magnetometer]\nunit = "µT"\n'
        '[bench]\ngravity = "9.81 m/s²"\n[data]\nfile = "log.csv"\ntime = "t"\n'
        'accelerometer = ["ax", "ay", "az"]\nmagnetometer = ["mx", "my", "mz"]\n'
        '[method]\nname = "multi_position"\n',
        encoding="utf-8",
    )
    ended = run_program("noise", path, "--terms", "N")
    assert ended.status == 0, ended.error
    assert ("mx" in ended.output) == (every == 1)


@pytest.mark.parametrize("field", [{}, {"field": "50 µT"}])
def test_counts_that_are_stated_as_microtesla_are_named(field: dict[str, Any], tmp_path: Path):
    """6500 counts are no field in any unit."""
    rng = np.random.default_rng(7)
    own = sim.device(rng, strength=6500e-6)
    with refused(InputError, key="[sensor.magnetometer] unit") as caught:
        calibrate(recording(tmp_path, sim.scattered(rng, 24), own, rng, **field))
    assert "LSB" in str(caught.value)
