"""Find the sections of a recording in which the sensor rests, and their means."""

from typing import NamedTuple

import numpy as np

from inercal.basics.arrays import Array
from inercal.recordings import Indices

_JUMP = 10.0  # difference between the means of neighbouring quiet blocks, in limits of the scatter
_SAME_LEVEL = np.log(2.0)  # of the scatter, during a stay
_MOST_BLOCKS = 8  # of a stay that are counted, as in the detection of rests


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
    edges = np.sort(_changing(level))
    count = edges.size
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


def _changing(level: Array) -> Array:
    """Return levels without the rest of a stay, so that a long rest on a table forms no class."""
    kept: list[float] = []
    first, stay = np.inf, 0
    for one in level.tolist():
        first, stay = (first, stay + 1) if abs(one - first) < _SAME_LEVEL else (one, 0)
        if stay < _MOST_BLOCKS:
            kept.append(one)
    return np.array(kept)


def rest_means(sections: Indices, force: Array, rate: Array | None) -> QuietMeans:
    """Return the means of sections, leaving out a quarter at each end."""

    def mean(data: Array) -> Array:
        return np.array(
            [data[a + (b - a) // 4 : b - (b - a) // 4].mean(axis=0) for a, b in sections]
        )

    return QuietMeans(sections, mean(force), None if rate is None else mean(rate))
