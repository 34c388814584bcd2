"""The plan of six positions states the uncertainties of magnetometers that a calibration has."""

from pathlib import Path

import pytest
from tests.refusals import refused

from inercal.basics.errors import InputError
from inercal.pipeline import calibrate, simulate_files
from inercal.pipeline.design.worksheet import build_worksheet
from inercal.recordings.io.write import write_recordings
from inercal.runfile import read

SECONDS = 4.0
RUN = """\
[sensor]
name = "unit"
[sensor.accelerometer]
unit = "m/s²"
{force}
[sensor.magnetometer]
unit = "µT"
{field}
[bench]
gravity = "9.8126 m/s² ± 0.0005 m/s²"
tilt = "0.3°"
field = "49.4 µT ± 0.2 µT"
dip = "60° ± 1°"
[data]
file = "six.csv"
accelerometer = ["ax", "ay", "az"]
magnetometer = ["mx", "my", "mz"]
{data}
[method]
name = "six_position"
seconds = "4 s"
"""
RECORDED = {
    "force": 'white = "200 µg/√Hz"',
    "field": 'white = "50 nT/√Hz"',
    "data": 'rate = "20 Hz"\ntime = "time"',
}
MEANS = {
    "force": "",
    "field": "",
    "data": 'kind = "means"\nlabel = "label"\n'
    'sd = {accelerometer = "100 µg", magnetometer = "25 nT"}',  # of 4 s
}


def write(folder: Path, **parts: str) -> Path:
    path = folder / "run.toml"
    path.write_text(RUN.format(**parts), encoding="utf-8")
    return path


@pytest.mark.slow
def test_a_plan_states_the_uncertainties_that_a_calibration_of_it_has(tmp_path: Path):
    run = read(write(tmp_path, **RECORDED))
    expected = {one.name: one.std for one in build_worksheet(run).expected}
    write_recordings({run.file(name): made for name, made in simulate_files(run).items()})
    found = calibrate(run).calibration
    assert list(expected) == list(found.sensor.coefficients)
    for name in found.sensor.coefficients[-12:]:
        assert expected[name] == pytest.approx(found.uncertainty(name), rel=0.25), name
    means = build_worksheet(read(write(tmp_path, **MEANS))).expected
    assert {one.name: one.std for one in means} == pytest.approx(expected, rel=0.25)


def test_a_noise_that_is_missing_is_named(tmp_path: Path):
    run = read(write(tmp_path, **{**RECORDED, "field": ""}))
    with refused(InputError, key="[sensor.magnetometer] white"):
        build_worksheet(run)
