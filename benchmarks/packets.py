"""A log of binary packets to readings in SI: a million of 36 bytes, each with a CRC of 16 bits.

The peer is what one writes first: `struct` and `binascii` in a loop over the packets, which takes
them to follow one another without a flaw, where ours looks for them.
"""

import binascii
import struct

import numpy as np
from numpy.typing import NDArray

from benchmarks import Row, best
from inercal.host.packets import Decoder, encode, read_layout

PACKETS, PEER_PACKETS = 1_000_000, 20_000
LAYOUT = read_layout("fixed")
PACKET = struct.Struct("<2sH6ihIH")


def log() -> bytes:
    """Return the bytes of all packets."""
    readings = np.random.default_rng(0).normal(0, 5, (PACKETS, 6))
    return encode(LAYOUT, readings, temperature=np.full(PACKETS, 300.0))


def ours(data: bytes) -> NDArray[np.float64]:
    """Return the readings of all packets, (n, 6)."""
    return Decoder(LAYOUT).feed(data).readings


def peer(data: bytes) -> NDArray[np.float64]:
    """Return the same, packet by packet."""
    scale = [LAYOUT.accelerometer.size] * 3 + [LAYOUT.gyro.size] * 3
    rows: list[list[float]] = []
    for at in range(0, len(data), PACKET.size):
        sync, _, *raw, _, _, check = PACKET.unpack_from(data, at)
        if sync == b"\xaa\x55" and binascii.crc_hqx(data[at + 2 : at + 34], 0xFFFF) == check:
            rows.append([value * size for value, size in zip(raw, scale, strict=True)])
    return np.array(rows)


def rows() -> list[Row]:
    """Compare the readings, then the times; the peer's for as many packets by proportion."""
    data = log()
    few = data[: PEER_PACKETS * PACKET.size]
    np.testing.assert_array_equal(ours(few), peer(few))
    theirs = best(lambda: peer(few)) * PACKETS / PEER_PACKETS
    return [Row("10⁶ packets of 36 bytes", best(lambda: ours(data)), theirs, "struct, by packet")]
