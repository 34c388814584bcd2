"""The paper's experiment repeated with noise: all estimators on the same draws."""

from dataclasses import dataclass

import numpy as np

from inercal.basics.arrays import Array
from inercal.methods.centrifuge_norm import closed_formulas
from inercal.studies.centrifuge.simulated_centrifuge import (
    TRUTH,
    closed_form_estimate,
    coefficients_as_printed,
    ml_estimate,
    noisy_outputs,
    outputs,
    stated_deviations,
    steps,
)

ML_TRIAL_RATIO = 20  # one trial of ml for so many of the closed formulas
_BATCH = 4000
ESTIMATORS = ("paper", "series", "ml")


@dataclass(frozen=True, eq=False)
class CentrifugeTrials:
    """Errors of S, b, D over trials, (n, 3, 3), and without noise, (3, 3), by estimator.

    Parameters
    ----------
    error, noise_free : mappings of str to array
        Trials in which an estimator finds no root are left out of `error`.
    rootless : float
        Share of the trials in which `paper` has no root on some axis.
    bound : (3, 3) array
        Cramér–Rao bound of norms: the deviations that `ml` states without noise.
    chi2 : (n,) array
        Of `ml`, with `dof` degrees of freedom.
    """

    error: dict[str, Array]
    noise_free: dict[str, Array]
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


def repeat_experiment(trials: int, seed: int) -> CentrifugeTrials:
    """Return what the estimators make of the paper's design with its stated noise.

    Parameters
    ----------
    trials : int
        Of the closed formulas; `ml` takes one in twenty, at least twenty.
    seed : int
    """
    spins = steps()
    exact = outputs(TRUTH, spins)
    noisy = noisy_outputs(exact, trials, seed)
    paper = _closed_form_estimates(closed_formulas.paper, noisy) - TRUTH.values
    possible = np.isfinite(paper).all(axis=(1, 2))
    fitted = ml_estimate(noisy[: max(trials // ML_TRIAL_RATIO, 20)], spins)
    clean = ml_estimate(exact, spins)
    return CentrifugeTrials(
        {
            "paper": paper[possible],
            "series": _closed_form_estimates(closed_formulas.series, noisy) - TRUTH.values,
            "ml": coefficients_as_printed(fitted.value) - TRUTH.values,
        },
        {
            "paper": closed_form_estimate(closed_formulas.paper, exact, spins) - TRUTH.values,
            "series": closed_form_estimate(closed_formulas.series, exact, spins) - TRUTH.values,
            "ml": coefficients_as_printed(clean.value) - TRUTH.values,
        },
        1 - float(possible.mean()),
        stated_deviations(clean),
        fitted.chi2,
        fitted.dof,
    )


def _closed_form_estimates(invert: closed_formulas.SeriesInverse, noisy: Array) -> Array:
    """Return S, b, D of the trials, (n, 3, 3), so many at once that memory stays small."""
    parts = np.array_split(noisy, -(-len(noisy) // _BATCH))
    return np.concatenate([closed_form_estimate(invert, part, steps()) for part in parts])
