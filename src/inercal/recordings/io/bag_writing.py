"""Write corrected motion as messages of ROS 2: one MCAP file, or the folder of a bag.

The messages are sensor_msgs/Imu, and sensor_msgs/MagneticField and sensor_msgs/Temperature if the
recording has such columns. As their definitions and REP 145 require, a covariance of zeros means
that it is unknown, and a first element of −1 that the message does not contain this quantity.

The covariance of a calibration is not used for them: it describes errors that all samples share,
but programs take the covariance of a message for noise that differs from sample to sample.

Sources: REP 103, https://ros.org/reps/rep-0145.html, and the definitions of the messages in
https://github.com/ros2/common_interfaces (sensor_msgs).
"""

import os
from collections.abc import Callable, Iterator
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from inercal.basics.arrays import Array, Indices
from inercal.basics.atomic_files import atomic_write
from inercal.basics.errors import InputError, require_extra
from inercal.basics.units import ZERO_CELSIUS
from inercal.recordings import Recording
from inercal.recordings.io.simulation_mark import SIMULATION_TOPIC

STORAGES = {"mcap": "MCAP", "sqlite3": "SQLITE3"}
"""How the folder of a bag can store its messages, with the name of each in rosbags."""
IMU_TOPIC, FIELD_TOPIC, TEMPERATURE_TOPIC = "/imu/data", "/imu/mag", "/imu/temperature"
FRAME_ID = "imu_link"

# ROS 2 Humble and later read version 8; Humble does not read the newer version 9.
_VERSION = 8
_SECOND = 10**9  # ns
_END = 2**31 * _SECOND  # ns; the seconds of a time stamp are a 32-bit integer
_Sent = tuple[str, int, Any]


def is_bag(path: Path) -> bool:
    """Return whether a name to write to means a bag: an .mcap file, or a folder (no suffix)."""
    return path.suffix.lower() in (".mcap", "") and path.name != "-"


def write_bag(
    motion: Recording, path: Path, *, frame_id: str = FRAME_ID, storage: str = "mcap"
) -> tuple[str, ...]:
    """Write a corrected recording as a bag of ROS 2, completely or not at all.

    Parameters
    ----------
    motion : Recording
        Recording with all three components of the specific force, m/s², or the angular rate, rad/s,
        and maybe the magnetic flux density, T, as `inercal.pipeline.apply` returns it.
    path : Path
        An .mcap file, or a folder that does not exist.
    frame_id : str
        The frame that the messages name.
    storage : str
        One of `STORAGES`, for a folder.

    Returns
    -------
    tuple of str
        Columns of the recording that no message has a field for, so that they are not written.

    Raises
    ------
    InputError
        The path cannot be written, a component is missing, or a time does not fit into a message.
    MissingExtra
        rosbags is not installed.
    """
    with require_extra("ros", "bags of ROS need rosbags; install the extra", ("rosbags",)):
        rosbag2: Any = import_module("rosbags.rosbag2")
        typesys: Any = import_module("rosbags.typesys")
    store = typesys.get_typestore(typesys.Stores.ROS2_HUMBLE)
    messages = _messages(motion, _stamps(motion, path), store.types, frame_id, path)
    with atomic_write(path) as temporary:
        single = bool(path.suffix)
        folder = temporary.with_suffix("") if single else temporary
        plugin = rosbag2.StoragePlugin[STORAGES["mcap" if single else storage]]
        with rosbag2.Writer(folder, version=_VERSION, storage_plugin=plugin) as writer:
            connections: dict[str, Any] = {}
            for topic, ns, message in messages:
                kind = message.__msgtype__
                if topic not in connections:
                    connections[topic] = writer.add_connection(topic, kind, typestore=store)
                writer.write(connections[topic], ns, store.serialize_cdr(message, kind))
        if single:
            os.replace(folder / f"{folder.name}.mcap", temporary)
    labels = () if motion.labels is None else (motion.label_name,)
    return (*labels, *motion.readback)


def _stamps(motion: Recording, path: Path) -> Indices:
    """Return the times on the clock of the recording, (n,) ns."""
    zero = motion.origin
    start, part = divmod(motion.first_stamp * _SECOND if zero is None else zero, 1)
    ns = np.rint(motion.time * _SECOND + float(part)).astype(np.int64) + int(start)
    if ns.min() < 0 or ns.max() >= _END:
        raise InputError(
            f"{path}: the times of {motion.source or 'the recording'} are from "
            f"{ns.min() / _SECOND:.9g} s to {ns.max() / _SECOND:.9g} s, but a message of ROS only "
            "has times from 0 to 2³¹ s; write a .csv, .npz or .parquet file",
            file=path,
            key="--out",
        )
    return ns


def _components(motion: Recording, letter: str, path: Path) -> Array | None:
    """Return the x, y and z components of a quantity, (n, 3); None if there are none."""
    names = [letter + axis for axis in "xyz"]
    if not any(name.startswith(letter) for name in motion.channels):
        return None
    if not set(names) <= set(motion.channels):
        raise InputError(
            f"{path}: a message of ROS needs {', '.join(names)}, but the recording has "
            f"{', '.join(motion.channels)}; write a .csv, .npz or .parquet file",
            file=path,
            key="--out",
        )
    return motion.data[:, [motion.channels.index(name) for name in names]]


def _messages(
    motion: Recording, stamps: Indices, types: Any, frame_id: str, path: Path
) -> Iterator[_Sent]:
    """Check the components, and return topic, time and message of what is to be written."""
    force, rate, field = (_components(motion, letter, path) for letter in "fwm")
    celsius = None if motion.temperature is None else motion.temperature - ZERO_CELSIUS
    time, header = types["builtin_interfaces/msg/Time"], types["std_msgs/msg/Header"]
    vector, quaternion = types["geometry_msgs/msg/Vector3"], types["geometry_msgs/msg/Quaternion"]
    attitude, absent = quaternion(0.0, 0.0, 0.0, 1.0), np.array([-1.0, *[0.0] * 8])
    unknown, no_vector = np.zeros(9), vector(0.0, 0.0, 0.0)

    def part(values: Array | None) -> Callable[[int], tuple[Any, Array]]:
        """Return a function that gives the vector of a sample, and its covariance."""
        if values is None:
            return lambda _: (no_vector, absent)
        rows = values.tolist()
        return lambda k: (vector(*rows[k]), unknown)

    parts = part(rate), part(force)

    def sequence() -> Iterator[_Sent]:
        if motion.simulation:
            text = types["std_msgs/msg/String"](motion.simulation)
            yield SIMULATION_TOPIC, int(stamps[0]), text
        for k, ns in enumerate(stamps.tolist()):
            at = header(time(*divmod(ns, _SECOND)), frame_id)
            if force is not None or rate is not None:
                readings = (value for one in parts for value in one(k))
                imu = types["sensor_msgs/msg/Imu"](at, attitude, absent, *readings)
                yield IMU_TOPIC, ns, imu
            if field is not None:
                flux = vector(*field[k].tolist())
                yield FIELD_TOPIC, ns, types["sensor_msgs/msg/MagneticField"](at, flux, unknown)
            if celsius is not None:
                heat = types["sensor_msgs/msg/Temperature"](at, float(celsius[k]), 0.0)
                yield TEMPERATURE_TOPIC, ns, heat

    return sequence()
