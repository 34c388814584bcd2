"""Bags of ROS 1 and 2 and MCAP: topics as columns; damaged files and bombs are refused."""

import bz2
import sqlite3
import struct
import sys
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.base_seeds import chosen, evidence
from tests.io.log_files import SAMPLES
from tests.io.test_io_bombs import cost
from tests.refusals import refused

pytest.importorskip("rosbags", reason="ROS bags need the extra inercal[ros]")
from tests.io.ros_files import (
    ACCEL,
    CELSIUS,
    GYRO,
    RAW,
    TEXT,
    messages,
    write_bag,
    write_bag2,
    write_split_bag,
)

from inercal.recordings.io.read import Columns, read_recording, read_table

X = f"{RAW}.linear_acceleration.x"
MADE: dict[str, tuple[Callable[..., Path], str]] = {
    "plain.bag": (write_bag, ""),
    "bz2.bag": (write_bag, "BZ2"),
    "lz4.bag": (write_bag, "LZ4"),
    "plain.db3": (write_bag2, ""),
    "messages.db3": (write_bag2, "MESSAGE"),
    "plain.mcap": (write_bag2, ""),
    "chunks.mcap": (write_bag2, "STORAGE"),
}


@pytest.fixture(scope="module")
def bags(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    folder = tmp_path_factory.mktemp("bags")
    return {
        name: write(folder / name, messages(SAMPLES, name.endswith(".bag")), compression)
        for name, (write, compression) in MADE.items()
    }


def columns(accel: str, gyro: str, **options: object) -> Columns:
    names = [f"{accel}.linear_acceleration.{k}" for k in "xyz"]
    names += [f"{gyro}.angular_velocity.{k}" for k in "xyz"]
    axes = ("ax", "ay", "az", "gx", "gy", "gz")
    units = ("m/s²",) * 3 + ("rad/s",) * 3
    return Columns(
        tuple(zip(axes, names, units, strict=True)),
        time="time",
        temperature=f"{CELSIUS}.temperature",
        options=options,
    )


@pytest.mark.parametrize("name", MADE)
@pytest.mark.parametrize(("accel", "gyro"), [evidence(RAW, RAW), (ACCEL, GYRO)])
def test_readings_are_read_bit_for_bit_from_one_topic_or_two(
    bags: dict[str, Path], name: str, accel: str, gyro: str
):
    found = read_recording(bags[name], columns(accel, gyro))
    assert found.data[:, :3].tobytes() == SAMPLES.acc.astype(float).tobytes()
    assert found.data[:, 3:].tobytes() == SAMPLES.gyr.astype(float).tobytes()
    np.testing.assert_allclose(found.time, SAMPLES.time, atol=1e-12)
    assert found.temperature is not None
    np.testing.assert_allclose(found.temperature - 273.15, SAMPLES.temperature, atol=0.095)


@pytest.mark.slow
@pytest.mark.parametrize("suffix", [evidence(".mcap"), ".db3"])
def test_a_split_bag_is_read_like_a_single_file(bags: dict[str, Path], suffix: str, tmp_path: Path):
    sent = list(messages(SAMPLES, first=False))
    listed, other = (
        write_split_bag(tmp_path / name, some, suffix, 3)
        for name, some in (("bag", sent), ("other", sent[: len(sent) // 2]))
    )
    listed = listed.parent.rename(tmp_path / "a bag, #1") / listed.name
    whole = read_recording(bags[f"plain{suffix}"], columns(ACCEL, GYRO))
    found = read_recording(listed, columns(ACCEL, GYRO))
    assert found.data.tobytes() == whole.data.tobytes()
    assert found.time.tobytes() == whole.time.tobytes()
    assert len({one.sha256 for one in (found, read_recording(other, columns(ACCEL, GYRO)))}) == 2
    part = next(listed.parent.glob("*_2.*"))
    part.unlink()
    with refused(file=listed, names=(part.name,)):
        read_recording(listed, columns(ACCEL, GYRO))
    listed.write_text("rosbag2_bagfile_information:\n  version: 5\n")
    with refused(file=listed):
        read_recording(listed, columns(ACCEL, GYRO))


def test_times_of_recording_are_taken_on_wish(bags: dict[str, Path]):
    found = read_table(bags["plain.mcap"], ["time", X], options={"stamp": "received"})
    late = 1e-6 * np.arange(len(SAMPLES.ns))
    np.testing.assert_allclose(found.numbers("time"), SAMPLES.time + late, atol=1e-9)


def test_a_bag_is_recognised_whatever_its_name(bags: dict[str, Path], tmp_path: Path):
    for name in ("plain.bag", "plain.db3", "plain.mcap"):
        path = tmp_path / f"100% {name}#1?.log"
        path.write_bytes(bags[name].read_bytes())
        assert read_table(path, [X]).numbers(X).size == len(SAMPLES.ns)


@pytest.mark.parametrize(
    ("name", "options", "data"),
    [
        (
            "/imu/dat_raw.linear_acceleration.x",
            {},
            {"names": ("/imu/dat_raw.linear_acceleration.x",)},
        ),
        (f"{RAW}.linear_acceleration.w", {}, {"names": (f"{RAW}.linear_acceleration.w",)}),
        (f"{TEXT}.data", {}, {"names": (TEXT,)}),
        (f"{GYRO}.linear_acceleration.x", {}, {"names": (GYRO,)}),
        (X, {"stamp": "log"}, {"key": "[data] stamp"}),
        (X, {"most_values": 100}, {"key": "[data] most_values"}),
        (X, {"corrections": "keep"}, {"key": "[data] corrections"}),
    ],
)
@pytest.mark.parametrize("bag", ["plain.bag", "plain.db3", "plain.mcap"])
def test_a_wrong_column_or_option_is_refused(
    bags: dict[str, Path], bag: str, name: str, options: dict[str, object], data: dict[str, Any]
):
    with refused(**data):
        read_table(bags[bag], [name], options=options)


@pytest.mark.parametrize("name", ["plain.bag", "plain.mcap"])
def test_readings_that_a_topic_does_not_measure_are_left_out_of_all_columns(
    bags: dict[str, Path], name: str
):
    names = read_table(bags[name]).names
    assert {f"{ACCEL}.linear_acceleration.x", f"{GYRO}.angular_velocity.x", X} <= {*names}
    assert not any(one.startswith((f"{ACCEL}.angular", f"{GYRO}.linear")) for one in names)


def test_headers_without_time_are_refused(tmp_path: Path):
    path = write_bag2(tmp_path / "a.mcap", messages(SAMPLES, False, stamped=False))
    with refused(key="[data] stamp"):
        read_table(path, ["time", X])
    assert read_table(path, [X], options={"stamp": "received"}).numbers(X).size


def test_a_missing_library_is_named_before_any_work(
    bags: dict[str, Path], monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setitem(sys.modules, "rosbags", None)
    monkeypatch.setitem(sys.modules, "rosbags.typesys", None)
    with refused() as caught:
        read_table(bags["plain.bag"], [X])
    assert "inercal[ros]" in str(caught.value)


def cut(raw: bytes) -> bytes:
    return raw[: len(raw) // 2]


def shifted(raw: bytes) -> bytes:
    return raw[:5000] + raw[5001:]


def zeroed(raw: bytes) -> bytes:
    return raw[:9000] + bytes(12_000) + raw[21_000:]


def headed(raw: bytes) -> bytes:
    return raw[:13]


@pytest.mark.parametrize("damage", [cut, shifted, zeroed, headed])
@pytest.mark.parametrize("name", ["bz2.bag", "lz4.bag", "plain.bag", "plain.db3", "chunks.mcap"])
def test_a_damaged_bag_is_one_line(
    bags: dict[str, Path], name: str, damage: Callable[[bytes], bytes], tmp_path: Path
):
    path = tmp_path / name
    raw = damage(bags[name].read_bytes())
    path.write_bytes(raw)
    with refused(file=path) as caught:
        read_table(path, [X])
    assert str(caught.value).startswith(name)
    assert len(str(caught.value)) < 250


def bag_record(fields: dict[str, bytes], data: bytes) -> bytes:
    head = b"".join(
        struct.pack("<I", len(k) + 1 + len(v)) + k.encode() + b"=" + v for k, v in fields.items()
    )
    return struct.pack("<I", len(head)) + head + struct.pack("<I", len(data)) + data


def bag_of_chunk(compression: bytes, packed: bytes, stated: int, indexes: int = 1) -> bytes:
    """Return a bag of one chunk, which the index names as often as stated."""
    start = b"#ROSBAG V2.0\n"
    numbers = {"conn_count": struct.pack("<I", 0), "chunk_count": struct.pack("<I", indexes)}
    head = {"op": b"\3", "index_pos": struct.pack("<Q", 0), **numbers}
    place = len(start) + len(bag_record(head, b""))
    fields = {"op": b"\5", "compression": compression, "size": struct.pack("<I", stated)}
    chunk = bag_record(fields, packed)
    head["index_pos"] = struct.pack("<Q", place + len(chunk))
    info = {
        "op": b"\6",
        "ver": struct.pack("<I", 1),
        "chunk_pos": struct.pack("<Q", place),
        "start_time": bytes(8),
        "end_time": bytes(8),
        "count": struct.pack("<I", 0),
    }
    return start + bag_record(head, b"") + chunk + bag_record(info, b"") * indexes


def packed_zeros(compression: str, size: int) -> bytes:
    """Return zeros, compressed some at a time."""
    if compression == "bz2":
        packer: Any = bz2.BZ2Compressor()
        parts = [packer.compress(bytes(1 << 24)) for _ in range(size >> 24)]
        return b"".join([*parts, packer.flush()])
    made: Any = import_module("lz4.frame").LZ4FrameCompressor()
    parts = [made.begin(), *(made.compress(bytes(1 << 24)) for _ in range(size >> 24))]
    return b"".join([*parts, made.flush()])


def mcap_of_chunk(packed: bytes, stated: int, compression: bytes = b"zstd") -> bytes:
    def record(kind: int, body: bytes) -> bytes:
        return struct.pack("<BQ", kind, len(body)) + body

    def text(one: bytes) -> bytes:
        return struct.pack("<I", len(one)) + one

    start = b"\x89MCAP0\r\n"
    begin = start + record(1, text(b"ros2") + text(b"x"))
    chunk = struct.pack("<QQQI", 0, 0, stated, 0) + text(compression)
    chunk += struct.pack("<Q", len(packed)) + packed
    body = begin + record(6, chunk)
    index = struct.pack("<QQQQIQ", 0, 0, len(begin), len(chunk) + 9, 0, 0) + text(compression)
    index += struct.pack("<QQ", len(packed), stated)
    summary = record(3, struct.pack("<H", 1) + text(b"a") + text(b"ros2msg") + text(b""))
    summary += record(8, index) + record(11, bytes(46))
    footer = record(2, struct.pack("<QQI", len(body), 0, 0))
    return body + summary + footer + start


GB = 1 << 30


def zstd_zeros(size: int) -> bytes:
    package = "compression.zstd" if sys.version_info >= (3, 14) else "backports.zstd"
    packer: Any = import_module(package).ZstdCompressor()
    parts = [packer.compress(bytes(1 << 24)) for _ in range(size >> 24)]
    return b"".join([*parts, packer.flush()])


BOMBS: dict[str, Callable[[], bytes]] = {
    "stated.bag": lambda: bag_of_chunk(b"bz2", packed_zeros("bz2", GB), (1 << 32) - 1),
    "lying.bag": lambda: bag_of_chunk(b"lz4", packed_zeros("lz4", GB), 1000),
    "lying_bz2.bag": lambda: bag_of_chunk(b"bz2", packed_zeros("bz2", GB), 1000),
    "indexed.bag": lambda: bag_of_chunk(b"none", bytes(1000), 1000, indexes=20_000),
    "stated.mcap": lambda: mcap_of_chunk(zstd_zeros(GB), 3 * GB),
    "lying.mcap": lambda: mcap_of_chunk(zstd_zeros(GB), 1000),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", chosen(BOMBS, ("indexed.bag", "lying.mcap")))
def test_a_bomb_is_refused_within_1_gb_and_10_s(tmp_path: Path, name: str):
    path = tmp_path / name
    path.write_bytes(BOMBS[name]())
    assert path.stat().st_size < 8_000_000
    assert cost(path, "/imu.linear_acceleration.x")["error"].startswith(name)


@pytest.mark.parametrize(
    "made",
    [
        "CREATE TABLE topics(id); CREATE TABLE messages(id, data BLOB AS (zeroblob(900000000)));",
        "CREATE TABLE topics(id); CREATE VIEW messages AS SELECT 1 AS id;",
        "CREATE TABLE notes(id);",
    ],
)
def test_a_database_that_is_no_bag_is_refused(tmp_path: Path, made: str):
    path = tmp_path / "a.db3"
    database = sqlite3.connect(path)
    database.executescript(made)
    database.close()
    with refused(file=path):
        read_table(path, [X])
