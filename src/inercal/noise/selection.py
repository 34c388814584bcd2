"""Which terms a recording supports, by Akaike's criterion, and which are significant.

Candidates are N, NB, NK, NBK, NG, NGK, NBG, and the best of them with quantisation. A Gauss–Markov
process counts three parameters, σ, T and the search over T: counted as two, it was added to 8 to
15 % of simulated recordings without it.

A variance lies on the boundary of its range when the term is absent, so that the likelihood ratio
2 ΔL of one term is ½χ²₀ + ½χ²₁ (Self and Liang 1987). A term is significant where every candidate
without it has a loss that is larger by half the limit below or more: not only the model without
the term, but every model that may replace it. The limit shares `LEVEL` between the terms that are
tested; that of a Gauss–Markov process also between the T that were searched.
"""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from inercal.noise.likelihood import NoiseFit, fit_terms
from inercal.noise.numerics import chi_squared_above
from inercal.noise.spectrum import Bins

CANDIDATES = ("N", "NB", "NK", "NBK", "NG", "NGK", "NBG")
LEVEL = 0.01  # probability that any term of a recording is falsely significant
RUNNERS_UP = 4.0  # of AIC, within which other models are named
_TESTED = 4  # terms besides N that share the level


@dataclass(frozen=True)
class Significance:
    """Whether a term is significant.

    Parameters
    ----------
    ratio : float
        2 ΔL to the best candidate without the term.
    limit : float
        That it must exceed.
    """

    ratio: float
    limit: float

    @property
    def is_significant(self) -> bool:
        """Whether the term is."""
        return self.ratio > self.limit


@dataclass(frozen=True, eq=False)
class Selection:
    """The chosen model and its rivals.

    Parameters
    ----------
    fit : NoiseFit
    rivals : tuple of NoiseFit
        The other candidates, the best first.
    significance : dict of str to Significance
        Of each term of the model but N.
    """

    fit: NoiseFit
    rivals: tuple[NoiseFit, ...]
    significance: dict[str, Significance]

    @property
    def runners_up(self) -> tuple[NoiseFit, ...]:
        """The rivals within 4 of AIC of the chosen model."""
        return tuple(one for one in self.rivals if one.aic - self.fit.aic <= RUNNERS_UP)


def ratio_limit(tests: int) -> float:
    """Return the limit of 2 ΔL of a variance on its boundary, where `tests` share `LEVEL`.

    Examples
    --------
    >>> round(ratio_limit(1), 2)
    5.41
    """
    return chi_squared_above(1, 2 * LEVEL / tests)


def select_terms(bins: Bins, candidates: Iterable[str] = CANDIDATES) -> Selection:
    """Return the candidate with the least AIC, its rivals, and the significance of its terms.

    Parameters
    ----------
    bins : Bins
    candidates : iterable of str
        Each the symbols of its terms.
    """
    names = tuple(candidates)
    fits = [fit_terms(bins, one) for one in names]
    best = min(fits, key=lambda one: one.aic)
    if names == CANDIDATES:
        with_steps = fit_terms(bins, ("Q", *best.symbols), _time_of(best))
        if 2 * (best.loss - with_steps.loss) > ratio_limit(_TESTED):
            fits.append(with_steps)
            best = with_steps
    rivals = sorted((one for one in fits if one is not best), key=lambda one: one.aic)
    return Selection(best, tuple(rivals), _significance(bins, best, fits))


def _time_of(fit: NoiseFit) -> float | None:
    return fit.markov_time if "G" in fit.symbols else None


def _significance(bins: Bins, best: NoiseFit, fits: list[NoiseFit]) -> dict[str, Significance]:
    tested = [one for one in best.symbols if one != "N"]
    found: dict[str, Significance] = {}
    grid = bins.times
    cells = max(1.0, float(np.log(grid[-1] / grid[0])))
    for symbol in tested:
        without = [one for one in fits if symbol not in one.symbols]
        rest = "".join(one for one in best.symbols if one != symbol)
        if rest and not any("".join(one.symbols) == rest for one in without):
            without.append(fit_terms(bins, rest))
        if not without:
            continue
        ratio = 2 * (min(one.loss for one in without) - best.loss)
        tests = _TESTED * (cells if symbol == "G" else 1)
        found[symbol] = Significance(float(ratio), ratio_limit(int(np.ceil(tests))))
    return found
