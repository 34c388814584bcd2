"""A first pass over a ROS bag or an MCAP file: what its chunks declare, before any is decoded.

Chunks are compressed, and an index says where they are: small files could declare more than any
memory holds, or index a chunk many times. This pass accepts records that come one after the other,
and chunks that have the size that they state, which is bounded, and that are indexed once. Chunks
are decoded one by one, so that bags with pictures may be of any size.

Sources: http://wiki.ros.org/Bags/Format/2.0 and https://mcap.dev/spec.
"""

import bz2
import re
import sqlite3
import struct
import sys
from collections.abc import Callable, Iterator
from contextlib import closing
from importlib import import_module
from pathlib import Path
from typing import Any, BinaryIO
from urllib.parse import quote

BAG, MCAP, SQLITE = b"#ROSBAG V2.0\n", b"\x89MCAP0\r\n", b"SQLite format 3\0"
ZSTD = b"\x28\xb5\x2f\xfd"
_LARGEST_CHUNK = 1 << 28  # bytes; recorders close a chunk after some MB
_LARGEST_MESSAGE = 1 << 20  # bytes of one that holds no picture
_STEP = 1 << 24  # bytes decoded at a time
_MSG_DATA, _BAG_HEADER, _CHUNK, _CHUNK_INFO = 2, 3, 5, 6
_MCAP_SCHEMA, _MCAP_CHUNK, _MCAP_CHUNK_INDEX, _MCAP_STATISTICS = 3, 6, 8, 11
_MCAP_FOOTER = 2
_COMPUTED = re.compile(r"\b(generated|as|virtual|view|trigger)\b", re.IGNORECASE)


class DamagedBagError(ValueError):
    """The records of a file are not those of a whole bag."""


def check_bag(path: Path) -> None:
    """Refuse a ROS 1 bag whose chunks declare too much, or that is damaged.

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
        for at, fields, size in _bag_records(file):
            places.add(at)
            kind = fields["op"][0]
            if kind == _BAG_HEADER:
                (index,) = struct.unpack("<Q", fields["index_pos"])
            elif kind == _CHUNK:
                (stated,) = struct.unpack("<I", fields["size"])
                _refuse_large_chunk(size, stated)
                _check_decoded(_whole(file, size), fields["compression"].decode(), stated)
                chunks[at] = False
            elif kind == _CHUNK_INFO:
                (place,) = struct.unpack("<Q", fields["chunk_pos"])
                _mark_indexed(chunks, place)
            elif kind == _MSG_DATA:
                raise DamagedBagError("a message outside the chunks")
    if index not in places or not all(chunks.values()):
        raise DamagedBagError("it has no complete index, as after a crash: run rosbag reindex")


def _bag_records(file: BinaryIO) -> Iterator[tuple[int, dict[str, bytes], int]]:
    """Yield place, fields and data size of each record; the file stands at the data."""
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
        yield at, fields, size
        _skip_to(file, after)


def check_mcap(path: Path) -> None:
    """Refuse an MCAP file whose chunks declare too much, or that is damaged.

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
        for at, kind, size in _mcap_records(file):
            places.add(at)
            kinds.add(kind)
            if kind == _MCAP_CHUNK:
                *_, stated, _ = struct.unpack("<QQQI", _whole(file, 28))
                compression = _whole(file, struct.unpack("<I", _whole(file, 4))[0]).decode()
                (packed,) = struct.unpack("<Q", _whole(file, 8))
                if packed > size:
                    raise DamagedBagError("a chunk larger than its record")
                _refuse_large_chunk(packed, stated)
                _check_decoded(_whole(file, packed), compression, stated)
                chunks[at] = False
            elif kind == _MCAP_CHUNK_INDEX:
                *_, place, _ = struct.unpack("<QQQQ", _whole(file, 32))
                _mark_indexed(chunks, place)
            elif kind == _MCAP_FOOTER:
                (summary,) = struct.unpack("<Q", _whole(file, 8))
    needed = {_MCAP_SCHEMA, _MCAP_STATISTICS}
    if summary not in places or (chunks and not (all(chunks.values()) and needed <= kinds)):
        raise DamagedBagError("it has no complete index, as after a crash: run mcap recover")


def _mcap_records(file: BinaryIO) -> Iterator[tuple[int, int, int]]:
    """Yield place, kind and size of each record; the file stands at its content."""
    while True:
        at = file.tell()
        head = file.read(9)
        if head.startswith(MCAP):
            return
        if len(head) < 9:
            raise DamagedBagError("it is cut off, as after a crash: run mcap recover")
        kind, size = struct.unpack("<BQ", head)
        after = file.tell() + size
        yield at, kind, size
        _skip_to(file, after)


def check_sqlite(path: Path) -> None:
    """Refuse a database whose rows are computed, of which a small file can hold any number.

    Raises
    ------
    DamagedBagError
        With what is wrong.
    """
    address = f"file:{quote(str(path.absolute()))}?mode=ro&immutable=1"
    try:
        with closing(sqlite3.connect(address, uri=True)) as database:
            made = database.execute("SELECT type, sql FROM sqlite_master").fetchall()
            (state,) = database.execute("PRAGMA quick_check(1)").fetchone()
    except sqlite3.Error as error:
        raise DamagedBagError(str(error)) from error
    for kind, text in made:
        if kind not in ("table", "index") or _COMPUTED.search(text or ""):
            raise DamagedBagError(f"it holds a {kind} that ROS does not write")
    if state != "ok":
        raise DamagedBagError(str(state))


def _mark_indexed(chunks: dict[int, bool], place: int) -> None:
    if chunks.get(place, True):
        raise DamagedBagError("its index names a chunk twice, or one that it does not hold")
    chunks[place] = True


def _whole(file: BinaryIO, size: int) -> bytes:
    """Return bytes; refuse a file that ends before."""
    raw = file.read(size)
    if len(raw) < size:
        raise DamagedBagError("it is cut off, as after a crash")
    return raw


def _skip_to(file: BinaryIO, place: int) -> None:
    """Go to a place; refuse a file that ends before it."""
    if place:
        file.seek(place - 1)
        _whole(file, 1)


def _refuse_large_chunk(packed: int, stated: int) -> None:
    """Refuse a chunk that is too large, before it is read."""
    if max(packed, stated) > _LARGEST_CHUNK:
        raise DamagedBagError(
            f"a chunk of {max(packed, stated) / 1e6:.0f} MB, and at most "
            f"{_LARGEST_CHUNK / 1e6:.0f} MB are read"
        )


def _check_decoded(packed: bytes, compression: str, stated: int) -> None:
    """Refuse a chunk whose decoded size is not the stated one."""
    if compression in ("", "none"):
        size = len(packed)
    else:
        size = _decoded_size(packed, _decoder(compression, packed, stated), stated)
    if size != stated:
        raise DamagedBagError(f"a chunk has {size} bytes or more where it states {stated}")


def _decoder(compression: str, packed: bytes, stated: int) -> Callable[[], Any]:
    """Return what makes a decoder of one frame."""
    if compression == "bz2":
        return bz2.BZ2Decompressor
    if compression == "lz4":
        lz4: Any = import_module("lz4.frame")
        # A frame may state its size too, for which memory is taken at once.
        if lz4.get_frame_info(packed)["content_size"] > stated:
            raise DamagedBagError("a chunk states two sizes")
        return lz4.LZ4FrameDecompressor
    if compression == "zstd":
        return _zstd().ZstdDecompressor
    raise DamagedBagError(f"compression {compression!r} is not known")


def _zstd() -> Any:
    """Return the library that rosbags uses too; Python has it from 3.14 on."""
    return import_module("compression.zstd" if sys.version_info >= (3, 14) else "backports.zstd")


def decode_message(packed: bytes) -> bytes:
    """Return a message that was compressed by itself.

    Raises
    ------
    DamagedBagError
        It is larger than messages that are read here.
    """
    decoder = _zstd().ZstdDecompressor()
    raw: bytes = decoder.decompress(packed, _LARGEST_MESSAGE)
    if not decoder.eof:
        raise DamagedBagError(f"a message of more than {_LARGEST_MESSAGE} bytes, or cut off")
    return raw


def _decoded_size(packed: bytes, make: Callable[[], Any], stated: int) -> int:
    """Return the size of the decoded frames; it stops beyond the stated size."""
    size = 0
    while packed:
        decoder = make()
        while not decoder.eof and size <= stated:
            part = decoder.decompress(packed, _STEP)
            if not part and decoder.needs_input:
                raise DamagedBagError("a chunk ends before its data")
            size, packed = size + len(part), b""
        if size > stated:
            return size
        packed = decoder.unused_data or b""
    return size
