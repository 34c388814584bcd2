"""Checksums of packets, declared as data: cyclic redundancy checks (CRC) and sums.

A CRC is defined by the parameters of R. N. Williams, "A painless guide to CRC error detection
algorithms" (1993). Its name comes from the catalogue of G. Cook,
reveng.sourceforge.io/crc-catalogue. The check value is the CRC of the nine characters "123456789".
Unlike the CRC-32 of Ethernet, NovAtel's CRC-32 (OEM7 Commands and Logs, "32-bit CRC") starts from
zero and ends without inversion.

The probability that a random packet passes a check of b bits is 2^-b.
"""
# Numba's decorator is not typed.
# pyright: reportUntypedFunctionDecorator=false

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from inercal.basics.arrays import Indices
from inercal.estimation.kernel_options import njit

Bytes = NDArray[np.uint8]
Values = NDArray[np.uint32]


@njit(cache=True, nogil=True)
def _crc_registers(
    data: Bytes, start: Indices, stop: Indices, table: Values, init: int, reflected: bool
) -> Values:
    """Return the final register of each span, aligned to bit 31 or, if reflected, to bit 0."""
    out = np.empty(start.size, np.uint32)
    for k in range(start.size):
        register = np.uint32(init)
        for i in range(start[k], stop[k]):
            if reflected:
                index = np.uint32(register ^ np.uint32(data[i])) & np.uint32(0xFF)
                register = np.uint32(register >> np.uint32(8)) ^ table[index]
            else:
                index = np.uint32(register >> np.uint32(24)) ^ np.uint32(data[i])
                register = np.uint32(register << np.uint32(8)) ^ table[index]
        out[k] = register
    return out


@njit(cache=True, nogil=True)
def _byte_sums(data: Bytes, start: Indices, stop: Indices) -> Values:
    """Return the sum of the bytes in each span."""
    out = np.zeros(start.size, np.uint32)
    for k in range(start.size):
        total = np.uint32(0)
        for i in range(start[k], stop[k]):
            total += np.uint32(data[i])
        out[k] = total
    return out


@dataclass(frozen=True)
class Crc:
    """A cyclic redundancy check of up to 32 bits.

    Parameters
    ----------
    words : str
        Name used in messages.
    bits : int
        Width in bits.
    polynomial, init, final : int
        Polynomial without the leading bit, initial register, and value that is XORed with the final
        register.
    reflected : bool
        Whether the least significant bit of a byte comes first.
    check_value : int
        CRC of "123456789".
    """

    words: str
    bits: int
    polynomial: int
    init: int
    reflected: bool
    final: int
    check_value: int

    @cached_property
    def _table(self) -> Values:
        """Return the effect of each byte value in the highest byte (if reflected, the lowest)."""
        value = np.arange(256, dtype=np.uint32)
        if self.reflected:
            polynomial = int(f"{self.polynomial:0{self.bits}b}"[::-1], 2)
            for _ in range(8):
                value = np.where(value & 1, (value >> 1) ^ np.uint32(polynomial), value >> 1)
            return value
        value <<= np.uint32(24)
        polynomial = self.polynomial << (32 - self.bits)
        for _ in range(8):
            value = np.where(value >> 31, (value << 1) ^ np.uint32(polynomial), value << 1)
        return value

    def span_checks(self, data: Bytes, start: Indices, stop: Indices) -> Values:
        """Return the checksums of the half-open spans `start` to `stop` of `data`; all (n,)."""
        unused = 0 if self.reflected else 32 - self.bits
        init = self.init << unused
        value = _crc_registers(data, start, stop, self._table, init, self.reflected)
        return (value >> np.uint32(unused)) ^ np.uint32(self.final)


@dataclass(frozen=True)
class ByteSum:
    """The sum of bytes modulo 256 or, if negated, its negative, which makes the total zero."""

    words: str
    negated: bool
    check_value: int
    bits: int = 8

    def span_checks(self, data: Bytes, start: Indices, stop: Indices) -> Values:
        """Return the checksums of the half-open spans `start` to `stop` of `data`; all (n,)."""
        total = _byte_sums(data, start, stop)
        return (np.uint32(0) - total if self.negated else total) & np.uint32(0xFF)


CHECKS: dict[str, Crc | ByteSum] = {
    "crc16-ccitt-false": Crc("CRC-16/CCITT-FALSE", 16, 0x1021, 0xFFFF, False, 0, 0x29B1),
    "crc16-xmodem": Crc("CRC-16/XMODEM", 16, 0x1021, 0, False, 0, 0x31C3),
    "crc16-modbus": Crc("CRC-16/MODBUS", 16, 0x8005, 0xFFFF, True, 0, 0x4B37),
    "crc32": Crc("CRC-32", 32, 0x04C11DB7, 0xFFFFFFFF, True, 0xFFFFFFFF, 0xCBF43926),
    "crc32-mpeg2": Crc("CRC-32/MPEG-2", 32, 0x04C11DB7, 0xFFFFFFFF, False, 0, 0x0376E6E7),
    "crc32-novatel": Crc("NovAtel's CRC-32", 32, 0x04C11DB7, 0, True, 0, 0x2DFD2D88),
    "sum8": ByteSum("sum of 8 bits", False, 0xDD),
    "sum8-zero": ByteSum("sum of 8 bits", True, 0x23),
}
