"""Drafts of logs in which the accelerometers, the gyros and a magnetometer have own clocks."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.io
from tests import generated_logs as logs
from tests.base_seeds import evidence
from tests.drafts.test_kinds_of_logs import BIASES, assert_true, calibrated, chosen, drafted
from tests.refusals import refused

from inercal.basics.errors import InputError
from inercal.pipeline.drafts.clock_keys import clock_keys
from inercal.pipeline.drafts.column_roles import ColumnRoles
from inercal.pipeline.drafts.long_rest_recording import open_long_rest_recording
from inercal.pipeline.drafts.rest_recording import read_rest_recording
from inercal.recordings.io.column_table import Table
from inercal.recordings.samples import mean_step

GYRO_BIASES = {
    f"g{axis}.bias": np.radians(b) for axis, b in zip("xyz", (1.5, -0.8, 0.6), strict=True)
}
LATE = 5e-3  # s, so that no sample of one clock is one of the other


def both(step: float = 0.0103) -> tuple[dict[str, np.ndarray], np.ndarray, np.ndarray]:
    """Return a recording, and times and readings, rad/s, of gyros with another clock."""
    log = logs.by_hand(11, rests=16)
    at = np.arange(3e-3, log["t"][-1], step)
    rate = np.stack([np.interp(at, log["t"] + LATE, np.radians(w)) for w in log["w"].T], axis=1)
    return log, at, rate


def field(at: np.ndarray) -> np.ndarray:
    return np.stack([30 * np.cos(at / 9), 30 * np.sin(at / 9), np.full(at.size, 40.0)], axis=1)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("form", "step"),
    [
        evidence("matrices", 0.0103),
        ("structs", 0.0052),
        evidence("matrices", 0.0052),
        evidence("structs", 0.0103),
    ],
)
def test_arrays_of_a_mat_file_with_own_clocks_are_paired(form: str, step: float, tmp_path: Path):
    log, at, rate = both(step)
    slow = np.arange(0.0, log["t"][-1], 0.05)
    time, force = log["t"] + LATE, log["f"] * logs.G
    content: dict[str, Any] = {"acc": force, "t_acc": time, "gyr": rate, "t_gyr": at}
    content |= {"mag": field(slow), "t_mag": slow, "settings": np.arange(9.0).reshape(3, 3)}
    if form == "structs":
        axes = {"Acceleration": (time, force), "AngularVelocity": (at, rate)}
        axes["MagneticField"] = (slow, field(slow))
        content = {
            name: {"Timestamp": t, **dict(zip("XYZ", data.T, strict=True))}
            for name, (t, data) in axes.items()
        }
    scipy.io.savemat(tmp_path / "phone.mat", content)
    draft = drafted([tmp_path / "phone.mat"], tmp_path, sensor__gyro__unit="rad/s")
    keys = chosen(draft)
    assert "data.gyro_file" not in keys
    assert (
        keys["data.gyro_time"]
        == {"matrices": "t_gyr", "structs": "AngularVelocity.Timestamp"}[form]
    )
    assert_true(calibrated(draft), BIASES | GYRO_BIASES, k=4)


@pytest.mark.slow
def test_arrays_of_unequal_length_without_clocks_are_named(tmp_path: Path):
    log, _, rate = both()
    scipy.io.savemat(tmp_path / "log.mat", {"acc": log["f"], "gyr": rate})
    draft = drafted([tmp_path / "log.mat"], tmp_path, data__rate="100 Hz")
    (told,) = (fact for fact in draft.facts if "gyr(1)" in fact)
    assert str(len(rate)) in told
    assert str(len(log["f"])) in told
    assert "data.gyro" not in chosen(draft)
    assert_true(calibrated(draft), BIASES)


@pytest.mark.slow
@pytest.mark.parametrize("names", [evidence("phone"), "columns"])
def test_a_magnetometer_in_a_third_file_is_left_out(names: str, tmp_path: Path):
    log, at, rate = both()
    slow = np.arange(0.0, log["t"][-1], 0.05)
    heads = {"phone": "{}", "columns": "Magnetic field {} (µT)"}
    files = [
        logs.write(tmp_path / f"{name}.csv", ("time", *map(head.format, "xyz")), [t, *data.T])
        for name, head, t, data in (
            ("Accelerometer", "{}", log["t"] + LATE, log["f"]),
            ("Gyroscope", "{}", at, rate),
            ("Magnetometer" if names == "phone" else "third", heads[names], slow, field(slow)),
        )
    ]
    draft = drafted(files[::-1], tmp_path, sensor__gyro__unit="rad/s")
    assert any(files[2].name in fact for fact in draft.facts)
    keys = chosen(draft)
    assert (keys["data.file"], keys["data.gyro_file"]) == ("Accelerometer.csv", "Gyroscope.csv")
    assert_true(calibrated(draft), BIASES | GYRO_BIASES, k=4)


@pytest.mark.slow
@pytest.mark.parametrize("zone", [evidence(""), evidence("Z"), "+02:00"])
def test_dates_of_two_files_are_paired(zone: str, tmp_path: Path):
    log, at, rate = both()

    def dates(seconds: np.ndarray) -> list[str]:
        ns = np.datetime64("2026-11-23T03:10:09", "ns") + np.rint(seconds * 1e9).astype("m8[ns]")
        return [f"{one}{zone}" for one in ns]

    files = [
        logs.write(tmp_path / f"{name}.csv", ("time", *axes), [dates(t), *data.T])
        for name, axes, t, data in (
            ("acc", ("ax", "ay", "az"), log["t"] + LATE, log["f"]),
            ("gyr", ("gx", "gy", "gz"), at, rate),
        )
    ]
    draft = drafted(files, tmp_path, sensor__gyro__unit="rad/s")
    assert chosen(draft)["data.gyro_time"] == "time"
    assert_true(calibrated(draft), BIASES | GYRO_BIASES, k=4)


def test_rounded_stamps_state_the_mean_rate():
    stamps = np.array(np.floor(np.arange(2000) * 1000 / 104.3), dtype=np.float64)
    stamps[1500:] += 5000.0  # an interruption
    assert 1000 / mean_step(stamps) == pytest.approx(104.3, rel=1e-3)
    table = Table(("ms", "ax"), {"ms": stamps, "ax": stamps}, "log.csv", "", 2, header=True)
    entries = clock_keys(table, ColumnRoles({}, {"time": "ms"}), {})[1]
    assert "104.3 Hz" in {one.key: one.reason for one in entries}["time_unit"]
    exact = np.array(np.arange(2000) * 10.0, dtype=np.float64)
    assert mean_step(exact) == 10.0


@pytest.mark.parametrize("name", ["t_ms", "tick", "date"])
@pytest.mark.parametrize("stated", [{}, {"data.time": "given"}])
def test_a_rate_that_contradicts_the_times_is_refused(name: str, stated: dict[str, str]):
    stamps = np.arange(1000) * 10.0
    column: Any = stamps
    if name == "date":
        since = np.datetime64("2026-11-23T03:10:09") + stamps.astype("m8[ms]")
        column = np.array([str(one) for one in since], dtype=np.str_)
    table = Table((name,), {name: column}, "log.csv", "", 2, header=True)
    roles = ColumnRoles({}, {"time": name}, units={"time": "ms"} if name == "t_ms" else {})
    with pytest.raises(InputError) as caught:
        clock_keys(table, roles, {"data.rate": "55 Hz", "data.time_unit": "ms"} | stated)
    assert caught.value.key == "[data] rate"
    keys = {one.key: one.value for one in clock_keys(table, roles, {"data.rate": "110 Hz"})[1]}
    assert keys["time"] == name
    if name == "tick" and not stated:  # its unit is unknown
        only = clock_keys(table, roles, {"data.rate": "55 Hz"})[1]
        assert [one.key for one in only] == ["rate"]


def test_times_that_run_backwards_are_refused(tmp_path: Path):
    time = 0.02 * np.arange(3000)[::-1]
    force = np.random.default_rng(0).normal([0, 0, 9.8], 0.01, (3000, 3))
    path = tmp_path / "a.csv"
    np.savetxt(
        path, np.column_stack([time, force]), "%.5f", ",", header="t_s,ax,ay,az", comments=""
    )
    for stated in ({}, {"data.rate": "50 Hz"}):
        with refused(InputError, key="data.time", names=("t_s",)):
            read_rest_recording(path, stated)


def test_an_unknown_key_is_refused_before_the_log_is_read(tmp_path: Path):
    missing = tmp_path / "missing.csv"
    for read in (read_rest_recording, open_long_rest_recording):
        with refused(InputError, key="sensor.name"):
            read(missing, {"sensor.name": "SN 7"})
