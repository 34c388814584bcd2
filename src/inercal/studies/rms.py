"""Roots of mean squares over trials, with their Monte Carlo errors."""

from typing import NamedTuple

import numpy as np

from inercal.basics.arrays import Array


class Rms(NamedTuple):
    """A root of a mean square, or a mean, and its Monte Carlo error."""

    value: float
    u: float


def rms(errors: Array, ddof: int = 0) -> Rms:
    """Return the RMS of errors, (trials, ...), of which those of one trial may be correlated."""
    square = np.mean(errors.reshape(len(errors), -1) ** 2, axis=1)
    value = float(np.sqrt(square.mean()))
    spread = square.std(ddof=ddof) / np.sqrt(len(square))
    return Rms(value, float(spread / (2 * value)) if value else 0.0)
