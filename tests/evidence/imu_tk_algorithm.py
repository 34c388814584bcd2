"""The hand-held calibration of imu_tk, written anew from its paper: NumPy and SciPy alone.

Tedaldi, Pretto, Menegatti, ICRA 2014. Rests are where the norm of the three variances in a window
of 101 samples is below a threshold, a multiple of that of the first seconds; the threshold that
fits best is taken. The model is a = T K (raw − b), T upper triangular for accelerometers and full
for gyros. The b of the gyros is their mean in the first seconds, or fitted with the matrix.
"""

from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

Array = NDArray[np.float64]
HALF_WINDOW, EACH, AT_LEAST = 50, 100, 12
MULTIPLIERS = range(2, 11)


class Triad(NamedTuple):
    """T K as one matrix, SI units per count, and b, counts."""

    matrix: Array
    offset: Array

    @property
    def inverse_scale(self) -> Array:
        """Return 1/K, counts per SI unit: T has ones on its diagonal."""
        return 1 / np.diag(self.matrix)


def rests(readings: Array, first: int, multiplier: float) -> list[slice]:
    """Return the rests of at least `EACH` samples, by the norm of the variances in a window."""
    limit = multiplier**2 * np.linalg.norm(readings[:first].var(axis=0))
    windows = np.lib.stride_tricks.sliding_window_view(readings, 2 * HALF_WINDOW + 1, axis=0)
    quiet = np.linalg.norm(windows.var(axis=-1), axis=1) < limit
    edges = np.flatnonzero(np.diff(np.r_[False, quiet, False].astype(int)))
    spans = (slice(a + HALF_WINDOW, b + HALF_WINDOW) for a, b in edges.reshape(-1, 2))
    return [span for span in spans if span.stop - span.start >= EACH]


def accelerometer_matrix(p: Array, scale: Array) -> Array:
    """Return T K: three angles, and three scale factors relative to the start."""
    t = np.array([[1, -p[0], p[1]], [0, 1, -p[2]], [0, 0, 1]])
    return np.asarray(t * (p[3:6] * scale))


def accelerometers(
    readings: Array, first: int, g: float, start: Triad
) -> tuple[Triad, list[slice]]:
    """Fit the norm of each sample to g, and return the triad with its rests."""
    scale, best = np.diag(start.matrix), None
    for multiplier in MULTIPLIERS:
        spans = rests(readings, first, multiplier)
        if len(spans) < AT_LEAST:
            continue
        samples = np.concatenate([readings[s.start : s.start + EACH] for s in spans])

        def misses(p: Array, samples: Array = samples) -> Array:
            felt = (samples - p[6:] / scale - start.offset) @ accelerometer_matrix(p, scale).T
            return np.asarray(g - np.linalg.norm(felt, axis=1))

        fit = least_squares(misses, np.r_[np.zeros(3), np.ones(3), np.zeros(3)])
        mean_cost = fit.cost / len(samples)
        if best is None or mean_cost < best[0]:
            best = mean_cost, fit.x, spans
    assert best is not None, "fewer than twelve rests"
    _, x, spans = best
    return Triad(accelerometer_matrix(x, scale), start.offset + x[6:] / scale), spans


def gyros(
    readings: Array,
    time: Array,
    first: int,
    felt: Array,
    spans: list[slice],
    start: Triad,
    *,
    bias: bool = False,
) -> Triad:
    """Fit gravity carried by the gyros from rest to rest to what the accelerometers feel there."""
    offset = readings[:first].mean(axis=0)
    means = np.stack([felt[s.start : s.start + EACH].mean(axis=0) for s in spans])
    directions = means / np.linalg.norm(means, axis=1, keepdims=True)
    turns = [
        (time[a.stop - 1 : b.start + 1], readings[a.stop - 1 : b.start + 1])
        for a, b in pairwise(spans)
    ]
    scale = np.diag(start.matrix)

    def misses(p: Array) -> Array:
        matrix = p[:9].reshape(3, 3) * scale
        b = offset + (p[9:] / scale if bias else 0.0)
        off = []
        for (t, counts), before, after in zip(turns, directions, directions[1:], strict=False):
            rates = (counts - b) @ matrix.T
            steps = 0.5 * (rates[1:] + rates[:-1]) * np.diff(t)[:, None]
            turned = Rotation.from_rotvec(steps).as_matrix()
            while len(turned) > 1:  # the product, in pairs
                if len(turned) % 2:
                    turned = np.concatenate([turned, np.eye(3)[None]])
                turned = turned[::2] @ turned[1::2]
            off.append(turned[0].T @ before - after)
        return np.concatenate(off)

    fit = least_squares(misses, np.r_[np.eye(3).ravel(), np.zeros(3 * bias)])
    moved = fit.x[9:] / scale if bias else 0.0
    return Triad(fit.x[:9].reshape(3, 3) * scale, offset + moved)
