"""Slow bias drift during a recording: its covariance between the means of sections.

For noise with the two-sided spectrum S(f), the covariance of means over T_r and T_s, centred at t_r
and t_s, is ∫ S(f) sinc(f T_r) sinc(f T_s) cos 2πf(t_r − t_s) df with sinc x = sin πx / πx. Bias
instability has S = B²/(2πf) (IEEE Std 952, annex B), cut off below 1/(4 × the recording's length),
because slower noise is part of the estimated bias. A random walk K starts with the recording; its
covariance at times t and t' is K² min(t, t').
"""

from collections.abc import Sequence

import numpy as np

from inercal.basics.arrays import Array
from inercal.physics.sensors import Noise

_POINTS_A_DECADE = 400  # where the cosine varies faster than this, the sincs damp it
_BEYOND = 30.0  # cycles in the shortest section, above which the sincs are negligible


def even_drift_covariance(noise: Noise, count: int, seconds: float) -> Array:
    """Return the covariance of an axis's drift between means of equal blocks, (count, count).

    The result is as in `drift_covariance`, for equal blocks without pauses between them. The
    flicker part then depends only on the time between two blocks.

    Parameters
    ----------
    noise : Noise
    count : int
    seconds : float
        Length of a block, s.
    """
    low, high = 0.25 / (count * seconds), _BEYOND / seconds
    f: Array = np.geomspace(low, high, int(_POINTS_A_DECADE * np.log10(high / low)) + 2)
    apart = np.arange(count)
    smooth: Array = np.sinc(f * seconds) ** 2 / np.pi
    flicker = np.cos(2 * np.pi * seconds * np.outer(apart, f)) @ (_trapezoid(f) * smooth)
    middles = (apart + 0.5) * seconds
    walk = np.minimum(middles[:, None], middles)
    np.fill_diagonal(walk, middles - seconds / 6)
    between = flicker[np.abs(apart[:, None] - apart)]
    return noise.bias_instability**2 * between + noise.random_walk**2 * walk


def _trapezoid(f: Array) -> Array:
    """Return the weights for an integral over df/f = d(ln f)."""
    steps = np.diff(np.log(f))
    weight = np.zeros(f.size)
    weight[1:] += 0.5 * steps
    weight[:-1] += 0.5 * steps
    return weight


def drift_covariance(
    noises: Sequence[Noise], middles: Array, durations: Array, length: float
) -> Array | None:
    """Return the covariance between the r means in m channels, (r, r, m); None if no drift.

    Parameters
    ----------
    noises : sequence of m Noise
        Noise of each channel.
    middles, durations : (r,) arrays
        Time of the middle of each section from the start of the recording, and its duration, s;
        sections must not overlap.
    length : float
        Duration of the recording, s.
    """
    flickers = np.array([noise.bias_instability for noise in noises])
    walks = np.array([noise.random_walk for noise in noises])
    if not (flickers.any() or walks.any()):
        return None
    low, high = 0.25 / length, _BEYOND / float(durations.min())
    points = int(_POINTS_A_DECADE * np.log10(high / low)) + 2
    f: Array = np.geomspace(low, high, points)
    smooth: Array = np.sinc(f * durations[:, None])
    i, j = np.triu_indices(middles.size)
    apart = np.outer(middles[j] - middles[i], 2 * np.pi * f)
    flicker = np.empty((middles.size, middles.size))
    # The factor 2 accounts for negative frequencies.
    weight = _trapezoid(f) / np.pi
    flicker[i, j] = flicker[j, i] = (smooth[i] * smooth[j] * np.cos(apart)) @ weight
    walk = np.minimum(middles[:, None], middles)
    # Within a section, the average of min(t, t') is its start plus a third of its length.
    np.fill_diagonal(walk, middles - durations / 6)
    return flicker[..., None] * flickers**2 + walk[..., None] * walks**2
