"""Readings rounded to steps: where rounding hides the noise, N cannot be read.

Below a noise of half a step the scatter of the readings depends on where the mean lies between two
steps: at 0.4 of a step N is read 1.15 to 1.31 times too large, at 0.2 it is 0.56 to 2.5 times.
"""

from collections.abc import Sequence

import numpy as np

from inercal.basics.arrays import Array
from inercal.basics.errors import InputError

REFUSED, WARNED = 0.4, 0.5  # sd of the noise over the step
_LOOKED_AT = 100_000  # samples
_EVEN = 1e-3  # of a step
_LAGS = (1, 4, 16, 64)


def rounding_step(y: Array) -> float:
    """Return the step to which readings are rounded, in their unit; 0 where none is seen."""
    values = np.unique(y[:_LOOKED_AT])
    if values.size < 2 or values.size > 0.5 * min(y.size, _LOOKED_AT):
        return 0.0
    gaps = np.diff(values)
    # Values that differ by rounding of the arithmetic are one value.
    gaps = gaps[gaps > 1e-9 * np.abs(values).max()]
    if not gaps.size:
        return 0.0
    step = float(gaps.min())
    off = np.abs(gaps / step - np.rint(gaps / step))
    return step if off.max() < _EVEN * max(1.0, float((gaps / step).max())) else 0.0


def noise_over_step(y: Array, step: float) -> float:
    """Return the sd of the noise over the step, without that of the rounding, step²/12.

    From the differences at several lags: those of neighbours are small behind a low-pass filter.
    """
    lags = [lag for lag in _LAGS if 2 * lag <= y.size]
    variance = max(float(np.mean((y[lag:] - y[:-lag]) ** 2)) for lag in lags) / 2
    return float(np.sqrt(max(variance / step**2 - 1 / 12, 0.0)))


def check_rounding(parts: Sequence[Array], channel: str, source: str) -> tuple[str, ...]:
    """Return remarks on the rounding of a channel's pieces.

    Raises
    ------
    InputError
        The noise is below 0.4 of a step, or the channel does not change at all.
    """
    where = f"{source or 'recording'}: channel {channel}"
    longest = max(parts, key=len)
    if not np.ptp(longest) > 0:
        raise InputError(f"{where} does not change: it has no noise to analyse", names=(channel,))
    step = rounding_step(longest)
    if not step:
        return ()
    ratio = noise_over_step(longest, step)
    if ratio < REFUSED:
        raise InputError(
            f"{where} is rounded to steps of which its noise is only {ratio:.2g}: below "
            f"{REFUSED:g} rounding hides the noise; record with a finer resolution or a narrower "
            "range",
            file=source or None,
            names=(channel,),
        )
    if ratio < WARNED:
        return (f"noise of {ratio:.2g} rounding steps: N may be 1.2 times too large",)
    return ()
