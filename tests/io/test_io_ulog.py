"""ULog: topics of PX4 as columns, corrections undone, damage and bombs refused."""

import struct
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.io.log_files import (
    BOOT_NS,
    DEVICE,
    FORMATS,
    PX4,
    SAMPLES,
    Samples,
    message,
    px4_corrected,
    ulog_bytes,
)
from tests.refusals import refused

from inercal.recordings.io.read import Columns, read_recording, read_table

core: Any = pytest.importorskip("pyulog.core", reason="ULog files need the extra inercal[px4]")
ACC = tuple(f"sensor_combined.accelerometer_m_s2[{k}]" for k in range(3))
GYR = tuple(f"sensor_combined.gyro_rad[{k}]" for k in range(3))
RAW = (*(f"sensor_accel.{k}" for k in "xyz"), *(f"sensor_gyro.{k}" for k in "xyz"))
FLOAT32 = 3e-6  # m/s², a step at 20 m/s²


def wanted(names: tuple[str, ...], **options: object) -> Columns:
    units = ("m/s²",) * 3 + ("rad/s",) * 3
    axes = ("ax", "ay", "az", "gx", "gy", "gz")
    return Columns(
        tuple(zip(axes, names, units, strict=True)),
        time="time",
        temperature="sensor_accel.temperature",
        options=options,
    )


def written(folder: Path, samples: Samples = SAMPLES, **changes: Any) -> Path:
    """Write a log as pyulog writes it."""
    (folder / "built.ulg").write_bytes(ulog_bytes(samples, **changes))
    path = folder / "log.ulg"
    core.ULog(str(folder / "built.ulg")).write_ulog(str(path))
    return path


def test_raw_topics_are_read_bit_for_bit_and_joined_by_time(tmp_path: Path):
    found = read_recording(written(tmp_path), wanted(RAW))
    assert found.data[:, :3].tobytes() == SAMPLES.acc.astype(float).tobytes()
    assert found.data[:, 3:].tobytes() == SAMPLES.gyr.astype(float).tobytes()
    np.testing.assert_allclose(found.time, SAMPLES.time, atol=1e-12)
    assert found.temperature is not None
    np.testing.assert_allclose(found.temperature - 273.15, SAMPLES.temperature, atol=1e-4)
    assert found.kept_corrections == ""
    assert found.devices == f"sensor_accel {DEVICE}, sensor_gyro {DEVICE}"


def test_what_px4_corrected_is_what_the_sensors_read_once_undone(tmp_path: Path):
    path = written(tmp_path)
    undone = read_recording(path, wanted((*ACC, *GYR)))
    np.testing.assert_allclose(undone.data[:, :3], SAMPLES.acc, atol=FLOAT32)
    np.testing.assert_allclose(undone.data[:, 3:], SAMPLES.gyr, atol=FLOAT32)
    assert undone.kept_corrections == ""
    assert undone.devices == f"accel_device_id {DEVICE}, gyro_device_id {DEVICE}"
    kept = read_recording(path, wanted((*ACC, *GYR), corrections="keep"))
    acc, gyr = px4_corrected(SAMPLES)
    np.testing.assert_allclose(kept.data, np.hstack([acc, gyr]), atol=FLOAT32)
    for name in set(PX4) - {"CAL_ACC0_ID", "CAL_GYRO0_ID"}:
        assert name in kept.kept_corrections


def test_the_sample_of_pyulog_is_turned_back_to_its_raw_topic(data_dir: Path):
    path = data_dir / "logs" / "px4_sample_log_small.ulg"
    corrected = read_table(path, [*ACC, *GYR], options={"corrections": "keep"})
    undone = read_table(path, [*ACC, *GYR])
    raw = read_table(path, RAW)
    for name, column, sd in zip(RAW, (*ACC, *GYR), (0.04,) * 3 + (0.003,) * 3, strict=True):
        few = raw.numbers(name)
        off = undone.numbers(column).mean() - few.mean()
        assert abs(off) < 3 * sd / np.sqrt(few.size), name
        if name in ("sensor_accel.x", "sensor_gyro.x", "sensor_gyro.z"):
            assert abs(corrected.numbers(column).mean() - few.mean()) > 5 * abs(off)


def test_a_sensor_that_px4_never_calibrated_is_only_turned_back(tmp_path: Path):
    other = {name: 7 if name.endswith("_ID") else value for name, value in PX4.items()}
    table = read_table(written(tmp_path, parameters=other), ACC)
    acc, _ = px4_corrected(SAMPLES)
    readings = np.stack([table.numbers(name) for name in ACC], -1)
    np.testing.assert_allclose(
        np.linalg.norm(readings, axis=1), np.linalg.norm(acc, axis=1), atol=FLOAT32
    )


def changed(name: str, value: float) -> bytes:
    key = f"float {name}".encode()
    return message("P", bytes([len(key)]) + key + struct.pack("<f", value))


@pytest.mark.parametrize(
    ("changes", "names"),
    [
        ({"parameters": PX4 | {"TC_A_ENABLE": 1}}, ("TC_A_ENABLE",)),
        ({"parameters": PX4 | {"SENS_BOARD_ROT": 99}}, ("SENS_BOARD_ROT",)),
        ({"after": changed("CAL_ACC0_XOFF", 0.5)}, ("CAL_ACC0_XOFF",)),
        (
            {"topics": ("sensor_combined",), "parameters": PX4 | {"CAL_ACC1_ID": 5}},
            ("sensor_combined",),
        ),
    ],
)
def test_corrections_that_cannot_be_undone_are_refused(
    tmp_path: Path, changes: dict[str, Any], names: tuple[str, ...]
):
    path = tmp_path / "log.ulg"
    path.write_bytes(ulog_bytes(SAMPLES, **changes))
    with refused(file=path, names=names):
        read_table(path, ACC)


def test_filtered_topics_are_read_only_if_they_are_kept(tmp_path: Path):
    raw = ulog_bytes(SAMPLES, topics=("sensor_accel",)).replace(
        b"sensor_accel", b"vehicle_acceleration"
    )
    path = tmp_path / "log.ulg"
    path.write_bytes(lengthened(raw))
    with refused(key="[data] corrections"):
        read_table(path, ["vehicle_acceleration.x"])
    found = read_table(path, ["vehicle_acceleration.x"], options={"corrections": "keep"})
    assert "vehicle_acceleration" in found.kept_corrections


def lengthened(raw: bytes) -> bytes:
    """Return a log in which a name grew by 8 letters, with the sizes of its messages set right."""
    out, at = bytearray(raw[:16]), 16
    while at < len(raw):
        size, kind = struct.unpack_from("<HB", raw, at)
        grown = size + 8 if kind in b"FA" else size
        out += struct.pack("<HB", grown, kind) + raw[at + 3 : at + 3 + grown]
        at += 3 + grown
    return bytes(out)


def test_readings_of_two_sensors_in_one_topic_are_refused(tmp_path: Path):
    path = tmp_path / "log.ulg"
    raw = ulog_bytes(SAMPLES, topics=("sensor_accel",))
    at = raw.rindex(struct.pack("<I", DEVICE))
    path.write_bytes(raw[:at] + struct.pack("<I", 77) + raw[at + 4 :])
    with refused(names=("sensor_accel",)):
        read_table(path, ["sensor_accel.x"])


def test_raw_topics_of_px4_before_1_11_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    old = FORMATS["sensor_accel"].replace("float y;", "float x_raw;")
    monkeypatch.setitem(FORMATS, "sensor_accel", old)
    path = tmp_path / "log.ulg"
    path.write_bytes(ulog_bytes(SAMPLES))
    with refused(names=("sensor_accel",)):
        read_table(path, ["sensor_accel.x"])


@pytest.mark.parametrize(
    ("names", "options", "data"),
    [
        (("sensor_acel.x",), {}, {"names": ("sensor_acel.x",)}),
        (("sensor_accel.w",), {}, {"names": ("sensor_accel.w",)}),
        (("sensor_accel.x",), {"corrections": "none"}, {"key": "[data] corrections"}),
        (("sensor_accel.x",), {"most_values": 100}, {"key": "[data] most_values"}),
    ],
)
def test_a_wrong_column_or_option_is_refused(
    tmp_path: Path, names: tuple[str, ...], options: dict[str, object], data: dict[str, Any]
):
    path = tmp_path / "log.ulg"
    path.write_bytes(ulog_bytes(SAMPLES))
    with refused(file=path, **data):
        read_table(path, names, options=options)


def test_a_log_that_ends_within_a_message_has_the_samples_before(tmp_path: Path):
    path = tmp_path / "log.ulg"
    path.write_bytes(ulog_bytes(SAMPLES)[:-10])
    assert read_table(path, ["sensor_accel.x"]).numbers("sensor_accel.x").size == len(SAMPLES.ns)
    assert read_table(path, ACC).numbers(ACC[0]).size == len(SAMPLES.ns) - 1


GOOD = ulog_bytes(SAMPLES)
HEADED = GOOD[: 16 + 43]
DAMAGED: dict[str, bytes] = {
    "header": GOOD[:12],
    "other magic": b"ULog\x01\x12\x36" + GOOD[7:],
    "zeros": GOOD[:3000] + bytes(50) + GOOD[3050:],
    "shifted": GOOD[:3000] + GOOD[3001:],
    "format without fields": HEADED + message("F", b"sensor_accel") + GOOD[59:],
    "topic without format": HEADED + message("A", b"\0\0\0sensor_accel"),
    "format in itself": HEADED
    + message("F", b"sensor_accel:sensor_accel x;")
    + message("A", b"\0\0\0sensor_accel"),
    "too many numbers": HEADED
    + message("F", b"sensor_accel:double[2000000000] x;")
    + message("A", b"\0\0\0sensor_accel"),
    "too many nested": HEADED
    + message("F", b"a:b[1000] x;")
    + message("F", b"b:c[1000] x;")
    + message("F", b"c:double[1000] x;")
    + message("A", b"\0\0\0a"),
    "too many topics": GOOD[: GOOD.index(b"\0\0\0sensor_accel") - 3]
    + b"".join(message("A", struct.pack("<BH", 0, k) + b"sensor_accel") for k in range(2000)),
    "appended outside": GOOD[:27] + b"\1" + GOOD[28:35] + struct.pack("<Q", 1 << 40) + GOOD[43:],
}


@pytest.mark.parametrize("name", DAMAGED)
def test_a_damaged_log_is_one_line(tmp_path: Path, name: str, capsys: pytest.CaptureFixture[str]):
    path = tmp_path / "log.ulg"
    path.write_bytes(DAMAGED[name])
    with refused(file=path) as caught:
        read_table(path, ["sensor_accel.x"])
    assert str(caught.value).startswith("log.ulg")
    assert len(str(caught.value)) < 250
    assert capsys.readouterr() == ("", "")


def test_a_missing_library_is_named_before_any_work(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    path = tmp_path / "log.ulg"
    path.write_bytes(GOOD)
    monkeypatch.setitem(sys.modules, "pyulog", None)
    monkeypatch.setitem(sys.modules, "pyulog.core", None)
    with refused() as caught:
        read_table(path, ["sensor_accel.x"])
    assert "inercal[px4]" in str(caught.value)


def test_gyros_that_were_logged_at_another_time_are_refused(tmp_path: Path):
    path = tmp_path / "log.ulg"
    formats = message("F", f"sensor_gyro:{FORMATS['sensor_gyro']}".encode())
    accelerometers = ulog_bytes(SAMPLES, topics=("sensor_accel",))
    gyro = message("A", struct.pack("<BH", 0, 9) + b"sensor_gyro")
    us = BOOT_NS // 1000 + 10**9
    gyro += b"".join(
        message("D", struct.pack("<HQQI4f", 9, us + k, us + k, DEVICE, *[0.1 * k] * 4))
        for k in range(5)
    )
    path.write_bytes(accelerometers[:59] + formats + accelerometers[59:] + gyro)
    with refused(names=("sensor_accel", "sensor_gyro")):
        read_table(path, ["sensor_accel.x", "sensor_gyro.x"])
