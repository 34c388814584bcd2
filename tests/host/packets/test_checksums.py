import zlib

import numpy as np
import pytest

from inercal.host.packets.checksums import CHECKS


@pytest.mark.parametrize("name", CHECKS)
def test_check_of_123456789_is_that_of_the_catalogue(name: str):
    data = np.frombuffer(b"..123456789.", np.uint8)
    check = CHECKS[name]
    assert check.span_checks(data, np.array([2]), np.array([11]))[0] == check.check_value


def test_crc32_of_any_bytes_is_that_of_zlib():
    data = np.random.default_rng(1).integers(0, 256, 999, np.uint8)
    starts = np.arange(0, 900, 7)
    found = CHECKS["crc32"].span_checks(data, starts, starts + 50)
    assert found.tolist() == [zlib.crc32(data[k : k + 50].tobytes()) for k in starts]


@pytest.mark.parametrize("name", [name for name in CHECKS if name.startswith("crc16")])
def test_crc_of_16_bits_finds_every_error_of_one_bit(name: str):
    data = np.random.default_rng(2).integers(0, 256, 40, np.uint8)
    ends = np.array([0]), np.array([40])
    right = CHECKS[name].span_checks(data, *ends)[0]
    for bit in range(320):
        wrong = data.copy()
        wrong[bit // 8] ^= np.uint8(1 << bit % 8)
        assert CHECKS[name].span_checks(wrong, *ends)[0] != right
