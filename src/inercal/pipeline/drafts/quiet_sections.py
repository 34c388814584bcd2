"""Find the sections of a recording in which the sensor rests, and their means."""

from typing import NamedTuple

import numpy as np

from inercal.basics.arrays import Array
from inercal.recordings import Indices

_JUMP = 10.0  # difference between the means of neighbouring quiet blocks, in limits of the scatter


class QuietMeans(NamedTuple):
    """Sections at rest with their means, (k, 3), as start and stop samples, (k, 2)."""

    spans: Indices
    force: Array
    rate: Array | None


def find_quiet_sections(data: Array, window: int) -> Indices:
    """Return the quiet sections of readings, (n, m), as start and stop samples, (k, 2).

    Blocks of half a window are divided into quiet and moving ones by their scatter, such that the
    two groups are farthest apart (Otsu's criterion on the logarithm). Quiet sections last two
    windows or more.
    """
    block = max(2, window // 2)
    count = len(data) // block
    if count < 8:
        return np.array([[0, len(data)]])
    blocks = data[: count * block].reshape(count, block, -1)
    scatter = blocks.std(axis=1)
    floor = np.maximum(np.quantile(scatter, 0.2, axis=0), 1e-12)
    level = np.log(np.maximum((scatter / floor).max(axis=-1), 1e-3))
    edges = np.sort(level)
    below = np.arange(1, count)
    sums = np.cumsum(edges)
    gap = (sums[:-1] / below - (sums[-1] - sums[:-1]) / (count - below)) ** 2
    split = int(np.argmax(below * (count - below) * gap))
    apart = np.sqrt(gap[split])
    limit = 0.5 * (edges[split] + edges[split + 1]) if apart > 1.5 else np.inf
    quiet = level <= limit
    # Between two files the attitude changes from one sample to the next.
    step = np.abs(np.diff(blocks.mean(axis=1), axis=0)) / floor
    quiet[1:] &= step.max(axis=-1) <= _JUMP * np.exp(limit)
    change = np.flatnonzero(np.diff(np.concatenate([[0], quiet.astype(int), [0]])))
    runs = change.reshape(-1, 2)
    runs = runs[runs[:, 1] - runs[:, 0] >= 4]
    return runs * block


def rest_means(sections: Indices, force: Array, rate: Array | None) -> QuietMeans:
    """Return the means of sections, leaving out a quarter at each end."""

    def mean(data: Array) -> Array:
        return np.array(
            [data[a + (b - a) // 4 : b - (b - a) // 4].mean(axis=0) for a, b in sections]
        )

    return QuietMeans(sections, mean(force), None if rate is None else mean(rate))
