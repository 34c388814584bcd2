"""Estimate white noise from low frequencies only, if no filter explains the high frequencies.

The band starts at the lowest frequencies and grows by half octaves. In each step, N, B and K are
fitted to the band, and the next half octave is compared with the fit. The band ends when this half
octave differs from the fit by 3.3 times its standard uncertainty. At this point, the spectrum has
already departed a little, and N would be a few per cent too small. The band that is used therefore
ends two half octaves earlier, and 1 % is added to the uncertainty of N.
"""

from collections.abc import Sequence

import numpy as np

from inercal.noise.likelihood import fit_terms
from inercal.noise.spectrum import Bins

ADDED_RELATIVE_U = 0.01  # of N
_DEPARTS = 3.3  # standard uncertainties of a significant difference
_BACK = 2  # half octaves
_FEWEST = 256  # least number of coefficients in the lowest band
_LARGEST_U = 0.2  # largest relative uncertainty of N
_PLATEAU = 3.0  # the band must reach this multiple of the white-noise/flicker crossing frequency


def band_below(bins: Bins, symbols: Sequence[str]) -> Bins | None:
    """Return the bins of the band that N, B and K describe; None if there is no such band.

    Parameters
    ----------
    bins : Bins
        Bins without a filter.
    symbols : sequence of str
        Terms to fit, including N.
    """
    order = np.argsort(bins.frequency, kind="stable")
    enough = np.searchsorted(np.cumsum(bins.weight[order]), _FEWEST)
    if enough >= order.size:
        return None
    first = float(bins.frequency[order[enough]])
    top = float(bins.frequency.max())
    count = int(np.ceil(2 * np.log2(max(top / first, 1.0))))
    edges = first * 2 ** (np.arange(count + 1) / 2)
    for k, edge in enumerate(edges[:-1]):
        inner, outer = bins.below(edge), bins.below(edges[k + 1])
        fit = fit_terms(inner, symbols)
        new = outer.frequency >= edge
        if not new.any():
            continue
        basis = np.stack([outer.basis(one)[new] for one in symbols], axis=1)
        model = basis @ fit.variances
        weight = outer.weight[new]
        share = weight / model / weight.sum()
        ratio = float(share @ outer.power[new])
        slope = share @ basis
        variance = float((2 * weight).sum() / weight.sum() ** 2 + slope @ fit.covariance @ slope)
        if abs(ratio - 1) > _DEPARTS * np.sqrt(variance):
            return _kept(bins, symbols, edge / 2 ** (_BACK / 2))
    return None


def _kept(bins: Bins, symbols: Sequence[str], edge: float) -> Bins | None:
    """Return the bins below a frequency; None if these bins do not determine N."""
    band = bins.below(edge)
    if band.power.size < 2 * len(symbols):
        return None
    fit = fit_terms(band, symbols)
    white = fit.variance("N")
    j = fit.symbols.index("N")
    if not white or np.sqrt(fit.covariance[j, j]) / (2 * white) > _LARGEST_U:
        return None
    crossing = fit.variance("B") / (2 * np.pi * white)
    return band if edge > _PLATEAU * crossing else None
