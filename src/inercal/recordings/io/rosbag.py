"""Read bags from ROS 1 (.bag) and ROS 2 (.db3, .mcap, or split) with the rosbags library.

A column is named "topic.field": "/imu/data_raw.linear_acceleration.x". Readings are in SI, as ROS
specifies (REP 103, REP 145). Only message types that ROS itself defines are read, with the
definitions in rosbags, because definitions in the file would be code from someone else.

A first pass over the file refuses it if its index does not name each chunk exactly once. Messages
are found through an index of the chunks. If the recorder crashed, some chunks are missing from the
index and would be skipped. If the index named a chunk twice, its messages would appear twice.

Sources: http://wiki.ros.org/Bags/Format/2.0 and https://mcap.dev/spec.
"""

import os
import struct
import sys
from array import array
from collections.abc import Iterator, Mapping
from contextlib import closing
from dataclasses import replace
from importlib import import_module
from operator import attrgetter
from pathlib import Path
from typing import Any, BinaryIO
from urllib.parse import quote

import numpy as np

from inercal.basics.errors import InputError
from inercal.recordings.io.column_table import ReadRequest, Table, file_head
from inercal.recordings.io.isolation import Isolation
from inercal.recordings.io.message_columns import Messages, table_from_messages, wanted_topics
from inercal.recordings.io.readers import Option, Reader
from inercal.recordings.io.simulation_mark import SIMULATION_OF, SIMULATION_TOPIC
from inercal.recordings.io.split_bags import (
    METADATA_START,
    SplitBag,
    bag_parts,
    bag_sha256,
    bag_size,
)

BAG, MCAP, SQLITE = b"#ROSBAG V2.0\n", b"\x89MCAP0\r\n", b"SQLite format 3\0"
_MSG_DATA, _BAG_HEADER, _CHUNK, _CHUNK_INFO = 2, 3, 5, 6
_MCAP_FOOTER, _MCAP_SCHEMA, _MCAP_CHUNK, _MCAP_CHUNK_INDEX, _MCAP_STATISTICS = 2, 3, 6, 8, 11


class DamagedBagError(ValueError):
    """The records in a file do not form a complete bag."""


def check_bag(path: Path) -> None:
    """Refuse a ROS 1 bag that is damaged or whose index is not complete.

    Raises
    ------
    DamagedBagError
        The bag is damaged; the message says how.
    """
    chunks: dict[int, bool] = {}  # position, and whether it is in the index
    places: set[int] = set()
    index = 0
    with path.open("rb") as file:
        file.seek(len(BAG))
        for at, fields in _bag_records(file):
            places.add(at)
            kind = fields["op"][0]
            if kind == _BAG_HEADER:
                (index,) = struct.unpack("<Q", fields["index_pos"])
            elif kind == _CHUNK:
                chunks[at] = False
            elif kind == _CHUNK_INFO:
                (place,) = struct.unpack("<Q", fields["chunk_pos"])
                _mark_indexed(chunks, place)
            elif kind == _MSG_DATA:
                raise DamagedBagError("it contains a message outside its chunks")
    if index not in places or not all(chunks.values()):
        raise DamagedBagError(
            "its index is incomplete, which happens after a crash: run rosbag reindex"
        )


def _bag_records(file: BinaryIO) -> Iterator[tuple[int, dict[str, bytes]]]:
    """Yield the position and the fields of each record."""
    while True:
        at = file.tell()
        head = file.read(4)
        if not head:
            return
        fields: dict[str, bytes] = {}
        header = _whole(file, struct.unpack("<I", head)[0])
        while header:
            (size,) = struct.unpack_from("<I", header)
            name, _, value = header[4 : 4 + size].partition(b"=")
            fields[name.decode("ascii")] = value
            header = header[4 + size :]
        (size,) = struct.unpack("<I", _whole(file, 4))
        after = file.tell() + size
        yield at, fields
        _skip_to(file, after)


def check_mcap(path: Path) -> None:
    """Refuse an MCAP file that is damaged or whose index is not complete.

    Raises
    ------
    DamagedBagError
        The file is damaged; the message says how.
    """
    chunks: dict[int, bool] = {}
    kinds: set[int] = set()
    places: set[int] = {0}
    summary = 0
    with path.open("rb") as file:
        file.seek(len(MCAP))
        for at, kind in _mcap_records(file):
            places.add(at)
            kinds.add(kind)
            if kind == _MCAP_CHUNK:
                chunks[at] = False
            elif kind == _MCAP_CHUNK_INDEX:
                *_, place, _ = struct.unpack("<QQQQ", _whole(file, 32))
                _mark_indexed(chunks, place)
            elif kind == _MCAP_FOOTER:
                (summary,) = struct.unpack("<Q", _whole(file, 8))
    needed = {_MCAP_SCHEMA, _MCAP_STATISTICS}
    if summary not in places or (chunks and not (all(chunks.values()) and needed <= kinds)):
        raise DamagedBagError(
            "its index is incomplete, which happens after a crash: run mcap recover"
        )


def _mcap_records(file: BinaryIO) -> Iterator[tuple[int, int]]:
    """Yield the position and kind of each record, with the file positioned at its content."""
    while True:
        at = file.tell()
        head = file.read(9)
        if head.startswith(MCAP):
            return
        if len(head) < 9:
            raise DamagedBagError("it is truncated, which happens after a crash: run mcap recover")
        kind, size = struct.unpack("<BQ", head)
        after = file.tell() + size
        yield at, kind
        _skip_to(file, after)


def check_sqlite(path: Path) -> None:
    """Refuse a damaged database.

    Raises
    ------
    DamagedBagError
        The database is damaged; the message says how.
    """
    import sqlite3  # imported here because a reader of another format needs no database

    address = f"file:{quote(str(path.absolute()))}?mode=ro&immutable=1"
    try:
        with closing(sqlite3.connect(address, uri=True)) as database:
            (state,) = database.execute("PRAGMA quick_check(1)").fetchone()
    except sqlite3.Error as error:
        raise DamagedBagError(str(error)) from error
    if state != "ok":
        raise DamagedBagError(str(state))


def _mark_indexed(chunks: dict[int, bool], place: int) -> None:
    if chunks.get(place, True):
        raise DamagedBagError("its index names a chunk twice, or a chunk that does not exist")
    chunks[place] = True


def _whole(file: BinaryIO, size: int) -> bytes:
    """Read the given number of bytes; refuse a file that ends earlier."""
    raw = file.read(min(size, os.fstat(file.fileno()).st_size))
    if len(raw) < size:
        raise DamagedBagError("it is truncated, which happens after a crash")
    return raw


def _skip_to(file: BinaryIO, place: int) -> None:
    """Move to a position; refuse a file that ends before it."""
    if place:
        file.seek(place - 1)
        _whole(file, 1)


_IMU = "sensor_msgs/msg/Imu"
_ZSTD = b"\x28\xb5\x2f\xfd"  # start of a message that was compressed individually
_LIBRARIES = ("rosbags.rosbag1", "rosbags.rosbag2", "rosbags.typesys")
_DEEPEST = 8  # levels of nested messages
_READINGS = ("linear_acceleration", "angular_velocity", "orientation")


def read_rosbag(path: Path, wanted: ReadRequest, stamp: str = "header") -> Table:
    """Read topics from a ROS 1 or ROS 2 bag.

    Parameters
    ----------
    path : Path
    wanted : ReadRequest
    stamp : "header" or "received"
        Whether to use the times stamped by the driver, or those at which the messages were
        recorded.

    Raises
    ------
    InputError
        The bag is damaged or has no time stamps, or a topic or field is missing in it.
    OSError
        The file cannot be read.
    """
    if stamp not in ("header", "received"):
        raise InputError(
            f'{path.name}: [data] stamp is {stamp!r}; it is "header" or "received"',
            key="[data] stamp",
        )
    split = file_head(path, len(METADATA_START)) == METADATA_START
    parts = bag_parts(path) if split else (path,)
    with closing(SplitBag([_open(part) for part in parts])) as reader:
        messages = list(_topics(path, reader, wanted, stamp))
        simulation = _simulation(path, reader)
    table = replace(table_from_messages(path, messages, wanted), simulation=simulation)
    return replace(table, sha256=bag_sha256(parts)) if split else table


def _simulation(path: Path, reader: Any) -> str:
    """Return the mark of a simulated recording; empty if there is none."""
    marks = [one for one in reader.connections if one.topic == SIMULATION_TOPIC]
    sent = reader.messages(marks) if marks else ()
    texts = [str(_decoder(path)[0](raw, one.msgtype).data) for one, _, raw in sent]
    return next((text for text in texts if text.startswith(SIMULATION_OF)), "")


def _open(path: Path) -> Any:
    """Open a file whose index is complete, and return its reader."""
    head = file_head(path, len(SQLITE))
    reader: Any
    if head.startswith(BAG):
        check_bag(path)
        reader = import_module("rosbags.rosbag1").Reader(path)
    else:
        plugins = import_module("rosbags.rosbag2").Reader.STORAGE_PLUGINS
        if head.startswith(MCAP):
            check_mcap(path)
            reader = plugins[".mcap"](path)
        elif not head.startswith(SQLITE):
            raise InputError(
                f"{path.name} is not a ROS bag: it does not begin like a .bag, .mcap or .db3 "
                "file; name the file of the bag, or give a text file the suffix .csv",
                file=path,
            )
        else:
            check_sqlite(path)
            # rosbags interprets the path as part of an address.
            reader = plugins[".db3"](Path(quote(str(path.absolute()))))
    reader.open()
    return reader


def _topics(path: Path, reader: Any, wanted: ReadRequest, stamp: str) -> Iterator[Messages]:
    """Yield the messages of each wanted topic."""
    by_topic: dict[str, list[Any]] = {}
    for connection in reader.connections:
        by_topic.setdefault(connection.topic, []).append(connection)
    inertial = [name for name, some in by_topic.items() if some[0].msgtype == _IMU]
    decode, definitions = _decoder(path)
    for topic in wanted_topics(wanted, by_topic, inertial, path.name):
        kinds = {connection.msgtype for connection in by_topic[topic]}
        fields = [] if len(kinds) > 1 else _number_fields(definitions, *kinds)
        if not fields:
            raise InputError(
                f"{path.name}: topic {topic!r} contains {' and '.join(sorted(kinds))}, which "
                "cannot be read as numbers; name a topic of sensor_msgs/msg/Imu",
                names=(topic,),
            )
        if wanted.names is not None:
            own = [name for name in wanted.names if name.startswith(f"{topic}.")]
            named = {name.removeprefix(f"{topic}.") for name in own}
            for field in sorted(named - set(fields)):
                raise InputError(
                    f"{path.name} has no column {f'{topic}.{field}'!r}; the fields of {topic} are "
                    f"{', '.join(fields[:12])}",
                    names=(f"{topic}.{field}",),
                )
            fields = [field for field in fields if field in named]
        named = wanted.names is not None
        yield _messages(path, reader, by_topic[topic], fields, stamp, decode, named=named)


def _decoder(path: Path) -> tuple[Any, Mapping[str, Any]]:
    """Return a decoder for messages of the file's ROS version, and the type definitions."""
    types: Any = import_module("rosbags.typesys")
    first = file_head(path, len(BAG)) == BAG
    kinds = types.Stores
    store = types.get_typestore(kinds.ROS1_NOETIC if first else kinds.ROS2_HUMBLE)
    return (store.deserialize_ros1 if first else store.deserialize_cdr), store.fielddefs


def _number_fields(
    definitions: Mapping[str, Any], kind: str, before: str = "", depth: int = 0
) -> list[str]:
    """Return the numeric fields of a message type, including those in nested messages."""
    if kind not in definitions or depth == _DEEPEST:
        return []
    found: list[str] = []
    for name, (node, content) in definitions[kind][1]:
        if node.name == "BASE" and content[0] not in ("string", "wstring"):
            found.append(before + name)
        elif node.name == "NAME":
            found += _number_fields(definitions, content, f"{before}{name}.", depth + 1)
    return found


def _messages(
    path: Path,
    reader: Any,
    connections: list[Any],
    fields: list[str],
    stamp: str,
    decode: Any,
    *,
    named: bool,
) -> Messages:
    """Return the messages of a topic, decoded one by one.

    Readings that the driver does not measure are refused if the user names them, and else left out.
    """
    topic, kind = connections[0].topic, connections[0].msgtype
    times, values, getters = array("q"), [array("d") for _ in fields], list[Any]()
    for _, received, raw in reader.messages(connections):
        message = decode(_zstd().decompress(raw) if raw.startswith(_ZSTD) else raw, kind)
        if not times:
            fields = _measured_fields(path, topic, message, fields, named=named)
            values, getters = [array("d") for _ in fields], [attrgetter(field) for field in fields]
        at = received if stamp == "received" else _stamped(path, topic, message, first=not times)
        times.append(at)
        for column, get in zip(values, getters, strict=True):
            column.append(get(message))
    columns = {f: np.frombuffer(v) for f, v in zip(fields, values, strict=True)}
    return Messages(topic, np.frombuffer(times, np.int64), columns)


def _zstd() -> Any:
    """Import the library that rosbags also uses; Python includes it from 3.14 on."""
    return import_module("compression.zstd" if sys.version_info >= (3, 14) else "backports.zstd")


def _stamped(path: Path, topic: str, message: Any, *, first: bool) -> int:
    """Return the time in a message's header, ns; a clock may be at zero at the first message."""
    header = getattr(message, "header", None)
    ns = 0 if header is None else header.stamp.sec * 10**9 + header.stamp.nanosec
    if header is None or not (ns or first):
        raise InputError(
            f"{path.name}: messages of {topic!r} have no time in their header: state stamp = "
            '"received" in [data] for the times at which they were recorded',
            key="[data] stamp",
            names=(topic,),
        )
    return ns


def _measured_fields(
    path: Path, topic: str, message: Any, fields: list[str], *, named: bool
) -> list[str]:
    """Return the fields without readings whose covariance begins with −1, or refuse these."""
    for name in _READINGS:
        covariance = getattr(message, f"{name}_covariance", None)
        if covariance is None or not any(field.startswith(name) for field in fields):
            continue
        if covariance[0] == -1:
            if named:
                raise InputError(
                    f"{path.name}: messages of {topic!r} state that they have no {name} (its "
                    "covariance begins with -1): name the topic of the sensor that measures it",
                    names=(topic,),
                )
            fields = [field for field in fields if not field.startswith(name)]
    return fields


READER = Reader(
    "rosbag",
    read_rosbag,
    content=((0, BAG), (0, MCAP), (0, SQLITE), (0, METADATA_START)),
    suffixes=(".bag", ".db3", ".mcap"),
    options=(
        Option(
            "stamp",
            str,
            "header",
            '"header" for the driver\'s times, "received" for recording times',
        ),
    ),
    isolation=Isolation("a ROS bag", "repair or record it again", _LIBRARIES, "ros", size=bag_size),
)
