"""How long a recording must be for a wanted uncertainty of a coefficient.

From the information of the spectrum: with frequencies k/2T of a recording of length T, the
covariance of the variances θ is [½ Σ_k e eᵀ/S²]⁻¹, and u of a coefficient is u(θ)/2√θ. Each
coefficient k counts, to the Nyquist frequency. A term whose own uncertainty exceeds its value is
not seen in such a recording, and not fitted: the others are then better known.
"""

import numpy as np

from inercal.basics.arrays import Array
from inercal.noise.numerics import pseudo_inverse
from inercal.noise.terms import model_psd

_BINS = 200
_SINGLE = 32
_LONGEST = 1e9  # s
_SEEN = 1.0  # largest relative uncertainty of a term that is fitted


def relative_uncertainties(
    variances: dict[str, float], dt: float, length: float, markov_time: float = 1.0
) -> dict[str, float]:
    """Return u/value of each coefficient above zero for a recording of `length`, s.

    Parameters
    ----------
    variances : mapping of symbol to float
        Squared coefficients, SI².
    dt : float
        Sampling interval, s.
    length : float
        s.
    markov_time : float
        T, s, taken as known.
    """
    symbols = [symbol for symbol, value in variances.items() if value > 0]
    n = max(int(length / dt), 4)
    edges = np.unique(
        np.concatenate(
            [np.arange(1, min(_SINGLE, n)), np.geomspace(min(_SINGLE, n), n, _BINS).round()]
        )
    )
    middle: Array = np.sqrt(edges[:-1] * np.maximum(edges[1:] - 1.0, 1.0))
    frequency, count = middle / (2 * n * dt), np.diff(edges)
    columns = np.stack(
        [variances[one] * model_psd({one: 1.0}, frequency, dt, markov_time) for one in symbols], 1
    )
    scaled = columns / columns.sum(axis=1, keepdims=True) * np.sqrt(count / 2)[:, None]
    found = dict.fromkeys(symbols, np.inf)
    seen = list(range(len(symbols)))
    while seen:
        part = scaled[:, seen]
        covariance = pseudo_inverse(part.T @ part)
        relative = np.sqrt(np.diag(covariance)) / 2
        worst = int(np.argmax(relative))
        if relative[worst] <= _SEEN:
            found |= {symbols[j]: float(u) for j, u in zip(seen, relative, strict=True)}
            break
        del seen[worst]
    return found


def length_for(
    variances: dict[str, float],
    dt: float,
    symbol: str,
    relative: float,
    markov_time: float = 1.0,
) -> float:
    """Return the length of a recording, s, for u/value = `relative`; infinite beyond 30 years."""
    low, high = 16 * dt, _LONGEST
    if relative_uncertainties(variances, dt, high, markov_time).get(symbol, np.inf) > relative:
        return np.inf
    while high / low > 1.01:
        middle = float(np.sqrt(low * high))
        if relative_uncertainties(variances, dt, middle, markov_time)[symbol] > relative:
            low = middle
        else:
            high = middle
    return high
