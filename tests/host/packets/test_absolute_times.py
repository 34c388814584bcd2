"""A device that stamps its packets with ns since 1970 loses no digit."""

import struct

import numpy as np
import pytest

from inercal.host.packets import Decoder, parse_layout

LAYOUT = """
byte_order = "little"
rate = "1 kHz"

[[frame]]
length = 14
packet = "AA 55 time:u64 ax:i16 crc16-xmodem@2"

[accelerometer]
scale = "1 mg"

[time]
scale = "1 ns"
"""
START = 1_700_000_000_123_456_789


def crc16(data: bytes) -> int:
    crc = 0
    for byte in data:
        crc ^= byte << 8
        for _ in range(8):
            crc = (crc << 1 ^ 0x1021 if crc & 0x8000 else crc << 1) & 0xFFFF
    return crc


def stream(stamps: list[int]) -> list[bytes]:
    packets: list[bytes] = []
    for k, ns in enumerate(stamps):
        content = struct.pack("<Qh", ns, k)
        packets.append(b"\xaa\x55" + content + struct.pack("<H", crc16(content)))
    return packets


@pytest.mark.parametrize("start", [START, 0])
def test_times_are_since_the_first_packet_of_all_sessions(start: int):
    layout = parse_layout(LAYOUT, "ns.toml")
    since = [1_000_003 * k for k in range(40)]
    sent = stream([start + one for one in since])
    first = Decoder(layout, time_zero=None)
    parts = [first.feed(b"".join(sent[:7])), first.feed(b"".join(sent[7:20]))]
    parts.append(Decoder(layout, time_zero=first.time_zero).feed(b"".join(sent[20:])))
    time = np.concatenate([one.time for one in parts if one.time is not None])
    np.testing.assert_array_equal(time, np.array(since) * layout.time.size)
    as_sent = Decoder(layout).feed(sent[-1]).time
    assert as_sent is not None
    np.testing.assert_allclose(as_sent, (start + since[-1]) / 1e9)
