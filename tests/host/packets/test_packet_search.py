"""The search for packets against one that goes byte by byte, where packets overlap and hide."""

from itertools import pairwise

import numpy as np
import pytest
from tests.base_seeds import chosen
from tests.host.packets.cases import fed

from inercal.host.packets import parse_layout

# Short fixed bytes in a stream of few different bytes: everywhere something looks like a packet.
LAYOUT = parse_layout(
    '[[frame]]\nlength = 5\npacket = "A5 01 ax:u8 _ sum8@1"\n'
    '[[frame]]\nlength = 6\npacket = "A5 02 _ ax:u8 _ sum8@2"\n'
    '[accelerometer]\nscale = "1 m/s²"\n',
    "own",
)


def byte_by_byte(data: bytes) -> tuple[list[int], int]:
    """Return the readings, and how many bytes belong to packets."""
    readings, at, taken = list[int](), 0, 0
    while at < len(data):
        short, long = data[at : at + 5], data[at : at + 6]
        if short[:2] == b"\xa5\x01" and len(short) == 5 and sum(short[1:4]) % 256 == short[4]:
            readings.append(short[2])
            at, taken = at + 5, taken + 5
        elif long[:2] == b"\xa5\x02" and len(long) == 6 and sum(long[2:5]) % 256 == long[5]:
            readings.append(long[3])
            at, taken = at + 6, taken + 6
        else:
            at += 1
    return readings, taken


@pytest.mark.parametrize("seed", chosen(range(10), range(3)))
def test_packets_are_those_that_a_search_byte_by_byte_finds(seed: int):
    random = np.random.default_rng(seed)
    letters = np.array([0xA5, 0x01, 0x02, 0x00], np.uint8)
    data = random.choice(letters, 60_000).tobytes()
    expected, taken = byte_by_byte(data)
    assert len(expected) > 100
    cuts = [0, *np.sort(random.choice(len(data), 200, replace=False)).tolist(), len(data)]
    for pieces in ([data], [data[a:b] for a, b in pairwise(cuts)]):
        packets, counts = fed(LAYOUT, *pieces)
        assert packets.readings[:, 0].tolist() == expected
        assert counts.discarded + taken == pytest.approx(len(data), abs=5)  # an open end


def test_the_last_byte_of_a_packet_that_was_taken_begins_no_other():
    data = bytes.fromhex("A50200A401A5 01050006")  # A5 01 05 00 06 would be right by itself
    for cut in range(len(data)):
        packets, counts = fed(LAYOUT, data[:cut], data[cut:])
        assert packets.readings[:, 0].tolist() == [0xA4]
        assert counts.discarded == 4
