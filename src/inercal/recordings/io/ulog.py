"""Read ULog files, the logs of PX4, with pyulog.

A column is named "topic.field"; for an instance other than the first it is "topic[1].field".
`sensor_accel` and `sensor_gyro` contain the raw readings of the sensors (PX4 1.11 and later).
`sensor_combined` is corrected; its offsets, scale factors and rotation are undone with the
parameters in the log. The other corrected topics are also filtered, which cannot be undone.
"""

import struct
from collections.abc import Iterator, Mapping, Sequence
from contextlib import redirect_stdout
from dataclasses import replace
from functools import partial
from importlib import import_module
from io import StringIO
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from inercal.basics.arrays import Array
from inercal.basics.errors import InputError
from inercal.recordings.io import message_columns
from inercal.recordings.io.column_table import ReadRequest, Table, shorten
from inercal.recordings.io.isolation import Isolation
from inercal.recordings.io.message_columns import Correction, Messages
from inercal.recordings.io.readers import Reader

# First pass over a ULog file: it finds the topics and checks that the messages are complete.
#
# pyulog skips damaged parts byte by byte. This pass only accepts files in which known messages
# follow each other without gaps.
#
# Source: the ULog file format, https://docs.px4.io/main/en/dev_log/ulog_file_format.html
HEADER = b"ULog\x01\x12\x35"
_HEADER_BYTES = 16
_damaged = partial(message_columns.damaged_log, "a ULog file")
_KNOWN = frozenset(b"BFIMPQARDLCSO")


def scan_topics(path: Path) -> list[str]:
    """Return the topics in a ULog file: "sensor_accel", "sensor_accel[1]".

    Raises
    ------
    InputError
        The file is damaged.
    OSError
        The file cannot be read.
    """
    topics: list[str] = []
    for at, kind, body in _messages(path):
        if kind == b"A":
            try:
                topics.append(topic_name(body[3:].decode("ascii"), body[0]))
            except ValueError as error:
                raise _damaged(path, at, shorten(str(error), 80)) from error
    return list(dict.fromkeys(topics))


def topic_name(name: str, instance: int) -> str:
    """Return a topic's name; instances other than 0 have their number in brackets."""
    return f"{name}[{instance}]" if instance else name


def _messages(path: Path) -> Iterator[tuple[int, bytes, bytes]]:
    """Yield the position, type and body of each message.

    The last message may be cut off, because a log ends this way when power is lost.
    """
    with path.open("rb") as file:
        if file.read(_HEADER_BYTES)[: len(HEADER)] != HEADER:
            raise _damaged(path, 0, "it does not begin like a ULog file")
        ends = _part_ends(path, file)
        for end in ends:
            while len(head := file.read(3)) == 3:
                size, kind = struct.unpack("<HB", head)
                at = file.tell() - 3
                if kind not in _KNOWN or size == 0:
                    raise _damaged(path, at, f"a message of type {kind} and {size} bytes")
                body = file.read(size)
                if len(body) < size or (end is not None and file.tell() > end):
                    break
                yield at, bytes([kind]), body
            if end is not None:
                file.seek(end)


def _part_ends(path: Path, file: BinaryIO) -> list[int | None]:
    """Return the ends of parts appended after a crash; None stands for the end of the file."""
    head = file.read(3 + 40)
    file.seek(_HEADER_BYTES)
    if len(head) < 43 or head[2:3] != b"B":
        return [None]
    (appended,) = struct.unpack_from("<B", head, 3 + 8)
    offsets = [k for k in struct.unpack_from("<3Q", head, 3 + 16) if k] if appended & 1 else []
    if sorted(offsets) != offsets or any(k > path.stat().st_size for k in offsets):
        raise _damaged(path, _HEADER_BYTES, "the offset of appended data is outside the file")
    return [*offsets, None]


_DEFAULT_TOPICS = ("sensor_accel", "sensor_gyro")
_JOINED_TOPICS = ("sensor_combined",)
_SELECTION = "sensor_selection"  # states which sensor sensor_combined contains
# Fields of a topic, the word in their parameters, and the field of their device in _SELECTION.
_CORRECTED: dict[str, tuple[tuple[str, str, str], ...]] = {
    "sensor_combined": (
        ("accelerometer_m_s2[{}]", "ACC", "accel_device_id"),
        ("gyro_rad[{}]", "GYRO", "gyro_device_id"),
    )
}
_FILTERED = ("vehicle_acceleration", "vehicle_angular_velocity", "vehicle_imu")
_SENSORS = 4  # number of parameter sets
_THERMAL = {"ACC": "TC_A_ENABLE", "GYRO": "TC_G_ENABLE"}


def read_ulog(path: Path, wanted: ReadRequest, corrections: str = "undo") -> Table:
    """Read topics from a ULog file.

    Parameters
    ----------
    path : Path
    wanted : ReadRequest
    corrections : "undo" or "keep"
        Whether to convert corrected readings back to the raw readings of the sensors, or to keep
        them.

    Raises
    ------
    InputError
        The file is damaged, a topic is missing in it, or the corrections cannot be undone.
    OSError
        The file cannot be read.
    """
    core: Any = import_module("pyulog.core")
    keep = message_columns.keeps_corrections(corrections, path.name)
    topics = scan_topics(path)
    defaults = _DEFAULT_TOPICS if set(topics) & set(_DEFAULT_TOPICS) else _JOINED_TOPICS
    used = message_columns.wanted_topics(wanted, topics, defaults, path.name)
    names = {topic.partition("[")[0] for topic in used}
    log = _load(core, path, [*names, *([_SELECTION] if names & set(_CORRECTED) else [])])
    data = {topic_name(one.name, one.multi_id): one.data for one in log.data_list}
    message_columns.require_messages(used, data, path.name)
    raw = [_uncorrected(path.name, log, topic, data, wanted, keep) for topic in used]
    return message_columns.table_from_messages(path, raw, wanted)


def _load(core: Any, path: Path, names: list[str]) -> Any:
    """Return the log with the messages of some topics; pyulog prints the damage that it finds."""
    printed = StringIO()
    with redirect_stdout(printed), path.open("rb") as file:
        log = core.ULog(file, names)
    if log.file_corruption:
        raise ValueError(printed.getvalue() or "messages are damaged")
    return log


def _uncorrected(
    source: str, log: Any, topic: str, data: Mapping[str, Any], wanted: ReadRequest, keep: bool
) -> Messages:
    """Return a topic's messages before their corrections, with the corrections that are kept."""
    name, values = topic.partition("[")[0], data[topic]
    time = values["timestamp_sample" if "timestamp_sample" in values else "timestamp"]
    logged = Messages(topic, np.asarray(time, np.int64) * 1000, values)
    channels = {
        column.removeprefix(f"{topic}.")
        for column in message_columns.channel_columns(wanted, logged)
    }
    filtered = bool(channels) and name in _FILTERED
    if filtered and not keep:
        raise InputError(
            f"{source}: topic {topic!r} is corrected and filtered, which cannot be undone: log "
            'sensor_accel and sensor_gyro, or state corrections = "keep"',
            key="[data] corrections",
            names=(topic,),
        )
    if channels and not filtered and "x_raw" in values:
        raise InputError(
            f"{source}: {topic!r} is from PX4 before 1.11, whose drivers apply their own "
            "corrections: log with PX4 1.11 or later",
            names=(topic,),
        )
    changed: dict[str, Array] = {}
    words = [f"{topic}: corrected and filtered by PX4"] if filtered else []
    for pattern, sensor, device in _CORRECTED.get(name, ()):
        fields = [pattern.format(k) for k in range(3)]
        if not channels & set(fields):
            continue
        if keep:
            words.append(f"{topic}: {_stated(log, sensor)}")
            continue
        correction = _correction(source, log, sensor, _device(source, log, data, sensor, device))
        readings = np.stack([values[field] for field in fields], -1).astype(float)
        changed |= zip(fields, correction.undo(readings).T, strict=True)
    devices = _devices(source, logged, data, wanted)
    return replace(logged, fields=values | changed, kept_corrections=tuple(words), devices=devices)


def _devices(
    source: str, logged: Messages, data: Mapping[str, Any], wanted: ReadRequest
) -> dict[str, int]:
    """Return the devices from which a topic's readings come, by topic or sensor_selection field.

    Raises
    ------
    InputError
        A topic contains readings of two sensors.
    """
    if not message_columns.channel_columns(wanted, logged):
        return {}
    if logged.topic in _CORRECTED:
        fields = {field for _, _, field in _CORRECTED[logged.topic]}
        known = data.get(_SELECTION, {})
        return {field: int(known[field][-1]) for field in sorted(fields) if field in known}
    numbers = {int(one) for one in logged.fields.get("device_id", ()) if one}
    if len(numbers) > 1:
        listed = ", ".join(map(str, sorted(numbers)))
        raise InputError(
            f"{source}: topic {logged.topic!r} contains readings of {len(numbers)} sensors "
            f"(device_id {listed}): log only one of them",
            names=(logged.topic,),
        )
    return dict.fromkeys((logged.topic,) if numbers else (), max(numbers, default=0))


def _device(source: str, log: Any, data: Mapping[str, Any], sensor: str, field: str) -> int:
    """Return the device whose readings sensor_combined contains."""
    if _SELECTION in data and field in data[_SELECTION]:
        found = {int(one) for one in data[_SELECTION][field] if one}
    else:
        stated = (log.initial_parameters.get(f"CAL_{sensor}{n}_ID", 0) for n in range(_SENSORS))
        found = {int(one) for one in stated if one}
    if len(found) == 1:
        return found.pop()
    reason = "changes" if found else "is unknown"
    raise InputError(
        f"{source}: the sensor in sensor_combined {reason} ({field} of {_SELECTION}), so its "
        "corrections cannot be undone: use sensor_accel and sensor_gyro",
        names=("sensor_combined",),
    )


def _correction(source: str, log: Any, sensor: str, device: int) -> Correction:
    """Return the correction that PX4 applied to a device, from the log's parameters."""
    parameters: dict[str, float] = dict(log.initial_parameters)
    if parameters.get(_THERMAL[sensor]):
        raise InputError(
            f"{source}: {_THERMAL[sensor]} is 1: PX4 compensated for temperature, which is not "
            "undone here: use sensor_accel and sensor_gyro",
            names=(_THERMAL[sensor],),
        )
    numbers = [n for n in range(_SENSORS) if parameters.get(f"CAL_{sensor}{n}_ID") == device]
    used: dict[str, float] = {}

    def values(kind: str, default: float) -> Array:
        if not numbers:
            return np.full(3, default)  # a sensor that was never calibrated
        named = [f"CAL_{sensor}{numbers[0]}_{axis}{kind}" for axis in "XYZ"]
        used.update({name: parameters[name] for name in named if name in parameters})
        return np.array([parameters.get(name, default) for name in named])

    offset, scale = values("OFF", 0.0), values("SCALE", 1.0)
    turn = parameters.get(f"CAL_{sensor}{numbers[0]}_ROT", -1) if numbers else -1
    if turn >= 0:
        used[f"CAL_{sensor}{numbers[0]}_ROT"] = turn
        rotation = message_columns.rotation_matrix(turn, f"CAL_{sensor}{numbers[0]}_ROT", source)
    else:
        rotation = _board_rotation(source, parameters, used)
    _refuse_changes(source, log, used)
    return Correction(offset, scale, rotation)


def _stated(log: Any, sensor: str) -> str:
    """Return the parameters with which the readings were corrected, in words."""
    own = (f"CAL_{sensor}", "SENS_BOARD_", f"TC_{sensor[0]}")
    stated = {name: value for name, value in log.initial_parameters.items() if name.startswith(own)}
    return message_columns.stated_parameters(stated)


def _board_rotation(source: str, parameters: Mapping[str, float], used: dict[str, float]) -> Array:
    """Return the rotation from board axes to vehicle axes."""
    names = ("SENS_BOARD_ROT", *(f"SENS_BOARD_{axis}_OFF" for axis in "XYZ"))
    number, *angles = (parameters.get(name, 0.0) for name in names)
    used.update({name: parameters[name] for name in names if name in parameters})
    return message_columns.euler_matrix(*angles) @ message_columns.rotation_matrix(
        number, names[0], source
    )


def _refuse_changes(source: str, log: Any, used: Mapping[str, float]) -> None:
    """Refuse a log in which a correction changes, because it is unknown when it took effect."""
    changes: Sequence[tuple[int, str, float]] = log.changed_parameters
    for time, name, value in changes:
        if name in used and value != used[name]:
            raise InputError(
                f"{source}: {name} changes from {used[name]:g} to {value:g} at {1e-6 * time:.6g} s "
                "after boot: use sensor_accel and sensor_gyro, or log again",
                names=(name,),
            )


READER = Reader(
    "ulog",
    read_ulog,
    content=((0, HEADER),),
    suffixes=(".ulg",),
    options=(message_columns.CORRECTIONS_OPTION,),
    isolation=Isolation("a ULog file", message_columns.COPY_AGAIN, ("pyulog.core",), "px4"),
)
