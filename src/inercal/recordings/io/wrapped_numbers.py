"""Stamps that wrap around to 0, and signed counts that were written as unsigned numbers.

A counter of b bits wraps around after M = 2^b of its units: a packet counter after 256 or 65536
packets, and a 32-bit counter of µs after 71.6 minutes. Its readings s then fall by nearly M:

    t_k = s_k + M · (number of falls up to sample k)

A sensor's counts of b bits run from −2^(b−1) to 2^(b−1) − 1. If they are written as unsigned
numbers, −1 becomes 2^b − 1. Small readings are then either near 0 or near the largest number, with
nothing in between, and a reading that passes through zero jumps by nearly the whole range.
"""

import numpy as np
from numpy.typing import NDArray

from inercal.basics.arrays import Array
from inercal.basics.errors import InputError
from inercal.recordings import Finding, Recording
from inercal.recordings.io.column_table import Table

SIGNED_KEY = "[data] signed_bits"
_COUNT_BITS = (16, 24, 32)
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
    bits = next((one for one in _COUNT_BITS if top < 2.0**one), _COUNT_BITS[-1])
    size = 2.0**bits
    low, high = _MIDDLE
    if top < high * size or found.min() > low * size or not are_counts(found, bits):
        return None
    middle = np.count_nonzero((found >= low * size) & (found < high * size))
    signed = signed_counts(found, bits)
    before, after = np.abs(np.diff(found)).max(), np.abs(np.diff(signed)).max()
    smooth = middle <= _FEW * found.size and after <= _SMOOTHER * before
    return bits if smooth and not _are_spikes(signed) else None


def _are_spikes(signed: Array) -> bool:
    """Return whether only a few counts are negative, and far from the others: false readings."""
    negative = signed[signed < 0]
    gap = signed[signed >= 0].min(initial=np.inf) - negative.max(initial=-np.inf)
    return negative.size <= _FEW * signed.size and bool(gap > _SMOOTHER * np.ptp(signed))


def unsigned_findings(recording: Recording) -> list[Finding]:
    """Refuse channels with signed counts that were written as unsigned numbers."""
    for channel, values in zip(recording.channels, recording.data.T, strict=True):
        if (bits := unsigned_bits(values)) is not None:
            low, high = (part * 2**bits for part in _MIDDLE)
            text = (
                f"{channel} reads up to {values[values < low].max():.0f} and from "
                f"{values[values >= high].min():.0f} to {np.nanmax(values):.0f}: signed counts of "
                f"{bits} bits were written as unsigned numbers; state {SIGNED_KEY} = {bits}"
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


MODULUS_KEY = "[data] counter_modulus"
_STAMP_BITS = (8, 16, 32)
_FRACTIONS = {8: (1,), 16: (1, 1e-3), 32: (1, 1e-3, 1e-6)}  # of ms and µs, in s or ms
_LOST = 20  # steps; most that may be missing where the stamps wrap around
Stamps = Array | NDArray[np.int64]


def unwrap_stamps(stamps: Stamps, modulus: float) -> Stamps:
    """Return the stamps, (n,), unwrapped, so that they continue to increase.

    Parameters
    ----------
    stamps : (n,) array of float64 or int64
        Readings from 0 to the modulus, or as far below and above 0; NaN stays.
    modulus : float
        Number of units after which the stamps wrap around.

    >>> unwrap_stamps(np.array([254, 255, 0, 3]), 256).tolist()
    [254, 255, 256, 259]
    """
    finite = np.isfinite(stamps)
    size = int(modulus) if float(modulus).is_integer() else modulus
    found = stamps[finite]
    turns = np.cumsum(np.diff(found, prepend=found[:1]) < -0.5 * modulus)
    result = stamps.copy()
    result[finite] = found + turns.astype(stamps.dtype) * size
    return result


def wrap_modulus(stamps: Stamps) -> float | None:
    """Return the modulus at which stamps wrap around; None if they do not.

    >>> wrap_modulus(np.array([65534, 65535, 0, 1, 2, 3]))
    65536
    """
    found = stamps[np.isfinite(stamps)].astype(np.float64)
    steps = np.diff(found)
    falls = steps[steps < 0]
    if not falls.size:
        return None
    step = float(np.median(steps))
    for bits in _STAMP_BITS:
        for fraction in _FRACTIONS[bits]:
            modulus = 2**bits * fraction
            after = falls + modulus  # the step across the wrap-around
            if np.ptp(found) < modulus and (after > 0).all() and (after <= _LOST * step).all():
                return modulus
    return None


def require_no_wrap(table: Table, column: str) -> None:
    """Refuse stamps that wrap around although no modulus is stated.

    Raises
    ------
    InputError
        The stamps fall by nearly a power of 2; the message names the key that unwraps them.
    """
    stamps = table.stamps(column)
    modulus = wrap_modulus(stamps)
    if modulus is None:
        return
    k = int(np.argmax(np.diff(stamps) < 0))
    raise InputError(
        f"{table.source}: column {column!r} falls from {stamps[k]:.12g} to {stamps[k + 1]:.12g} at "
        f"{table.place(k + 1)}, so it wraps around after {modulus:.12g}: state "
        f"{MODULUS_KEY} = {modulus:.12g}",
        file=table.source,
        key=MODULUS_KEY,
        line=table.line(k + 1),
        names=(column,),
    )
