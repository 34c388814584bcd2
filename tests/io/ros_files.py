"""One recording of six positions, written as bags by rosbags itself."""

import shutil
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.io.log_files import Samples

typesys: Any = pytest.importorskip("rosbags.typesys", reason="needs the extra inercal[ros]")
rosbag1: Any = pytest.importorskip("rosbags.rosbag1", reason="needs the extra inercal[ros]")
rosbag2: Any = pytest.importorskip("rosbags.rosbag2", reason="needs the extra inercal[ros]")

EPOCH_NS = 1_780_000_000_123_456_789
IMU = "sensor_msgs/msg/Imu"
RAW, ACCEL, GYRO, CELSIUS, TEXT = "/imu/data_raw", "/accel", "/gyro", "/imu/temperature", "/text"
NONE = np.array([-1.0] + [0.0] * 8)
Sent = tuple[str, int, Any]


def store(first: bool) -> Any:
    kinds = typesys.Stores
    return typesys.get_typestore(kinds.ROS1_NOETIC if first else kinds.ROS2_HUMBLE)


def messages(samples: Samples, first: bool, stamped: bool = True) -> Iterable[Sent]:
    """Yield topic, time of recording and message, with one topic of both and one of each."""
    types = store(first).types
    vector, zeros = types["geometry_msgs/msg/Vector3"], np.zeros(9)

    def header(ns: int) -> Any:
        time = types["builtin_interfaces/msg/Time"](*divmod(ns if stamped else 0, 10**9))
        kind = types["std_msgs/msg/Header"]
        return kind(0, time, "imu") if first else kind(time, "imu")

    def imu(ns: int, acc: Any, gyr: Any) -> Any:
        attitude = types["geometry_msgs/msg/Quaternion"](0.0, 0.0, 0.0, 1.0)
        none = vector(0.0, 0.0, 0.0)
        return types[IMU](
            header(ns),
            attitude,
            NONE,
            none if gyr is None else vector(*gyr),
            NONE if gyr is None else zeros,
            none if acc is None else vector(*acc),
            NONE if acc is None else zeros,
        )

    for k, since in enumerate((samples.ns - samples.ns[0]).tolist()):
        ns = EPOCH_NS + since
        acc, gyr = samples.acc[k].tolist(), samples.gyr[k].tolist()
        late = ns + 3_000_000 + 1000 * k
        yield RAW, late, imu(ns, acc, gyr)
        yield ACCEL, late + 1, imu(ns + 1_000_000, acc, None)
        yield GYRO, late + 2, imu(ns + 2_000_000, None, gyr)
        yield TEXT, late + 3, types["std_msgs/msg/String"]("a word")
        if k % 10 == 0:
            t = float(samples.temperature[k])
            yield CELSIUS, late + 4, types["sensor_msgs/msg/Temperature"](header(ns), t, 0.0)


def write(writer: Any, sent: Iterable[Sent], first: bool) -> None:
    types = store(first)
    serialize = types.serialize_ros1 if first else types.serialize_cdr
    connections: dict[str, Any] = {}
    for topic, ns, message in sent:
        kind = message.__msgtype__
        if topic not in connections:
            connections[topic] = writer.add_connection(topic, kind, typestore=types)
        writer.write(connections[topic], ns, serialize(message, kind))


def write_bag(path: Path, sent: Iterable[Sent], compression: str = "") -> Path:
    """Write a bag of ROS 1."""
    writer = rosbag1.Writer(path)
    if compression:
        writer.set_compression(writer.CompressionFormat[compression])
    with writer:
        write(writer, sent, first=True)
    return path


def write_bag2(path: Path, sent: Iterable[Sent], compression: str = "") -> Path:
    """Write a bag of ROS 2, .db3 or .mcap by the suffix, without the folder around it."""
    folder = path.parent / f"{path.stem}_folder"
    plugin = "MCAP" if path.suffix == ".mcap" else "SQLITE3"
    writer = rosbag2.Writer(folder, version=9, storage_plugin=rosbag2.StoragePlugin[plugin])
    if compression:
        writer.set_compression(rosbag2.CompressionMode[compression], rosbag2.CompressionFormat.ZSTD)
    with writer:
        write(writer, sent, first=False)
    (made,) = folder.glob(f"*{path.suffix}")
    shutil.move(made, path)
    shutil.rmtree(folder)
    return path


def write_split_bag(folder: Path, sent: Iterable[Sent], suffix: str, count: int) -> Path:
    """Write a bag of ROS 2 in several parts, and return the file that lists them."""
    kept = list(sent)
    folder.mkdir()
    names = [f"{folder.name}_{k}{suffix}" for k in range(count)]
    for k, name in enumerate(names):
        part = kept[k * len(kept) // count : (k + 1) * len(kept) // count]
        write_bag2(folder / name, part)
    listed = "".join(f"  - {name}\n" for name in names)
    text = f"rosbag2_bagfile_information:\n  version: 5\n  relative_file_paths:\n{listed}"
    (folder / "metadata.yaml").write_text(f"{text}  duration:\n    nanoseconds: 1\n")
    return folder / "metadata.yaml"
