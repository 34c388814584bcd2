"""Block means of a series that comes in pieces, such as the temperature beside the samples.

Kept are the first 2¹⁷ samples and every 64th cumulative sum, as `StreamedChannel` keeps them: the
means lie on the grid of its block means for the low frequencies.
"""

import numpy as np

from inercal.basics.arrays import Array
from inercal.noise.spectrum import LONGEST, block_means

KEPT_EVERY = 64


class StreamedMeans:
    """Takes a series piece by piece; then gives its block means."""

    def __init__(self) -> None:
        self.count = 0
        self._origin = 0.0  # mean of the first piece, so that cumulative sums stay small
        self._last = 0.0  # cumulative sum
        self._kept: list[Array] = [np.zeros(1)]
        self._first: list[Array] = []

    def add(self, y: Array) -> None:
        """Take the next values, (k,), k ≥ 1."""
        if not self.count:
            self._origin = float(y.mean())
        if self.count < LONGEST:
            self._first.append(y[: LONGEST - self.count].copy())
        sums = self._last + np.cumsum(y - self._origin)
        # sums[0] is the cumulative sum number count + 1.
        skip = (-(self.count + 1)) % KEPT_EVERY
        self._kept.append(sums[skip::KEPT_EVERY].copy())
        self._last = float(sums[-1])
        self.count += y.size

    def means(self) -> Array:
        """Return the values, or of more than 2¹⁷ the means of as many blocks at most."""
        if self.count <= LONGEST:
            return np.concatenate([np.zeros(0), *self._first])
        means = self._origin + np.diff(np.concatenate(self._kept)) / KEPT_EVERY
        return block_means(means, -(-means.size // LONGEST))
