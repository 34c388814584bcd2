"""The paper's experiment repeated with noise: what each estimator makes of the same draws."""

from dataclasses import dataclass

import numpy as np

from inercal.arrays import Array
from inercal.methods.centrifuge_norm import closed
from inercal.studies.centrifuge.experiment import (
    TRUTH,
    as_printed,
    by_formulas,
    by_ml,
    draw,
    outputs,
    stated,
    steps,
)

SHARE = 20  # one trial of ml for so many of the closed formulas
_AT_ONCE = 4000
ESTIMATORS = ("paper", "series", "ml")


@dataclass(frozen=True, eq=False)
class Trials:
    """Errors of S, b, D over trials, (n, 3, 3), and without noise, (3, 3), by estimator.

    Parameters
    ----------
    error, clean : mappings of str to array
        Trials in which an estimator finds no root are left out of `error`.
    rootless : float
        Share of the trials in which `paper` has no root on some axis.
    bound : (3, 3) array
        Cramér–Rao bound of norms: the deviations that `ml` states without noise.
    chi2 : (n,) array
        Of `ml`, with `dof` degrees of freedom.
    """

    error: dict[str, Array]
    clean: dict[str, Array]
    rootless: float
    bound: Array
    chi2: Array
    dof: int

    def std(self, estimator: str) -> Array:
        """Return the standard deviations of S, b, D, (3, 3)."""
        return self.error[estimator].std(axis=0)

    def std_error(self, estimator: str) -> Array:
        """Return the Monte Carlo error of `std`, (3, 3): of a normal law, s/√(2n)."""
        return self.std(estimator) / np.sqrt(2 * len(self.error[estimator]))


def repeat(trials: int, seed: int) -> Trials:
    """Return what the estimators make of the paper's design with its stated noise.

    Parameters
    ----------
    trials : int
        Of the closed formulas; `ml` takes one in twenty, at least twenty.
    seed : int
    """
    spins = steps()
    exact = outputs(TRUTH, spins)
    noisy = draw(exact, trials, seed)
    paper = _by_formulas(closed.paper, noisy) - TRUTH.values
    possible = np.isfinite(paper).all(axis=(1, 2))
    fitted = by_ml(noisy[: max(trials // SHARE, 20)], spins)
    clean = by_ml(exact, spins)
    return Trials(
        {
            "paper": paper[possible],
            "series": _by_formulas(closed.series, noisy) - TRUTH.values,
            "ml": as_printed(fitted.value) - TRUTH.values,
        },
        {
            "paper": by_formulas(closed.paper, exact, spins) - TRUTH.values,
            "series": by_formulas(closed.series, exact, spins) - TRUTH.values,
            "ml": as_printed(clean.value) - TRUTH.values,
        },
        1 - float(possible.mean()),
        stated(clean),
        fitted.chi2,
        fitted.dof,
    )


def _by_formulas(invert: closed.Invert, noisy: Array) -> Array:
    """Return S, b, D of the trials, (n, 3, 3), so many at once that memory stays small."""
    parts = np.array_split(noisy, -(-len(noisy) // _AT_ONCE))
    return np.concatenate([by_formulas(invert, part, steps()) for part in parts])
