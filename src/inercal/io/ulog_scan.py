"""A first pass over a ULog file: its topics, and whether its messages are whole.

pyulog steps over damage byte by byte. What this pass accepts has known messages, one after the
other.

Source: the ULog file format, https://docs.px4.io/main/en/dev_log/ulog_file_format.html
"""

import struct
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

from inercal.errors import InputError
from inercal.io.column_table import shorten

HEADER = b"ULog\x01\x12\x35"
_HEADER_BYTES = 16
_KNOWN = frozenset(b"BFIMPQARDLCSO")


def scan_topics(path: Path) -> list[str]:
    """Return the topics of a ULog file: "sensor_accel", "sensor_accel[1]".

    Raises
    ------
    InputError
        A damaged file.
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
    """Return the name of a topic here: instances other than 0 have their number in brackets."""
    return f"{name}[{instance}]" if instance else name


def _damaged(path: Path, at: int, why: str) -> InputError:
    return InputError(
        f"{path.name} is not a ULog file or is damaged at byte {at}: {why}; copy it from the "
        "flight controller again"
    )


def _messages(path: Path) -> Iterator[tuple[int, bytes, bytes]]:
    """Yield place, type and body of each message.

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
                yield at, bytes([kind]), body
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
