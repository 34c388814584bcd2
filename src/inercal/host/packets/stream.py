"""Decodes the bytes from a device into readings, as they arrive or from a file.

The resulting packets are exactly the same, however the bytes are divided. Invalid bytes cause no
error; they are discarded and counted.

Counters and clocks that wrap are unwrapped, and their steps show lost packets.
"""

from collections.abc import Iterable
from copy import copy
from dataclasses import dataclass, fields
from enum import IntFlag
from math import isfinite
from operator import add
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from inercal.basics.arrays import Array, Bools
from inercal.basics.errors import InputError
from inercal.basics.units import format_count
from inercal.host.packets.layout import PacketLayout
from inercal.host.packets.packet_finder import DecodedPackets, Raw, find_lines, find_packets
from inercal.host.packets.packet_format import AXES, BinaryFrame, TextLine

_MAX_STEP = 2.0**62  # a longer step cannot be correct


class Flag(IntFlag):
    """Properties of a packet that its user needs to know."""

    SATURATED = 1  # a reading is at its full scale
    INVALID = 2  # the device marks a reading as invalid; the reading is NaN
    GAP = 4  # packets were lost before this packet
    REPEATED = 8  # same counter as in the previous packet
    OUT_OF_ORDER = 16  # counter is smaller than in the previous packet
    STATUS = 32  # the device's status does not indicate good data


def flag_array(where: Bools, flag: Flag) -> NDArray[np.uint8]:
    """Return an array that has a flag where a condition is true."""
    return where.astype(np.uint8) * np.uint8(flag)


@dataclass
class CounterUnwrapper:
    """Unwraps the raw counter or clock of one stream.

    Parameters
    ----------
    modulus : float
        Value at which the counter wraps around to 0; 0 if it never does.
    step : float
        Step from packet to packet; 0 if unknown. Unknown steps are not checked.
    """

    modulus: float
    step: float
    _last: float | int | None = None
    _wrap_count: int = 0

    def unwrap(self, raw: NDArray[Any]) -> tuple[NDArray[Any], NDArray[np.uint8], int]:
        """Return unwrapped values, (n,), flags of packets, (n,), and the number of lost packets.

        A step of half the modulus or more is assumed to be a step backward.

        Parameters
        ----------
        raw : (n,) array of int64 or float64
            Values that follow the values of the previous call.
        """
        flags = np.zeros(raw.size, np.uint8)
        if not raw.size:
            return raw, flags, 0
        before = np.concatenate([raw[:1] if self._last is None else [self._last], raw[:-1]])
        step = np.subtract(raw, before, dtype=np.float64)
        # In an invalid packet, a real-valued clock may be NaN or absurdly large.
        step = np.where(np.abs(step) < _MAX_STEP, step, 0.0)
        values = raw
        if self.modulus:
            # Whole turns are counted, and steps are not added up, so the values of a clock stay
            # exact.
            turns = np.floor(0.5 - step / self.modulus).astype(np.int64)
            step += turns * self.modulus
            total = self._wrap_count + np.cumsum(turns)
            values = raw + total * raw.dtype.type(self.modulus)
            self._wrap_count = int(total[-1])
        known = slice(1 if self._last is None else 0, None)
        self._last = raw[-1]
        if not self.step:
            return values, flags, 0
        passed = np.rint(step[known] / self.step)
        flags[known] |= flag_array(passed > 1, Flag.GAP)
        flags[known] |= flag_array(step[known] == 0, Flag.REPEATED)
        flags[known] |= flag_array(step[known] < 0, Flag.OUT_OF_ORDER)
        return values, flags, int(np.sum(np.maximum(passed - 1, 0)))


Number = TypeVar("Number", np.int64, np.float64)
_BLOCK_SIZE = 1 << 20  # bytes at a time; intermediate results stay in the CPU cache


@dataclass(frozen=True)
class PacketCounts:
    """Counts of packets by outcome (accepted, checksum error, lost, late).

    Parameters
    ----------
    packets : int
        Number of accepted packets.
    discarded : int
        Number of bytes that belong to no packet.
    failed : int
        Number of packets with the correct form but a wrong checksum. Their bytes are also counted
        in `discarded`.
    lost : int
        Number of packets that are missing according to the counter or, without a counter, to the
        time.
    repeated, out_of_order : int
        Number of packets with the same counter as the previous packet, and with a smaller counter.
    """

    packets: int = 0
    discarded: int = 0
    failed: int = 0
    lost: int = 0
    repeated: int = 0
    out_of_order: int = 0

    def __add__(self, other: "PacketCounts") -> "PacketCounts":
        return PacketCounts(*map(add, vars(self).values(), vars(other).values()))


@dataclass(frozen=True, eq=False)
class Packets:
    """The readings in packets, in SI.

    Parameters
    ----------
    readings : (n, 6) array
        ax, ay, az in m/s², and gx, gy, gz in rad/s; NaN if missing or invalid.
    counter : (n,) array of int or None
        Unwrapped counter; None if the packets have none.
    time : (n,) array or None
        Unwrapped time by the device's clock, s; None if the packets have none.
    temperature : (n,) array
        Temperature in K; NaN if a packet does not contain it.
    status : (n,) array of int
        Status of the device; 0 if a packet does not contain it.
    flags : (n,) array of uint8
        Bits of `Flag`.
    """

    readings: Array
    counter: NDArray[np.int64] | None
    time: Array | None
    temperature: Array
    status: NDArray[np.int64]
    flags: NDArray[np.uint8]

    def __len__(self) -> int:
        return self.flags.size


def join_packets(parts: Iterable[Packets]) -> Packets:
    """Concatenate packets from one stream.

    Raises
    ------
    InputError
        There are no parts.
    """
    parts = list(parts)
    if not parts:
        raise InputError("parts is empty; give at least one object of packets", key="parts")
    columns: dict[str, Any] = {}
    for one in fields(Packets):
        there = [column for part in parts if (column := getattr(part, one.name)) is not None]
        columns[one.name] = np.concatenate(there) if there else None
    return Packets(**columns)


class Decoder:
    r"""Decodes the packets in one stream.

    Parameters
    ----------
    layout : PacketLayout
    mid_stream : bool
        Whether the first byte may be in the middle of a packet. If so, and if lines have no
        checksum, the first line is dropped, because a truncated "123.4" would be read as "3.4".
    time_zero : int, float or None
        Raw time of the device that becomes time 0. If None, it is the time of the first packet. A
        time zero is needed because float64 has too few digits for times since 1970.

    Attributes
    ----------
    counts : PacketCounts
        Counts so far.
    time_zero : int, float or None
        Raw time of the device at time 0; None only before the first packet.
    pending : int
        Number of bytes that may belong to an incomplete packet.

    Examples
    --------
    >>> from inercal.host.packets import read_layout
    >>> decoder = Decoder(read_layout("ascii"))
    >>> decoder.feed(b"7,0.5,0.1,0.2,9.8,0,0,0,25.0\r\n8,").readings[:, 2]
    array([9.8])
    >>> decoder.pending
    2
    """

    def __init__(
        self, layout: PacketLayout, mid_stream: bool = False, time_zero: int | float | None = 0
    ):
        self.layout, self.time_zero = layout, time_zero
        self.counts = PacketCounts()
        self._buffer = b""
        first = layout.frames[0]
        self._skip_line = (
            mid_stream and isinstance(first, TextLine) and first.accepts_truncated_lines
        )
        told = layout.sequence
        self._sequences = {
            role: CounterUnwrapper(modulus, layout.step if role == told else 0.0)
            for role, modulus in layout.wraps.items()
        }

    @property
    def pending(self) -> int:
        """Number of bytes that are kept for an incomplete packet."""
        return len(self._buffer)

    def copy(self) -> "Decoder":
        """Return an independent decoder that continues from here."""
        made = copy(self)
        made._sequences = {role: copy(one) for role, one in self._sequences.items()}
        return made

    def feed(self, data: bytes) -> Packets:
        """Return the packets that are now complete; this never raises an error."""
        if len(data) > _BLOCK_SIZE:
            cuts = range(0, len(data), _BLOCK_SIZE)
            return join_packets(self.feed(data[cut : cut + _BLOCK_SIZE]) for cut in cuts)
        if self._skip_line:
            skipped = data.find(b"\n") + 1 or len(data)
            self._skip_line = not data[:skipped].endswith(b"\n")
            self.counts += PacketCounts(discarded=skipped)
            data = data[skipped:]
        buffer = self._buffer + bytes(data)
        first, *_ = frames = self.layout.frames
        if isinstance(first, TextLine):
            found = find_lines(buffer, first)
        else:
            found = find_packets(buffer, tuple(f for f in frames if isinstance(f, BinaryFrame)))
        self._buffer = buffer[found.consumed_bytes :]
        return self._convert_packets(found)

    @np.errstate(invalid="ignore", over="ignore")  # real numbers may be NaN or absurdly large
    def _convert_packets(self, found: DecodedPackets) -> Packets:
        """Convert packets to SI, and count them."""
        n, layout, raw = found.packets, self.layout, found.raw
        flags = np.zeros(n, np.uint8)
        readings = np.full((n, len(AXES)), np.nan)
        signs = {field.role: field.sign for frame in layout.frames for field in frame.fields}
        temperature = np.full(n, np.nan)
        for role, column in zip((*AXES, "temperature"), (*readings.T, temperature), strict=True):
            if role in raw:
                flags |= _scale_channel(layout, role, signs[role], raw[role], column)
        status, stated = np.zeros(n, np.int64), np.zeros(n, bool)
        if "status" in raw:
            stated = np.isfinite(raw["status"])  # some kinds of packets have no status
            status[stated] = raw["status"][stated].astype(np.int64)
        mask, good = layout.status_good
        flags |= flag_array(stated & (status & mask != good), Flag.STATUS)
        counter = self._unwrap_column("counter", raw, np.int64, flags)
        if "time" in raw:
            raw = {**raw, "time": self._since_zero(raw["time"])}
        ticks = self._unwrap_column("time", raw, np.float64, flags)
        self.counts += PacketCounts(
            packets=n,
            discarded=found.consumed_bytes - found.packet_bytes,
            failed=found.failed,
            repeated=_count_flag(flags, Flag.REPEATED),
            out_of_order=_count_flag(flags, Flag.OUT_OF_ORDER),
        )
        time = None if ticks is None else ticks * layout.time.size
        return Packets(readings, counter, time, temperature, status, flags)

    def _since_zero(self, raw: NDArray[Any]) -> NDArray[Any]:
        """Return the raw times relative to the time zero."""
        whole = raw.astype(np.int64 if raw.dtype.kind in "iu" else np.float64)
        if self.time_zero is None and whole.size:
            first = whole[0].item()
            self.time_zero = first if isfinite(first) else 0
        return whole - self.time_zero if self.time_zero else whole

    def _unwrap_column(
        self, role: str, raw: Raw, kind: type[Number], flags: NDArray[np.uint8]
    ) -> NDArray[Number] | None:
        """Unwrap a counter or clock, and flag and count missing packets."""
        if role not in raw:
            return None
        values, own_flags, lost = self._sequences[role].unwrap(raw[role].astype(kind))
        flags |= own_flags
        self.counts += PacketCounts(lost=lost)
        return values


def read_log(path: str | Path, layout: PacketLayout) -> tuple[Packets, PacketCounts]:
    """Read a file with the bytes from a device; return its packets and counts by outcome.

    Parameters
    ----------
    path : path
    layout : PacketLayout

    Returns
    -------
    packets : Packets
    counts : PacketCounts
        Counts by outcome; the discarded bytes include an incomplete packet at the end.

    Raises
    ------
    InputError
        The file cannot be read, or contains no packet.
    """
    decoder = Decoder(layout)
    try:
        with Path(path).open("rb") as file:
            parts = [decoder.feed(chunk) for chunk in iter(lambda: file.read(_BLOCK_SIZE), b"")]
    except OSError as error:
        raise InputError(
            f"{path}: the log cannot be read: {error.strerror or error}", file=path
        ) from None
    counts = decoder.counts + PacketCounts(discarded=decoder.pending)
    if not counts.packets:
        raise InputError(
            f"{path}: {counts.discarded} bytes contain no packet of {layout.name!r}"
            + (f"; {format_count(counts.failed, 'checksum error')}" if counts.failed else "")
            + "; choose the preset or layout of the IMU that sent them",
            file=path,
            names=(layout.name,),
        )
    return join_packets(parts), counts


def _count_flag(flags: NDArray[np.uint8], flag: Flag) -> int:
    return int(np.count_nonzero(flags & flag))


def _scale_channel(
    layout: PacketLayout, role: str, sign: float, raw: NDArray[Any], out: Array
) -> NDArray[np.uint8]:
    """Write a channel to `out`, in SI, and return its flags."""
    scale = layout.scale(role)
    np.multiply(raw, sign * scale.size, out=out, casting="unsafe")
    if scale.zero:
        out += scale.zero
    flags = np.zeros(out.size, np.uint8)
    if np.isfinite(scale.full_scale):
        field = next(f for frame in layout.frames for f in frame.fields if f.role == role)
        # The rounding error of 32-bit floats is 6e-8 of the value.
        margin = max(1.001 * layout.resolution(field), 1e-6 * scale.full_scale)
        flags |= flag_array(np.abs(out) >= scale.full_scale - margin, Flag.SATURATED)
    if scale.invalid or raw.dtype.kind == "f":
        invalid = ~np.isfinite(out)
        if scale.invalid:
            invalid |= np.isin(raw, scale.invalid)
        out[invalid] = np.nan
        if role != "temperature":
            flags |= flag_array(invalid, Flag.INVALID)
    return flags
