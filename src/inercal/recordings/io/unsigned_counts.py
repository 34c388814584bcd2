"""Recover signed counts that a program wrote as unsigned numbers.

A sensor's counts of b bits run from −2^(b−1) to 2^(b−1) − 1. If they are written as unsigned
numbers, −1 becomes 2^b − 1. Small readings are then either near 0 or near the largest number, with
nothing in between, and a reading that passes through zero jumps by nearly the whole range.
"""

import numpy as np
from numpy.typing import NDArray

from inercal.basics.arrays import Array
from inercal.basics.errors import InputError
from inercal.recordings import Finding, Recording

SIGNED_KEY = "[data] signed_bits"
_BITS = (16, 24, 32)
_MIDDLE = (3 / 8, 5 / 8)  # of the range; signed readings near full scale, which are rare
_FEW = 0.02  # largest share of the samples there
_SMOOTHER = 0.5  # of the largest step, once the readings have their signs


def signed_counts(values: Array, bits: int) -> Array:
    """Return counts with their signs.

    >>> signed_counts(np.array([0.0, 32767.0, 32768.0, 65535.0]), 16).tolist()
    [0.0, 32767.0, -32768.0, -1.0]
    """
    return np.where(values >= 2.0 ** (bits - 1), values - 2.0**bits, values)


def are_counts(values: NDArray[np.floating], bits: int) -> bool:
    """Return whether all finite values are whole numbers that fit into unsigned bits."""
    found = values[np.isfinite(values)]
    fits = found.size > 0 and found.min() >= 0 and found.max() < 2.0**bits
    return bool(fits and (found == np.rint(found)).all())


def unsigned_bits(values: Array) -> int | None:
    """Return the bits of signed counts that were written as unsigned numbers; otherwise None.

    >>> unsigned_bits(np.array([3.0, 1.0, 65534.0, 65530.0, 2.0]))
    16
    """
    found = values[np.isfinite(values)]
    top = float(found.max(initial=0.0))
    bits = next((one for one in _BITS if top < 2.0**one), _BITS[-1])
    size = 2.0**bits
    low, high = _MIDDLE
    if top < high * size or found.min() > low * size or not are_counts(found, bits):
        return None
    middle = np.count_nonzero((found >= low * size) & (found < high * size))
    before, after = np.abs(np.diff(found)).max(), np.abs(np.diff(signed_counts(found, bits))).max()
    return bits if middle <= _FEW * found.size and after <= _SMOOTHER * before else None


def unsigned_findings(recording: Recording) -> list[Finding]:
    """Refuse channels with signed counts that were written as unsigned numbers."""
    for channel, values in zip(recording.channels, recording.data.T, strict=True):
        if (bits := unsigned_bits(values)) is not None:
            text = (
                f"{channel} reads only near 0 and near {2**bits - 1}: signed counts of {bits} bits "
                f"were written as unsigned numbers; state {SIGNED_KEY} = {bits}"
            )
            return [Finding("refused", "unsigned", text, channel, 0, values.size)]
    return []


def sign_in_place(block: Array, bits: int, source: str) -> None:
    """Give the counts in a block, (n, k), their signs.

    Raises
    ------
    InputError
        A value is not an unsigned whole number of so many bits.
    """
    for column in block.T:
        if not are_counts(column, bits):
            raise InputError(
                f"{source}: a column has readings that are not whole numbers from 0 to "
                f"{2**bits - 1}: remove {SIGNED_KEY}, or correct it",
                file=source,
                key=SIGNED_KEY,
            )
        column[:] = signed_counts(column, bits)
