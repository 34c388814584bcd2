"""Outputs with a scale factor: volts, amperes, hertz and counts, also in mV or kHz."""

from pathlib import Path

import pytest
from tests.host.guided_runs import lines, measure, readings, six_positions
from tests.refusals import refused

from inercal.basics.errors import InputError
from inercal.physics.sensors import G0
from inercal.pipeline import calibrate
from inercal.runfile import read


def sensor_of(tmp_path: Path, unit: str, scale: str, sd: str = "20 µg") -> Path:
    return six_positions(
        tmp_path,
        ('unit = "V"', f'unit = "{unit}"'),
        ('scale = "2 V/g"', f'scale = "{scale}"'),
        ('accelerometer = "20 µg"', f'accelerometer = "{sd}"'),
    )


@pytest.mark.parametrize(
    ("unit", "scale", "per_g"),
    [
        ("V", "2 V/g", 2.0),
        ("mV", "2 V/g", 2000.0),
        ("mV", "2000 mV/g", 2000.0),
        ("mA", "1.3 mA/g", 1.3),
        ("Hz", "70 Hz/g", 70.0),
        ("kHz", "70 Hz/g", 0.07),
    ],
)
def test_the_scale_is_in_units_of_the_output(tmp_path: Path, unit: str, scale: str, per_g: float):
    (readout, *_) = [axis.readout for axis in read(sensor_of(tmp_path, unit, scale)).sensor.axes]
    assert readout.scale == pytest.approx(per_g / G0, rel=1e-12)
    assert readout.full_scale == pytest.approx(5 * per_g, rel=1e-12)


@pytest.mark.parametrize(
    ("unit", "scale", "sd"), [("mV", "2 V/g", "0.04 mV"), ("kHz", "70 Hz/g", "1.4 mHz")]
)
def test_readings_in_a_multiple_of_a_unit_are_calibrated(
    tmp_path: Path, unit: str, scale: str, sd: str
):
    path = sensor_of(tmp_path, unit, scale, sd)
    assert measure(path, given=lines(readings(path))).status == 0
    outcome = calibrate(path)
    calibration, truth = outcome.calibration, read(path).truth
    assert outcome.verdict.grade == "consistent"
    for name, value in zip(calibration.sensor.coefficients, calibration.values, strict=True):
        assert abs(value - truth.get(name, 0.0)) < 4 * calibration.uncertainty(name)


def test_a_scale_of_another_output_is_refused(tmp_path: Path):
    with refused(InputError, key="[sensor.accelerometer] scale"):
        read(sensor_of(tmp_path, "Hz", "2 V/g"))
