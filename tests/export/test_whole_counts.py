"""Betaflight and INAV: zeros and gains in whole counts, written, applied and read back."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from tests.export.calibrations import (
    OPTIONS,
    magnetometer_readings,
    make_calibration,
    make_magnetometer,
    random_readings,
)
from tests.export.test_formulas import LINEAR_TARGETS, settings, stated
from tests.refusals import refused

import inercal
from inercal.basics.arrays import Array
from inercal.calibration import Calibration
from inercal.export import export_calibration

ACC, GYRO, MAG = 9.80665 / 2048, np.radians(1 / 16.4), 0.15e-6  # sizes of a count, SI
PROGRAMS = ("betaflight", "inav")


def text_of(calibration: Calibration, to: str) -> str:
    return export_calibration(calibration, to, options=OPTIONS[to], source="x").text


@pytest.mark.parametrize("to", PROGRAMS)
def test_only_the_rounding_to_whole_counts_is_left(to: str):
    calibration = make_calibration("k0", "bias", *(("k1",) if to == "inav" else ()))
    seen = random_readings(calibration)
    error = np.abs(LINEAR_TARGETS[to](text_of(calibration, to), seen) - seen.corrected)
    gain = 0.5 / 4096 * np.abs(seen.corrected[:, :3]) if to == "inav" else 0.0
    assert np.all(error[:, :3] <= 1.01 * (ACC / 2 + gain))
    assert error[:, :3].max() > ACC / 20
    if to == "inav":
        assert error[:, 3:].max() <= 1.01 * GYRO / 2
    else:  # Betaflight has no settings for gyros.
        bias = max(abs(calibration.value(f"g{a}.bias")) for a in "xyz")
        assert error[:, 3:].max() == pytest.approx(bias)


def magnetic(to: str, text: str, raw: Array) -> Array:
    """Return the field in T from readings in counts."""
    one = settings(text)
    if to == "betaflight":
        return (raw - one["mag_calibration"]) * MAG
    zero, gain = (np.array([one[f"{name}_{a}"][0] for a in "xyz"])
                  for name in ("magzero", "maggain"))  # fmt: skip
    return (raw - zero) * 1024 / gain * MAG


@pytest.mark.parametrize("to", PROGRAMS)
def test_magnetometers_have_the_error_that_the_file_states(to: str):
    calibration = make_magnetometer()
    seen = magnetometer_readings(calibration)
    text = text_of(calibration, to)
    found = magnetic(to, text, calibration.sensor.to_si(seen.output) / MAG)
    error = np.abs(found - seen.corrected).max()
    limit = stated(text, "magnetic flux density")
    assert 0.5 * limit <= error <= 1.2 * limit
    # What is left out is the misalignment, and for Betaflight also the scale.
    assert error == pytest.approx(5.5e-6, rel=0.4)


def test_a_number_that_a_setting_does_not_take_is_refused():
    calibration = make_calibration("k0", "k1", "bias")
    names = calibration.sensor.coefficients

    def changed(name: str, value: float) -> Calibration:
        values = calibration.values.copy()
        values[names.index(name)] = value
        return replace(calibration, values=values)

    for to, name, value, setting in (
        ("betaflight", "ay.k0", 16 * 9.81, "acc_calibration"),
        ("inav", "ay.k0", 16 * 9.81, "acczero"),
        ("inav", "gz.bias", 40.0, "gyro_zero"),
    ):
        with refused(names=(setting,)):
            text_of(changed(name, value), to)


def test_the_size_of_a_count_must_be_stated():
    for to, name in (("betaflight", "acc_1g"), ("inav", "acc_1g"), ("inav", "gyro_lsb")):
        options = {key: value for key, value in OPTIONS[to].items() if key != name}
        with refused(key="--set", names=(name,)):
            export_calibration(make_calibration(), to, options=options)
        with refused(key="--set", names=(name,)):
            export_calibration(make_calibration(), to, options=options | {name: 0.0})
    calibration = make_calibration()
    sensor = calibration.sensor.select_axes("w")
    rows = [calibration.sensor.coefficients.index(name) for name in sensor.coefficients]
    gyros = replace(
        calibration,
        sensor=sensor,
        values=calibration.values[rows],
        covariance=calibration.covariance[np.ix_(rows, rows)],
    )
    with refused(names=sensor.channels):
        text_of(gyros, "betaflight")


@pytest.mark.parametrize("to", PROGRAMS)
def test_an_export_is_read_back_to_half_a_count(to: str, tmp_path: Path):
    calibration = make_magnetometer(inertial=True)
    path = tmp_path / "diff.txt"
    path.write_text(text_of(calibration, to), encoding="utf-8")
    field = {"field": "153.6 uT"} if to == "inav" else {}  # 1024 counts
    found = inercal.import_calibration(path, to, like=calibration, options={**OPTIONS[to], **field})
    halves = {"a.k0": ACC / 2, "m.bias": MAG / 2}
    if to == "inav":
        halves |= {"a.k1": 0.51 / 4096, "g.bias": GYRO / 2, "m.scale": 0.5 / 1024}
    names = {f"{one[0]}{axis}{one[1:]}" for one in halves for axis in "xyz"}
    assert set(found.sensor.coefficients) == names
    for name in names:
        half = halves[name[0] + name[2:]]
        assert abs(found.value(name) - calibration.value(name)) <= 1.001 * half
    assert not found.states_uncertainty


def test_a_diff_of_inav_states_only_what_differs_from_the_defaults(tmp_path: Path):
    path = tmp_path / "diff.txt"
    path.write_text(
        "# diff\nset acczero_y = -100\nset accgain_z = 4000\nset gyro_zero_x = 10\n"
        "set magzero_x = 30\nset maggain_x = 512\nset maggain_y = 512\nset maggain_z = 480\n",
        encoding="utf-8",
    )
    found = inercal.import_calibration(path, "inav", options={"acc_1g": 2048})
    assert {name[0] for name in found.sensor.coefficients} == {"a"}
    assert found.value("ay.k0") == pytest.approx(-100 * ACC)
    assert (found.value("ax.k0"), found.value("ax.k1")) == (0, 0)
    assert found.value("az.k1") == pytest.approx(0.024)
    assert sum("left out" in note for note in found.notes) == 2
    options = {"mag_lsb": "0.1 uT", "gyro_lsb": "0.061 deg/s"}
    found = inercal.import_calibration(path, "inav", options=options)
    # Without the field at its calibration, maggain states no scale factor.
    assert "mx.scale" not in found.sensor.coefficients
    assert found.value("mx.bias") == pytest.approx(3e-6)
    assert any("init_gyro_cal" in note for note in found.notes)
    found = inercal.import_calibration(path, "inav", options=options | {"field": "50 uT"})
    assert found.value("mx.scale") == pytest.approx(0.024)
    assert found.value("mz.scale") == pytest.approx(-0.04)
    with refused(key="--set", file="diff.txt"):
        inercal.import_calibration(path, "inav")
