"""Whatever the bytes are, nothing is raised, and no more is believed than a check lets through."""

import numpy as np
import pytest
from scipy.stats import binom
from tests.base_seeds import evidence
from tests.host.packets.cases import fed, mutated, random_frames

from inercal.host.packets import PRESETS, parse_layout, read_layout
from inercal.host.packets.packet_format import BinaryFrame

N = 1_000_000
FEW = 240_000
RISK = 1e-6  # of a false alarm, each side
BINARY = [name for name in PRESETS if isinstance(read_layout(name).frames[0], BinaryFrame)]
# Bits of all checks of a packet together: both of WitMotion's have to be right.
BITS = {"fixed": 16, "vn100": 16, "witmotion": 16, "xsens": 8}


# A packet is some 40 bytes: those of a hundred thousand, and of a million.
@pytest.mark.parametrize("size", [4 * N, pytest.param(40 * N, marks=pytest.mark.slow)])
@pytest.mark.parametrize("name", PRESETS)
def test_random_bytes_raise_nothing(name: str, size: int):
    data = np.random.default_rng(4).integers(0, 256, size, np.uint8).tobytes()
    packets, counts = fed(read_layout(name), data)
    assert len(packets) == 0
    assert len(data) - 4096 <= counts.discarded <= len(data)


@pytest.mark.parametrize("name", BINARY)
def test_random_packets_pass_as_often_as_the_bits_of_the_checks_say(name: str):
    layout = read_layout(name)
    packets, counts = fed(layout, random_frames(layout, FEW))
    # Beginnings of packets within random bytes add less than a part in 1000 of the trials.
    low, high = binom.interval(1 - 2 * RISK, FEW, 2.0 ** -BITS[name])
    assert low <= len(packets) <= high * 1.001 + 1
    assert counts.failed + len(packets) == pytest.approx(FEW, rel=2e-3)


@pytest.mark.parametrize("changes", [2, evidence(3)])
@pytest.mark.parametrize("name", [name for name in PRESETS if read_layout(name).check_bits])
def test_changed_packets_pass_no_more_often_than_stated(name: str, changes: int):
    layout = read_layout(name)
    packets, _ = fed(layout, mutated(layout, FEW, changes))
    # Two changes of 255 kinds each cancel in a sum once in 255 times, not once in 256.
    high = binom.ppf(1 - RISK, FEW, 2.0**-layout.check_bits * 256 / 255)
    assert len(packets) <= high


def test_numbers_separated_by_commas_are_believed_when_they_are_changed_and_say_so():
    layout = read_layout("ascii")
    packets, _ = fed(layout, mutated(layout, 20_000, changes=2))
    assert layout.check_bits == 0
    assert layout.protection.startswith("none")
    assert len(packets) > 0
    assert np.isfinite(packets.readings).all()


@pytest.mark.parametrize("name", BINARY)
def test_every_error_of_one_byte_is_found(name: str):
    layout = read_layout(name)
    packets, _ = fed(layout, mutated(layout, 20_000, changes=1))
    assert len(packets) == 0


def test_numbers_that_are_none_raise_nothing_where_no_check_stops_them():
    layout = parse_layout(
        'byte_order = "big"\n[[frame]]\nlength = 41\n'
        'packet = "A5 time:f64 ax:f64 counter:i64 temperature:f64 status:u64"\n'
        '[accelerometer]\nscale = "1 g"\nfull_scale = "16 g"\n[temperature]\nscale = "1 °C"\n'
        '[time]\nscale = "1 ms"\nwraps = "60 s"\n',
        "own",
    )
    data = random_frames(layout, 100_000)
    packets, counts = fed(layout, data)
    assert counts.packets == len(packets) == 100_000
    assert len(fed(layout, data[:4097], data[4097:])[0]) == 100_000
