"""Times of samples from the counter of their packets."""

import numpy as np
from numpy.typing import ArrayLike

from inercal.errors import InputError
from inercal.io.column_table import Array


def times_from_counter(counter: ArrayLike, modulus: int, rate_hz: float) -> Array:
    """Return the samples' times by their packets' counter: lost packets become gaps in time.

    Parameters
    ----------
    counter : (n,) array of int
        0 to modulus − 1, one more with each packet sent.
    modulus : int
        After so many it begins at 0 again; 3 or more. A loss of half of it or more in one stretch
        cannot be told.
    rate_hz : float

    Returns
    -------
    (n,) array
        s, from 0 on.

    Raises
    ------
    InputError
        No whole numbers below the modulus, a packet twice or one that is late.

    >>> times_from_counter([254, 255, 0, 3], 256, 100.0).tolist()
    [0.0, 0.01, 0.02, 0.05]
    """
    read = np.asarray(counter, dtype=float)
    if modulus < 3 or not rate_hz > 0:
        raise InputError(
            f"counter: modulus {modulus} and rate {rate_hz:g} Hz; the modulus must be at least 3 "
            "and the rate greater than 0"
        )
    off = np.flatnonzero(~((read >= 0) & (read < modulus) & (read == np.round(read))))
    if off.size:
        raise InputError(
            f"counter: sample {off[0]} has {read[off[0]]:g}; it counts in whole numbers from 0 to "
            f"{modulus - 1}"
        )
    step = np.diff(read) % modulus
    bad = np.flatnonzero((step == 0) | (2 * step >= modulus))
    if bad.size:
        k, most = int(bad[0]), float(read.max())
        if most + 1 < modulus and (read[bad] == most).all() and (read[bad + 1] == read.min()).all():
            raise InputError(
                f"counter: after {most:g} it begins again at {read.min():g} (sample {k + 1}), so "
                f"that its modulus is {most + 1:g}, not {modulus}"
            )
        what = "comes twice" if step[k] == 0 else f"follows {read[k]:g}: packets out of order"
        raise InputError(
            f"counter: {read[k + 1]:g} at sample {k + 1} {what}, or {modulus // 2} packets or more "
            f"were lost there ({bad.size} such places); take repeated ones out and sort late ones"
        )
    return np.concatenate([[0.0], np.cumsum(step)]) / rate_hz
