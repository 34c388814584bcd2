"""Readings, times and temperatures that every preset can carry, and the bytes of them."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from inercal.host.packets import Decoder, PacketCounts, PacketLayout, Packets, encode, join_packets
from inercal.host.packets.packet_format import BinaryFrame

Bytes = NDArray[np.uint8]


def motion(layout: PacketLayout, n: int, seed: int = 1) -> dict[str, Any]:
    """Return what `encode` takes; every tenth packet has a temperature where some may lack it."""
    random = np.random.default_rng(seed)
    readings = np.hstack([random.normal(0, 9, (n, 3)), random.normal(0, 1, (n, 3))])
    temperature = np.full(n, 298.15)
    if len(layout.frames) > 1:
        temperature[np.arange(n) % 10 != 3] = np.nan
    period = 1 / (layout.rate_hz or 100.0)
    return {"readings": readings, "time": np.arange(n) * period, "temperature": temperature}


def fed(layout: PacketLayout, *pieces: bytes) -> tuple[Packets, PacketCounts]:
    """Return the packets of a stream that comes in pieces, and what became of its bytes."""
    decoder = Decoder(layout)
    packets = join_packets([decoder.feed(piece) for piece in pieces])
    return packets, decoder.counts


def same(one: Packets, other: Packets) -> bool:
    """Whether all arrays are the same bit for bit."""
    return all(
        np.array_equal(np.asarray(a), np.asarray(b), equal_nan=np.asarray(a).dtype.kind == "f")
        for a, b in zip(vars(one).values(), vars(other).values(), strict=True)
    )


def random_frames(layout: PacketLayout, n: int, seed: int = 2) -> bytes:
    """Return packets of the first kind whose bytes are random but for the fixed ones."""
    frame = layout.frames[0]
    assert isinstance(frame, BinaryFrame)
    rows = np.random.default_rng(seed).integers(0, 256, (n, frame.length), np.uint8)
    for offset, value in frame.constants:
        rows[:, offset] = value
    return rows.tobytes()


def mutated(layout: PacketLayout, n: int, changes: int, seed: int = 3) -> bytes:
    """Return packets, 20000 different ones over and over, each with some bytes changed."""
    random = np.random.default_rng(seed)
    given = motion(layout, 20_000)
    if len(layout.frames) > 1:
        given["temperature"] = np.full(20_000, np.nan)
    data = np.tile(np.frombuffer(encode(layout, **given), np.uint8), n // 20_000)
    frame = next(iter(layout.frames))
    ends = (
        np.arange(1, n + 1) * frame.length
        if isinstance(frame, BinaryFrame)
        else np.flatnonzero(data == ord("\n")) + 1
    )
    lengths = np.diff(ends, prepend=0)
    first, step = random.integers(0, lengths), random.integers(1, lengths // changes)
    for k in range(changes):  # at places that differ, for k · step is below the length
        data[ends - lengths + (first + k * step) % lengths] ^= random.integers(1, 256, n, np.uint8)
    return data.tobytes()
