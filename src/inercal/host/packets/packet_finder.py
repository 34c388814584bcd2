"""Finds binary packets or lines of text in a buffer that may also contain other bytes.

A binary packet may begin at any byte. The search goes from left to right. A packet is accepted if
its fixed bytes and its checksums are correct and it does not overlap an earlier accepted packet.
The result depends only on the bytes, not on how they were divided. A stream without errors is
decoded directly; a search is only necessary after the first flaw.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from inercal.basics.arrays import Bools, Indices
from inercal.host.packets.checksums import Bytes
from inercal.host.packets.packet_format import BinaryFrame, TextLine

Raw = dict[str, NDArray[Any]]


class DecodedPackets(NamedTuple):
    """Packets found in a buffer.

    Parameters
    ----------
    raw : mapping of str to (n,) array
        Raw values by role, in the order of the packets; NaN if a packet does not contain the role.
    packets : int
        Number of packets, n.
    packet_bytes, consumed_bytes : int
        Number of bytes in packets, and number of bytes that need not be searched again.
    failed : int
        Number of packets with correct fixed bytes but a wrong checksum.
    """

    raw: Raw
    packets: int
    packet_bytes: int
    consumed_bytes: int
    failed: int


def find_packets(buffer: bytes, frames: tuple[BinaryFrame, ...]) -> DecodedPackets:
    """Return the packets in a buffer.

    Parameters
    ----------
    buffer : bytes
        The bytes that follow the bytes consumed from the previous buffer.
    frames : tuple of Frame
        Packets that the stream may contain; the first that matches is accepted.
    """
    data = np.frombuffer(buffer, np.uint8)
    first = frames[0]
    lead = _count_leading_packets(data, first)
    starts, kinds, used, failed = _search_packets(data, frames, lead * first.length)
    parts = [(np.arange(lead) * first.length, first, np.frombuffer(buffer, first.dtype, lead))]
    for k, frame in enumerate(frames):
        at = starts[kinds == k]
        if at.size:
            rows = sliding_window_view(data, frame.length)[at]
            parts.append((at, frame, rows.view(frame.dtype)[:, 0]))
    parts = [part for part in parts if part[0].size] or parts[:1]
    order = np.argsort(np.concatenate([part[0] for part in parts])) if len(parts) > 1 else None
    raw: Raw = {}
    for role in {role: None for frame in frames for role in frame.byte_orders}:
        pieces = [_values(records, frame, role) for _, frame, records in parts]
        raw[role] = pieces[0] if order is None else np.concatenate(pieces)[order]
    taken = sum(part[0].size * part[1].length for part in parts)
    return DecodedPackets(raw, sum(part[0].size for part in parts), taken, used, failed)


def _values(records: NDArray[Any], frame: BinaryFrame, role: str) -> NDArray[Any]:
    """Return the raw values of a role."""
    if role not in frame.byte_orders:
        return np.full(records.size, np.nan)
    values = records[role]
    if values.ndim == 1:
        return values
    order = (2, 1, 0) if frame.byte_orders[role] == "big" else (0, 1, 2)  # order of the three bytes
    low, middle, high = (values[:, k].astype(np.int32) for k in order)
    joined = low | middle << 8 | high << 16
    signed = next(field.type[0] == "i" for field in frame.fields if field.role == role)
    return (joined ^ 0x800000) - 0x800000 if signed else joined


def _count_leading_packets(data: Bytes, frame: BinaryFrame) -> int:
    """Return the number of successive valid packets, beginning at the first byte."""
    n = data.size // frame.length
    rows = data[: n * frame.length].reshape(n, frame.length)
    good = np.ones(n, bool)
    for offset, value in frame.constants:
        good &= rows[:, offset] == value
    n = n if good.all() else int(np.argmin(good))
    good = _valid_checks(data, np.arange(n) * frame.length, frame)
    return n if good.all() else int(np.argmin(good))


def _valid_checks(data: Bytes, starts: Indices, frame: BinaryFrame) -> Bools:
    """Return which packets have correct checksums."""
    good = np.ones(starts.size, bool)
    for check in frame.checks:
        value = np.zeros(starts.size, np.uint32)
        places = range(check.at, check.at + check.kind.bits // 8)
        for place in places if check.order == "big" else reversed(places):
            value = value << np.uint32(8) | data[starts + place]
        good &= check.kind.span_checks(data, starts + check.start, starts + check.at) == value
    return good


def _search_packets(
    data: Bytes, frames: tuple[BinaryFrame, ...], begin: int
) -> tuple[Indices, Indices, int, int]:
    """Return starts and kinds of packets after `begin`, bytes used, and failed packets."""
    found, open_at = list[tuple[Indices, Indices, Bools]](), list[Indices]()
    for k, frame in enumerate(frames):
        starts = np.flatnonzero(data[begin:] == frame.constants[0][1]) + begin
        for offset, value in frame.constants[1:]:
            # Bytes beyond the end of the buffer are still unknown, so they cannot exclude a packet.
            there = data[np.minimum(starts + offset, data.size - 1)]
            starts = starts[(there == value) | (starts + offset >= data.size)]
        whole = starts + frame.length <= data.size
        open_at.append(starts[~whole])
        starts = starts[whole]
        found.append((starts, np.full(starts.size, k), _valid_checks(data, starts, frame)))
    starts, kinds, good = (np.concatenate(column) for column in zip(*found, strict=True))
    order = np.argsort(starts, kind="stable")
    starts, kinds, good = starts[order], kinds[order], good[order]
    lengths = np.array([frame.length for frame in frames])
    kept = np.flatnonzero(good)
    kept = kept[_select_disjoint(starts[kept], lengths[kinds[kept]])]
    # As long as bytes outside packets may become a packet, later bytes are not decided.
    undecided = np.concatenate(open_at)
    undecided = undecided[~_inside_packet(undecided, starts[kept], lengths[kinds[kept]])]
    waiting = int(undecided.min()) if undecided.size else data.size
    kept = kept[starts[kept] < waiting]
    bad = starts[~good & (starts < waiting)]
    failed = int(np.sum(~_inside_packet(bad, starts[kept], lengths[kinds[kept]])))
    return starts[kept], kinds[kept], waiting, failed


def _select_disjoint(starts: Indices, lengths: Indices) -> Bools:
    """Return which packets remain if each packet excludes packets that begin inside it."""
    keep = np.ones(starts.size, bool)
    if np.all(np.diff(starts) >= lengths[:-1]):
        return keep
    free = 0
    for k, (start, length) in enumerate(zip(starts.tolist(), lengths.tolist(), strict=True)):
        keep[k] = start >= free
        if keep[k]:
            free = start + length
    return keep


def _inside_packet(places: Indices, starts: Indices, lengths: Indices) -> Bools:
    """Return which positions are inside a packet."""
    if not starts.size:
        return np.zeros(places.size, bool)
    before = np.searchsorted(starts, places, side="right") - 1
    return (before >= 0) & (places < starts[before] + lengths[before])


# A longer line cannot be valid, because a line has at most 40 fields of at most 64 characters, with
# separators. The end of such a line is kept; it is also too long to be mistaken for a line.
_MAX_LINE = 4096


def find_lines(buffer: bytes, line: TextLine) -> DecodedPackets:
    """Return the lines in a buffer that match the line format and have a correct checksum.

    Parameters
    ----------
    buffer : bytes
        The bytes that follow the bytes consumed from the previous buffer.
    line : TextLine
    """
    matches = line.pattern.findall(buffer)
    failed = 0
    if line.checks and matches:
        good = _valid_line_checks(line, matches)
        failed = len(matches) - int(good.sum())
        matches = [match for match, right in zip(matches, good.tolist(), strict=True) if right]
    columns = list(zip(*matches, strict=True)) or [()] * line.pattern.groups
    raw: Raw = {}
    for field in line.fields:
        texts = columns[field.at - 1]
        if field.type[-1] == "x":
            raw[field.role] = np.array([int(text, 16) for text in texts], np.int64)
        else:
            kind = np.int64 if field.type == "d" else np.float64
            raw[field.role] = np.array(texts, dtype=bytes).astype(kind)
    used = max(buffer.rfind(b"\n") + 1, len(buffer) - _MAX_LINE)
    taken = sum(map(len, columns[0])) + sum(map(len, columns[-1]))
    if line.checks:
        separator = 1
        taken += len(matches) * (separator + line.checks[0].kind.bits // 4)
    return DecodedPackets(raw, len(matches), taken, used, failed)


def _valid_line_checks(line: TextLine, matches: list[tuple[bytes, ...]]) -> Bools:
    """Return which lines have correct checksums."""
    (check,) = line.checks
    covered = np.frombuffer(b"".join(match[0] for match in matches), np.uint8)
    stop = np.cumsum([len(match[0]) for match in matches], dtype=np.int64)
    start = np.concatenate([[0], stop[:-1]]).astype(np.int64) + check.start
    stated = np.array([int(match[check.at - 1], 16) for match in matches], np.uint32)
    return check.kind.span_checks(covered, start, stop) == stated
