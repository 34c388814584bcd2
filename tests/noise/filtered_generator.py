"""Sensor noise behind low-pass filters and rounding, apart from inercal."""
# SciPy's stubs are partial.
# pyright: reportArgumentType=false, reportAttributeAccessIssue=false, reportOperatorIssue=false
# pyright: reportReturnType=false, reportGeneralTypeIssues=false, reportAssignmentType=false
# pyright: reportOptionalIterable=false

from dataclasses import dataclass

import numpy as np
from scipy.signal import butter, cheby1, lfilter
from tests.noise.generator import flicker_means, markov_means, walk_means

DEG_SQRT_H, DEG_H = 1 / 60, 1 / 3600  # °/s/√Hz, °/s
SETTLING = 4000  # samples before the recording


@dataclass(frozen=True)
class FilteredTruth:
    """A gyro in °/s: noise, filter, rounding, and its sampling."""

    kind: str = "none"
    cutoff: float = 0.0  # Hz; samples of an average
    rate: float = 100.0  # Hz
    seconds: float = 1800.0
    white: float = 0.3  # °/√h
    flicker: float = 0.0  # °/h
    walk: float = 0.0  # °/h/√s
    step: float = 0.0  # °/s
    markov: float = 0.0  # 2σ²T over N²
    markov_time: float = 1.0  # s
    increments: float = 0.0  # sd of the reading errors of angles, °

    @property
    def dt(self) -> float:
        return 1 / self.rate

    @property
    def sampled_white(self) -> float:
        """N of the readings, °/s/√Hz, with what rounding adds."""
        return float(np.hypot(self.white * DEG_SQRT_H, self.step * np.sqrt(self.dt / 12)))


def coefficients(truth: FilteredTruth) -> tuple[list[float], list[float]]:
    """Return numerator and denominator of the filter."""
    share = 2 * truth.cutoff / truth.rate
    if truth.kind == "pole":
        p = float(np.exp(-np.pi * share))
        return [1 - p], [1, -p]
    if truth.kind == "pole, digital":
        b, a = butter(1, share)
    elif truth.kind == "Butterworth":
        b, a = butter(2, share)
    elif truth.kind == "Chebyshev":
        b, a = cheby1(4, 1, share)
        b = b / b.sum() * a.sum()
    elif truth.kind == "average":
        m = int(truth.cutoff)
        b, a = np.full(m, 1 / m), np.ones(1)
    else:
        b, a = np.ones(1), np.ones(1)
    return list(b), list(a)


def readings(truth: FilteredTruth, seed: int) -> np.ndarray:
    """Return readings, °/s."""
    rng = np.random.default_rng(seed)
    dt = truth.dt
    n = round(truth.seconds * truth.rate) + SETTLING
    white = truth.white * DEG_SQRT_H
    y = white / np.sqrt(dt) * rng.standard_normal(n)
    if truth.flicker:
        y += truth.flicker * DEG_H * flicker_means(rng, n, dt)[0]
    if truth.walk:
        y += truth.walk * DEG_H * walk_means(rng, n, dt)[0]
    if truth.markov:
        sd = white * np.sqrt(truth.markov / (2 * truth.markov_time))
        y += sd * markov_means(rng, n, dt, truth.markov_time)[0]
    b, a = coefficients(truth)
    y = lfilter(b, a, y - y[0])[SETTLING:]
    if truth.increments:
        y = y + np.diff(truth.increments * rng.standard_normal(y.size + 1)) / dt
    return np.round(y / truth.step) * truth.step if truth.step else y
