"""A first pass over a ROS bag or an MCAP file: whether its index names each chunk, once.

Messages are found by an index of the chunks: a recorder that crashed leaves chunks without one,
which would be passed over, and of a chunk that is named twice messages would come twice.

Sources: http://wiki.ros.org/Bags/Format/2.0 and https://mcap.dev/spec.
"""

import os
import sqlite3
import struct
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import BinaryIO
from urllib.parse import quote

BAG, MCAP, SQLITE = b"#ROSBAG V2.0\n", b"\x89MCAP0\r\n", b"SQLite format 3\0"
_MSG_DATA, _BAG_HEADER, _CHUNK, _CHUNK_INFO = 2, 3, 5, 6
_MCAP_SCHEMA, _MCAP_CHUNK, _MCAP_CHUNK_INDEX, _MCAP_STATISTICS = 3, 6, 8, 11
_MCAP_FOOTER = 2


class DamagedBagError(ValueError):
    """The records of a file are not those of a whole bag."""


def check_bag(path: Path) -> None:
    """Refuse a ROS 1 bag whose index is not complete, or that is damaged.

    Raises
    ------
    DamagedBagError
        With what is wrong.
    """
    chunks: dict[int, bool] = {}  # place, and whether it is indexed
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
                raise DamagedBagError("a message outside the chunks")
    if index not in places or not all(chunks.values()):
        raise DamagedBagError("it has no complete index, as after a crash: run rosbag reindex")


def _bag_records(file: BinaryIO) -> Iterator[tuple[int, dict[str, bytes]]]:
    """Yield place and fields of each record."""
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
    """Refuse an MCAP file whose index is not complete, or that is damaged.

    Raises
    ------
    DamagedBagError
        With what is wrong.
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
        raise DamagedBagError("it has no complete index, as after a crash: run mcap recover")


def _mcap_records(file: BinaryIO) -> Iterator[tuple[int, int]]:
    """Yield place and kind of each record; the file stands at its content."""
    while True:
        at = file.tell()
        head = file.read(9)
        if head.startswith(MCAP):
            return
        if len(head) < 9:
            raise DamagedBagError("it is cut off, as after a crash: run mcap recover")
        kind, size = struct.unpack("<BQ", head)
        after = file.tell() + size
        yield at, kind
        _skip_to(file, after)


def check_sqlite(path: Path) -> None:
    """Refuse a database that is damaged.

    Raises
    ------
    DamagedBagError
        With what is wrong.
    """
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
        raise DamagedBagError("its index names a chunk twice, or one that it does not hold")
    chunks[place] = True


def _whole(file: BinaryIO, size: int) -> bytes:
    """Return bytes; refuse a file that ends before."""
    raw = file.read(min(size, os.fstat(file.fileno()).st_size))
    if len(raw) < size:
        raise DamagedBagError("it is cut off, as after a crash")
    return raw


def _skip_to(file: BinaryIO, place: int) -> None:
    """Go to a place; refuse a file that ends before it."""
    if place:
        file.seek(place - 1)
        _whole(file, 1)
