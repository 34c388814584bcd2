"""Unwrap stamps and counters, which return to 0 because they have a limited number of bits.

A counter of b bits wraps around after M = 2^b of its units: a packet counter after 256 or 65536
packets, and a 32-bit counter of µs after 71.6 minutes. Its readings s then fall by nearly M:

    t_k = s_k + M · (number of falls up to sample k)
"""

import numpy as np
from numpy.typing import NDArray

from inercal.basics.arrays import Array
from inercal.basics.errors import InputError
from inercal.recordings.io.column_table import Table

MODULUS_KEY = "[data] counter_modulus"
_BITS = (8, 16, 32)
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
    for bits in _BITS:
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
