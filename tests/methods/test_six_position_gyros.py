"""Gyros read at the six rests: their biases and their sensitivity to gravity."""

from pathlib import Path

import numpy as np
import pytest
from scipy import stats
from tests.base_seeds import SEEDS

from inercal.calibration import Calibration
from inercal.io.write import write_recording
from inercal.pipeline import calibrate, simulate
from inercal.pipeline.run_simulation import apply_data_columns
from inercal.runfile import Run, read

RUN = """
[sensor]
name = "imu"
[sensor.accelerometer]
unit = "m/s²"
white = "100 µg/√Hz"
[sensor.gyro]
unit = "°/s"
white = "0.01 °/s/√Hz"
[sensor.truth]
"gx.bias" = "0.3 °/s"
"gy.bias" = "-0.2 °/s"
"gz.g_o" = "30 °/h/g"
"ax.k0" = "10 mg"
[bench]
latitude = "48 ° ± 0.01 °"
tilt = "0.2 °"
[data]
file = "six.npz"
time = "time"
rate = "20 Hz"
label = "label"
marks = "labels"
[method]
name = "six_position"
seconds = "20 s"
"""


def prepare(folder: Path, more: str = "") -> Run:
    path = folder / "run.toml"
    path.write_text(RUN + more, encoding="utf-8")
    return read(path)


def calibrated(run: Run, seed: int) -> Calibration:
    recording = apply_data_columns(run, simulate(run, seed))
    write_recording(recording, run.file(run.data.file))
    return calibrate(run).calibration


def normalised_squares(run: Run, seeds: range) -> np.ndarray:
    """Return the squared errors over their variances of each gyro coefficient, (seeds, p)."""
    rows: list[list[float]] = []
    for seed in seeds:
        found = calibrated(run, seed)
        names = [name for name in found.sensor.coefficients if name.startswith("g")]
        rows.append(
            [((found.value(n) - run.truth.get(n, 0.0)) / found.uncertainty(n)) ** 2 for n in names]
        )
    return np.array(rows)


def test_gyro_biases_are_found_and_no_scale_factor(tmp_path: Path):
    run = prepare(tmp_path)
    found = calibrated(run, 3)
    gyros = [name for name in found.sensor.coefficients if name.startswith("g")]
    assert gyros == ["gx.bias", "gy.bias", "gz.bias"]
    for name in gyros:
        error = found.value(name) - run.truth.get(name, 0.0)
        assert abs(error) < 4 * found.uncertainty(name)
    # White noise of six means, and the earth's rate whose level part has an unknown azimuth.
    noise = np.deg2rad(0.01) / np.sqrt(120)
    assert noise < found.uncertainty("gx.bias") < 3 * noise


def test_gyros_add_a_little_to_what_accelerometers_show_and_take_nothing(tmp_path: Path):
    run = prepare(tmp_path)
    whole = calibrated(run, 5)
    path = tmp_path / "alone.toml"
    section = RUN[RUN.index("[sensor.gyro]") : RUN.index("[sensor.truth]")]
    truth = '"gx.bias" = "0.3 °/s"\n"gy.bias" = "-0.2 °/s"\n"gz.g_o" = "30 °/h/g"\n'
    path.write_text(RUN.replace(section, "").replace(truth, ""), encoding="utf-8")
    alone = calibrate(path).calibration
    for name in alone.sensor.coefficients:
        # Of an estimate and a better one the difference has the difference of the variances.
        gained = alone.uncertainty(name) ** 2 - whole.uncertainty(name) ** 2
        assert 0 <= gained < 0.02 * alone.uncertainty(name) ** 2
        assert (whole.value(name) - alone.value(name)) ** 2 < 16 * gained


@pytest.mark.slow
@pytest.mark.parametrize("seed", SEEDS)
def test_gyro_errors_are_as_stated(seed: int, tmp_path: Path):
    run = prepare(tmp_path, 'also = ["g"]\n')
    squares = normalised_squares(run, range(1000 * seed, 1000 * seed + 60))
    for one in squares.T:
        low, high = stats.chi2.ppf([5e-4 / 12, 1 - 5e-4 / 12], len(one)) / len(one)
        assert low < one.mean() < high
