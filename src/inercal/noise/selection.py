"""Select the terms that a recording supports, by Akaike's criterion, and test their significance.

The candidates are N, NB, NK, NBK, NG, NGK and NBG. If quantisation makes the fit significantly
better, each candidate is also tried with quantisation. A Gauss–Markov process counts as three
parameters: σ, T and the search over T. If it counted as two, it would be found in 8 to 15 % of
simulated recordings that do not contain it. A candidate with T at an end of the tried values is
discarded, because such a process looks like white noise or a random walk in the recording. A
process that is not significant is also discarded.

If a term is absent, its variance is on the boundary of its range. The likelihood ratio 2 ΔL of one
term is then distributed as ½χ²₀ + ½χ²₁ (Self and Liang 1987). A term is present if, for every
candidate without the term, 2 ΔL is above a limit. For a model without a Gauss–Markov process,
candidates with such a process are not considered in this test. However, the process sometimes
describes flicker or a random walk equally well. B or K is therefore significant only if the process
does not describe the recording better. The probability of a false detection is `LEVEL` for B and
for K. For Q and G, `LEVEL` is divided by the number of tested terms, and for G also by the number
of searched values of T.
"""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from inercal.noise.likelihood import NoiseFit, fit_terms
from inercal.noise.numerics import chi_squared_above
from inercal.noise.spectrum import Bins

CANDIDATES = ("N", "NB", "NK", "NBK", "NG", "NGK", "NBG")
LEVEL = 0.01  # probability that a term is wrongly found significant
_TESTED = 4  # number of terms, except N, that share `LEVEL` for Q and G
_EDGE = 1.1  # factor around the shortest and the longest T


@dataclass(frozen=True)
class Significance:
    """Result of the significance test for a term.

    Parameters
    ----------
    ratio : float
        2 ΔL relative to the best candidate without the term.
    limit : float
        Limit that the ratio must exceed.
    is_replaced : bool
        Whether a Gauss–Markov process in place of the term fits better, although the process has
        two additional parameters.
    """

    ratio: float
    limit: float
    is_replaced: bool = False

    @property
    def is_present(self) -> bool:
        """Whether the noise that the term describes is present."""
        return self.ratio > self.limit

    @property
    def is_significant(self) -> bool:
        """Whether the term is present and no Gauss–Markov process fits better in its place."""
        return self.is_present and not self.is_replaced


@dataclass(frozen=True, eq=False)
class Selection:
    """The chosen model and the other candidates.

    Parameters
    ----------
    fit : NoiseFit
    rivals : tuple of NoiseFit
        The other candidates, in order; the best comes first.
    significance : dict of str to Significance
        Significance of each term of the model except N.
    is_asked : bool
        Whether the user requested the terms.
    """

    fit: NoiseFit
    rivals: tuple[NoiseFit, ...]
    significance: dict[str, Significance]
    is_asked: bool = False


def ratio_limit(tests: int) -> float:
    """Return the limit of 2 ΔL for a variance on its boundary, if several tests share `LEVEL`.

    Examples
    --------
    >>> round(ratio_limit(1), 2)
    5.41
    """
    return chi_squared_above(1, 2 * LEVEL / tests)


def select_terms(bins: Bins, candidates: Iterable[str] = CANDIDATES) -> Selection:
    """Select the candidate with the smallest AIC, and test the significance of its terms.

    Parameters
    ----------
    bins : Bins
    candidates : iterable of str
        Candidates, each given by the symbols of its terms.
    """
    names = tuple(candidates)
    fits = [fit_terms(bins, one) for one in names]
    if names == CANDIDATES:
        fits = [one for one in fits if not is_time_limit(bins, one)]
        if bins.output is None:  # with a filter, the read-out floor includes quantisation
            fits += _with_quantisation(bins, fits)
    best = min(fits, key=lambda one: one.aic)
    significance = _significance(bins, best, fits)
    if names == CANDIDATES and "G" in best.symbols and not significance["G"].is_significant:
        best = min((one for one in fits if "G" not in one.symbols), key=lambda one: one.aic)
        significance = _significance(bins, best, fits)
    rivals = sorted((one for one in fits if one is not best), key=lambda one: one.aic)
    return Selection(best, tuple(rivals), significance, len(names) == 1)


def is_time_limit(bins: Bins, fit: NoiseFit) -> bool:
    """Return whether T is at an end of the tried values (like white noise or a random walk)."""
    if "G" not in fit.symbols:
        return False
    shortest, longest = bins.times[[0, -1]]
    return not shortest * _EDGE < fit.markov_time < longest / _EDGE


def _with_quantisation(bins: Bins, fits: list[NoiseFit]) -> list[NoiseFit]:
    """Return the candidates with quantisation, if the best of them is significantly better.

    If Q is present, the best model without Q has too many or too few terms, so all candidates are
    tried again with Q. To save time, Q is first added only to the largest and to the best model.
    The others are tried if one of these two improves.
    """
    best = min(fits, key=lambda one: one.aic)
    limit = min(one.loss for one in fits) - ratio_limit(_TESTED) / 2
    full = next(one for one in fits if one.symbols == ("N", "B", "K"))
    found = {one.symbols: _add_quantisation(bins, one) for one in (full, best)}
    if min(one.loss for one in found.values()) > limit:
        return []
    for one in fits:
        if one.symbols not in found:
            found[one.symbols] = _add_quantisation(bins, one)
    # A model without Q must not be preferred only because it has fewer terms.
    return [one for one in found.values() if one.loss <= limit]


def _add_quantisation(bins: Bins, fit: NoiseFit) -> NoiseFit:
    return fit_terms(bins, ("Q", *fit.symbols), fit.markov_time if "G" in fit.symbols else None)


def _significance(bins: Bins, best: NoiseFit, fits: list[NoiseFit]) -> dict[str, Significance]:
    found: dict[str, Significance] = {}
    grid = bins.times
    cells = max(1.0, float(np.log(grid[-1] / grid[0])))
    for symbol in best.symbols:
        if symbol == "N":
            continue
        without = [one for one in fits if symbol not in one.symbols]
        others = [one for one in without if "G" in one.symbols and "G" not in best.symbols]
        without = [one for one in without if one not in others]
        rest = "".join(one for one in best.symbols if one != symbol)
        if rest and not any("".join(one.symbols) == rest for one in without):
            without.append(fit_terms(bins, rest))
        if not without:
            continue
        ratio = 2 * (min(one.loss for one in without) - best.loss)
        replaced = min((one.loss for one in others), default=np.inf) < best.loss
        limit = significance_limit(symbol, cells)
        found[symbol] = Significance(float(ratio), limit, bool(replaced))
    return found


def significance_limit(symbol: str, cells: float = 1.0) -> float:
    """Return the limit of 2 ΔL for a term.

    Parameters
    ----------
    symbol : str
    cells : float
        Number of distinct values of T that were searched for a Gauss–Markov process.
    """
    if symbol in "BK":
        return ratio_limit(1)
    return ratio_limit(int(np.ceil(_TESTED * (cells if symbol == "G" else 1))))
