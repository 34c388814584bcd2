"""Compute equivalent degrees of freedom (edf) and 95 % intervals of deviations.

The edf come from the combined algorithm of Greenhall and Riley (PTTI 2003). The noise type is the
exponent α in the spectrum S(f) ∝ f^α of y: 2 for quantisation, 0 for white noise, −1 for flicker
and −2 for random walk. For total deviations, see SP 1065, tables 7 to 11. The noise type is
identified from the lag-1 autocorrelation (Riley and Greenhall 2004). It is only a label and not an
estimate.
"""

from functools import lru_cache

import numpy as np

from inercal.basics.arrays import Array
from inercal.noise.numerics import chi_squared_quantiles

LABELS = {2: "quantisation", 1: "flicker of phase", 0: "white", -1: "flicker", -2: "random walk",
          -3: "flicker walk", -4: "random run"}  # fmt: skip
_TAILS = (0.025, 0.975)
_FEWEST, _MOST = 30, 1 << 16  # smallest and largest number of block means for a noise type
_J_MAX = 100
_FLICKER_EXCESS = 1.7
_TOTAL_EDF = {0: (1.5, 0.0), -1: (1.16832, 0.222), -2: (0.92715, 0.358)}
_MTOT_EDF = {2: (1.90, 2.10), 1: (1.20, 1.40), 0: (1.10, 1.20), -1: (0.85, 0.50), -2: (0.75, 0.31)}
_HTOT_EDF = {0: (0.546, 1.41), -1: (0.667, 2.00), -2: (0.909, 1.00)}
_TOTAL_BIAS = {0: 0.0, -1: 1 / (3 * np.log(2)), -2: 0.75}
_MTOT_BIAS = {2: 0.94, 1: 0.83, 0: 0.73, -1: 0.70, -2: 0.69}
_HTOT_BIAS = {0: -0.005, -1: -0.149, -2: -0.229, -3: -0.283, -4: -0.321}


def identify_noise(x: Array, m: int) -> int:
    """Identify the exponent α of the noise at an averaging factor, from block means.

    Parameters
    ----------
    x : (n + 1,) array
        Cumulative sums.
    m : int
        Averaging factor. If fewer than 30 block means would remain, a smaller factor is used. If
        there are more than 65 536 block means, only the first 65 536 are used.
    """
    m = max(1, min(m, (x.size - 1) // _FEWEST))
    z = np.diff(x[: _MOST * m + 1 : m])
    if z.size < 3:
        return 0
    for d in range(3):
        z = z - z.mean()
        power = float(z @ z)
        if power == 0:
            return 0
        r = float(z[1:] @ z[:-1]) / power
        delta = r / (1 + r) if r > -0.5 else -1.0
        if d == 2 or delta < 0.25:
            return int(np.clip(round(-2 * (delta + d)), -4, 2))
        z = np.diff(z)
    raise AssertionError("unreachable")


def _sw(t: float, alpha: int) -> float:
    """Return s_w(t, α), the generalised autocovariance of phase."""
    t, power = abs(t), 3 - alpha
    size = -(t**power) if power % 4 < 2 else t**power
    if power % 2:
        return size
    return size * np.log(t) if t else 0.0


def _sx(t: float, f: float, alpha: int) -> float:
    if f > 100 and alpha <= 0:
        return _sw(t, alpha + 2)
    return f**2 * (2 * _sw(t, alpha) - _sw(t - 1 / f, alpha) - _sw(t + 1 / f, alpha))


def _sz(t: float, f: float, alpha: int, d: int) -> float:
    weights = {1: (2, -1), 2: (6, -4, 1), 3: (20, -15, 6, -1)}[d]
    total = weights[0] * _sx(t, f, alpha)
    for k, w in enumerate(weights[1:], 1):
        total += w * (_sx(t - k, f, alpha) + _sx(t + k, f, alpha))
    return total


def _basic_sum(j: int, m: float, s: int, f: float, alpha: int, d: int) -> float:
    first, last = _sz(0, f, alpha, d) ** 2, _sz(j / s, f, alpha, d) ** 2
    inner = sum((1 - i / m) * _sz(i / s, f, alpha, d) ** 2 for i in range(1, j))
    return first + (1 - j / m) * last + 2 * inner


@lru_cache(maxsize=65536)
def _greenhall_riley(alpha: int, d: int, m: int, s: int, f: float, n: int) -> float:
    """Return the edf for order-d differences of n phases, at factor m with s steps in m."""
    length = m / f + m * d
    count = 1 + int(s * (n - length) / m)
    if count < 1:
        return 1.0
    j_max = min(count, (d + 1) * s)
    is_long = s > 1 and j_max > _J_MAX
    if is_long and f > 100 and alpha > 0:
        return _phase_noise_edf(alpha, m, n) if d == 2 else _greenhall_riley(0, d, m, s, f, n)
    sz0 = _sz(0, f, alpha, d) ** 2
    if is_long and (f == 1 or f > 100):
        ratio = count / s
        reduced = max(1, min(_J_MAX // (d + 1), s))
        j_max = min(int(ratio * reduced), (d + 1) * reduced)
        total = _basic_sum(max(j_max, 1), ratio * reduced, reduced, f, alpha, d)
        return max(sz0 * ratio * reduced / total, 1.0)
    return max(sz0 * count / _basic_sum(j_max, count, s, f, alpha, d), 1.0)


def _phase_noise_edf(alpha: int, m: int, n: int) -> float:
    """Return the edf of the overlapping Allan variance of n phases with phase noise (α = 2, 1).

    The approximate formulas of SP 1065, table 5, are used, because the sums in `_basic_sum` would
    have m terms. For flicker noise, the result of the formula is up to 1.7 times the exact sum, so
    it is divided by 1.7.
    """
    if alpha == 2:
        return max((n + 1) * (n - 2 * m) / (2 * (n - m)), 1.0)
    product = np.log((n - 1) / (2 * m)) * np.log((2 * m + 1) * (n - 1) / 4)
    return max(float(np.exp(np.sqrt(product))) / _FLICKER_EXCESS, 1.0)


def degrees_of_freedom(kind: str, alpha: int, m: int, n: int, overlap: int | None = None) -> float:
    """Return the equivalent degrees of freedom of a deviation.

    Parameters
    ----------
    kind : str
        One of `inercal.noise.deviations.KINDS`.
    alpha : int
        Noise exponent, −4 to 2.
    m : int
        Averaging factor.
    n : int
        Number of block means.
    overlap : int, optional
        Number of differences within an averaging time, for overlapping deviations; m by default.
    """
    overlap = m if overlap is None else overlap
    if kind == "totdev":
        b, c = _TOTAL_EDF[int(np.clip(alpha, -2, 0))]
        used, every = (degrees_of_freedom("oadev", alpha, m, n, k) for k in (overlap, m))
        return max((b * n / m - c) * min(used / every, 1.0), 1.0)
    if kind == "mtot":
        b, c = _MTOT_EDF[int(np.clip(alpha, -2, 2))]
        return max(b * n / m - c, 1.0)
    if kind == "htot":
        b0, b1 = _HTOT_EDF[int(np.clip(alpha, -2, 0))]
        return max((n / m) / (b0 + b1 * m / n), 1.0)
    d = 3 if kind in ("hdev", "ohdev") else 2
    alpha = max(alpha, 1 - 2 * d)
    modified = kind in ("mdev", "tdev")
    steps = 1 if kind in ("adev", "hdev") else overlap
    return _greenhall_riley(alpha, d, m, steps, 1.0 if modified else float(m), n + 1)


def bias_ratio(kind: str, alpha: int, m: int, n: int) -> float:
    """Return the expected variance of an estimator divided by the true variance."""
    if kind == "totdev":
        return 1 - _TOTAL_BIAS[int(np.clip(alpha, -2, 0))] * m / n
    if kind == "mtot":
        return _MTOT_BIAS[int(np.clip(alpha, -2, 2))]
    if kind == "htot" and m > 1:
        return 1 + _HTOT_BIAS[int(np.clip(alpha, -4, 0))]
    return 1.0


def interval(value: Array, edf: Array) -> tuple[Array, Array]:
    """Return the ends of the 95 % interval of deviations, from χ² with edf degrees of freedom."""
    low, high = (value * np.sqrt(edf / chi_squared_quantiles(edf, tail)) for tail in _TAILS)
    return low, high
