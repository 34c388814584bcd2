"""What each imperfection contributes to each coefficient, to first order and by Monte Carlo.

First order (GUM, JCGM 100:2008, 5.1): c_k = ∂E/∂z_k by central differences over one standard
deviation, so that an effect that is lost in rounding there is none; the draws of one imperfection
are added in squares, and so are the imperfections. Monte Carlo (GUM Supplement 1, JCGM 101:2008,
clause 7): each imperfection is drawn alone, then all together; the same draws serve both.

The two differ where an estimate depends on an error by more than its first order, or where errors
act on one another.
"""

from collections.abc import Callable, Sequence

import numpy as np

from inercal.arrays import Array
from inercal.budget.imperfections import NOISE
from inercal.budget.virtual_experiment import Experiment
from inercal.uncertainty import monte_carlo
from inercal.uncertainty.monte_carlo import BATCH

ProgressCallback = Callable[[int, int], None]
ALL_IMPERFECTIONS = "together"


def first_order_contributions(
    experiment: Experiment, progress: ProgressCallback | None = None
) -> dict[str, Array]:
    """Return the contribution of each imperfection by name, (p,) SI standard deviations."""
    n, z = experiment.size, experiment.expansion_point
    shifted = np.concatenate([z + np.eye(n), z - np.eye(n)])
    parts: list[Array] = []
    for k in range(0, 2 * n, BATCH):
        parts.append(experiment(shifted[k : k + BATCH]))
        if progress:
            progress(min(k + BATCH, 2 * n), 2 * n)
    estimates = np.concatenate(parts)
    by_draw = (estimates[:n] - estimates[n:]) / 2
    return {
        name: np.sqrt(np.sum(by_draw[columns] ** 2, axis=0))
        for name, columns in experiment.draw_columns.items()
    }


def monte_carlo_estimates(
    experiment: Experiment, trials: int, seed: int, progress: ProgressCallback | None = None
) -> dict[str, Array]:
    """Return the estimates, (trials, p) SI, by the name of the imperfection that alone is drawn.

    Those with all of them drawn are `ALL_IMPERFECTIONS`.

    Parameters
    ----------
    experiment : Experiment
    trials : int
    seed : int
    progress : callable, optional
        Told the trials done and those in all.
    """

    def run(rng: np.random.Generator, count: int) -> dict[str, Array]:
        z = rng.standard_normal((count, experiment.size))
        found: dict[str, Array] = {}
        for name, columns in experiment.draw_columns.items():
            alone = np.tile(experiment.expansion_point, (count, 1))
            alone[:, columns] = z[:, columns]
            found[name] = experiment(alone)
        # With no other imperfection, alone is together.
        found[ALL_IMPERFECTIONS] = found[NOISE] if len(found) == 1 else experiment(z)
        return found

    return monte_carlo(run, trials, seed, progress=progress)


def sample_deviation(estimates: Array) -> tuple[Array, Array]:
    """Return the standard deviation of (trials, p) and its standard error, (p,) each.

    The error is that of any distribution with a fourth moment, √(m₄ − s⁴ (n−3)/(n−1)) / (2 s √n);
    of a normal one it is s / √(2n).
    """
    n = len(estimates)
    sd = np.std(estimates, axis=0, ddof=1)
    centred = np.where(sd > 0, (estimates - estimates.mean(axis=0)) / np.where(sd > 0, sd, 1), 0)
    fourth = np.mean(centred**4, axis=0)
    return sd, sd * np.sqrt(np.maximum(fourth - (n - 3) / (n - 1), 0) / n) / 2


def root_sum_of_squares(parts: Sequence[Array]) -> Array:
    """Return the root of the sum of squares of arrays (p,)."""
    return np.sqrt(np.sum(np.square(parts), axis=0))
