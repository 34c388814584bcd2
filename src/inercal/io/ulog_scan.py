"""A first pass over a ULog file: its topics, and whether its messages are whole.

pyulog flattens nested formats and steps over damage byte by byte, so that few bytes can cost much
memory. What this pass accepts has known messages, one after the other, and formats of bounded size.

Source: the ULog file format, https://docs.px4.io/main/en/dev_log/ulog_file_format.html
"""

import struct
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import BinaryIO

from inercal.errors import InputError
from inercal.io.column_table import MOST_COLUMNS, shorten

HEADER = b"ULog\x01\x12\x35"
_HEADER_BYTES = 16
_KNOWN = frozenset(b"BFIMPQARDLCSO")
_NUMBERS = frozenset(
    [f"{u}int{bits}_t" for u in ("", "u") for bits in (8, 16, 32, 64)]
    + ["float", "double", "bool", "char"]
)
_MOST_SUBSCRIPTIONS = 1000

Fields = list[tuple[str, int]]


def scan_topics(path: Path) -> dict[str, int]:
    """Return the bytes of readings of each topic of a ULog file: "sensor_accel", "sensor_accel[1]".

    Raises
    ------
    InputError
        A damaged file, or a format that stands for more than `MOST_COLUMNS` numbers.
    OSError
        The file cannot be read.
    """
    formats: dict[str, Fields] = {}
    sizes: dict[str, int] = {}
    topics: dict[bytes, str] = {}  # by the number that readings begin with
    read: dict[str, int] = {}
    for at, kind, body, size in _messages(path):
        try:
            if kind == b"F":
                name, _, fields = body.decode("ascii").partition(":")
                formats[name] = [_field(one) for one in fields.split(";") if one]
            elif kind == b"A":
                topic = topic_name(body[3:].decode("ascii"), body[0])
                _refuse_large(body[3:].decode("ascii"), formats, sizes)
                topics[body[1:3]] = topic
                read.setdefault(topic, 0)
            elif kind == b"D" and body in topics:
                read[topics[body]] += size
        except (ValueError, LookupError, RecursionError) as error:
            raise _damaged(path, at, shorten(str(error), 80)) from error
        if len(topics) > _MOST_SUBSCRIPTIONS:
            raise _damaged(path, at, f"more than {_MOST_SUBSCRIPTIONS} topics")
    return read


def topic_name(name: str, instance: int) -> str:
    """Return the name of a topic here: instances other than 0 have their number in brackets."""
    return f"{name}[{instance}]" if instance else name


def _damaged(path: Path, at: int, why: str) -> InputError:
    return InputError(
        f"{path.name} is not a ULog file or is damaged at byte {at}: {why}; copy it from the "
        "flight controller again"
    )


def _messages(path: Path) -> Iterator[tuple[int, bytes, bytes, int]]:
    """Yield place, type, body and size of each message; of readings the number of their topic.

    The last message may be cut off: so ends a log when power is lost.
    """
    with path.open("rb") as file:
        if file.read(_HEADER_BYTES)[: len(HEADER)] != HEADER:
            raise _damaged(path, 0, "it does not begin as a ULog file")
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
                yield at, bytes([kind]), body[:2] if kind == ord("D") else body, size
            if end is not None:
                file.seek(end)


def _part_ends(path: Path, file: BinaryIO) -> list[int | None]:
    """Return where parts end that were appended after a crash; None for the end of the file."""
    head = file.read(3 + 40)
    file.seek(_HEADER_BYTES)
    if len(head) < 43 or head[2:3] != b"B":
        return [None]
    (appended,) = struct.unpack_from("<B", head, 3 + 8)
    offsets = [k for k in struct.unpack_from("<3Q", head, 3 + 16) if k] if appended & 1 else []
    if sorted(offsets) != offsets or any(k > path.stat().st_size for k in offsets):
        raise _damaged(path, _HEADER_BYTES, "places of appended data outside the file")
    return [*offsets, None]


def _field(text: str) -> tuple[str, int]:
    """Return type and count of a field such as "float[3] gyro_rad"."""
    kind, _, name = text.partition(" ")
    if not name:
        raise ValueError(f"field {text!r} has no name")
    base, bracket, count = kind.partition("[")
    return base, int(count.removesuffix("]")) if bracket else 1


def _refuse_large(name: str, formats: Mapping[str, Fields], sizes: dict[str, int]) -> None:
    """Refuse a format that stands for more numbers than any topic has."""
    if _size(name, formats, sizes) > MOST_COLUMNS:
        raise ValueError(f"topic {name!r} has more than {MOST_COLUMNS} numbers")


def _size(name: str, formats: Mapping[str, Fields], sizes: dict[str, int]) -> int:
    """Return how many numbers a format stands for, those of nested formats included."""
    if name not in sizes:
        sizes[name] = sum(
            count * (1 if kind in _NUMBERS else _size(kind, formats, sizes))
            for kind, count in formats[name]
        )
    return sizes[name]
