"""Expected squares of the DCT-II coefficients of a noise term, exactly.

With the orthonormal DCT-II c_k, k = 1 … n−1, of block means whose variogram is γ::

    E c_k² = −(2/n) [Σ_h (n−h) γ(h) cos(πkh/n) − Σ_h γ(h) sin(πkh/n)/sin(πk/n)],  h = 1 … n−1

The first sum is a DCT-I, the second a DST-I. Coefficient k = 0, the bias, is left out.
"""

from functools import lru_cache

import numpy as np

from inercal.basics.arrays import Array
from inercal.noise.numerics import cosine_sums, dct2, sine_sums
from inercal.noise.terms import TERMS


@lru_cache(maxsize=64)  # up to 1 MB each
def expected_periodogram(symbol: str, n: int, dt: float, markov_time: float = 1.0) -> Array:
    """Return E c_k² of a term with a coefficient of 1, (n−1,), k = 1 … n−1.

    Parameters
    ----------
    symbol : str
        Of `TERMS`.
    n : int
        Number of block means.
    dt : float
        Δ, s.
    markov_time : float
        T of a Gauss–Markov process, s.
    """
    h = np.arange(1, n, dtype=np.float64)
    gamma = TERMS[symbol].variogram(h, dt, markov_time)
    # A line a + b h has closed sums; without it the transforms lose fewer digits.
    slope = (gamma[-1] - gamma[0]) / max(n - 2, 1)
    constant = gamma[0] - slope
    gamma = gamma - (constant + slope * h)
    weighted = np.zeros(n + 1)
    weighted[1:n] = (n - h) * gamma
    cosines = cosine_sums(weighted)
    sines = sine_sums(gamma)
    expected = -(2 / n) * (cosines - sines / np.sin(np.pi * h / n))
    expected += constant + slope / (2 * np.sin(np.pi * h / (2 * n)) ** 2)
    expected.flags.writeable = False
    return expected


def squared_coefficients(y: Array) -> Array:
    """Return the squares of the orthonormal DCT-II coefficients k = 1 … n−1 of y, (..., n)."""
    return dct2(y - y.mean(axis=-1, keepdims=True))[..., 1:] ** 2
