"""Find and remove spectral lines (vibration, mains hum) before the terms are fitted.

The level of the spectrum at k is the running median of c_k² divided by 0.455, the median of χ²₁. A
coefficient belongs to a line if c_k² divided by this level exceeds the χ²₁ quantile for the
probability .0001/n. The window of the median becomes wider with k: at high k, a narrow window would
scatter, and at low k, a wide window would not follow the spectrum of drift. A line includes two
neighbours on each side, and a strong line includes all coefficients that its leakage reaches. If
the squares of several segments are averaged, χ² has as many degrees of freedom as there are
segments.
"""

from dataclasses import dataclass, replace

import numpy as np

from inercal.basics.arrays import Array
from inercal.noise.numerics import chi_squared_above
from inercal.noise.spectrum import Spectrum

_FALSE = 0.0001  # expected number of false lines in a spectrum
_NARROWEST, _WIDEST = 101, 2001  # number of coefficients in the running median
_LOWEST = 128  # below this k, the spectrum of drift is too steep for a median
_NEIGHBOURS = 2
_LEAKAGE = 0.2  # of the level; a line with power P leaks P/(π d)² to a distance d
_JOINED = 32  # largest gap within a line; a short vibration widens a line


@dataclass(frozen=True)
class SpectralLine:
    """A line: the frequency of a sinusoid, Hz, and its amplitude in the unit of the series."""

    frequency: float
    amplitude: float


def take_out_lines(spectrum: Spectrum) -> tuple[Spectrum, tuple[SpectralLine, ...]]:
    """Return the spectrum without its lines, and the lines."""
    first = max(spectrum.first, _LOWEST)
    power = spectrum.power[first - 1 : spectrum.last - 1]
    if power.size < _NARROWEST:
        return spectrum, ()
    segments = spectrum.segments
    level = running_median(power, first) / (chi_squared_above(segments, 0.5) / segments)
    limit = chi_squared_above(segments, _FALSE / power.size) / segments
    above = np.flatnonzero(power > limit * level)
    if not above.size:
        return spectrum, ()
    kept = spectrum.kept.copy()
    lines: list[SpectralLine] = []
    for group in np.split(above, np.flatnonzero(np.diff(above) > _JOINED) + 1):
        peak = float((power[group] / level[group]).max())
        reach = max(_NEIGHBOURS, int(np.sqrt(_LEAKAGE * peak)))
        low, high = max(int(group[0]) - reach, 0), int(group[-1]) + reach + 1
        kept[first - 1 + low : first - 1 + high] = False
        excess = np.maximum(power[low:high] - level[low:high], 0.0)
        place = first + low + float(excess @ np.arange(excess.size) / excess.sum())
        amplitude = np.sqrt(2 * excess.sum() / spectrum.n)
        lines.append(SpectralLine(place / (2 * spectrum.n * spectrum.dt), float(amplitude)))
    return replace(spectrum, kept=kept), tuple(lines)


def running_median(power: Array, first: int) -> Array:
    """Return the running median around each value, interpolated in logarithms.

    Parameters
    ----------
    power : (m,) array
        Squared coefficients first, first + 1, ….
    first : int
        Number k of the first coefficient. A window contains k/2 coefficients, but at least 101 and
        at most 2001.
    """
    centres: list[int] = []
    medians: list[float] = []
    k = first
    while k < first + power.size:
        half = int(np.clip(k // 4, _NARROWEST // 2, _WIDEST // 2))
        window = power[max(k - half - first, 0) : k + half + 1 - first]
        centres.append(k if k - half >= first else first + window.size // 2)
        medians.append(float(np.median(window)))
        k += max(half // 2, 1)
    logs = np.interp(np.log(np.arange(first, first + power.size)), np.log(centres), np.log(medians))
    return np.exp(logs)
