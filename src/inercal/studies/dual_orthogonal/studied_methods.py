"""The compared methods: their readings, their estimators, and their priors."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from inercal.basics.arrays import Array
from inercal.benches.dividing_head.bench import CollimationMode, Index
from inercal.estimation import Estimate, Gaussian
from inercal.methods.dual_orthogonal import dual, joint, patent, single
from inercal.studies.dual_orthogonal.simulated_head import (
    ARCSEC,
    HEAD_ERROR,
    MICRO,
    NATURAL_UNITS,
    NOISE,
    SENSOR,
    SIZES,
    DividingHeadCase,
    estimate_errors,
    nominal_bench,
    simulate,
)

CENTRIFUGE_K3_SD = 0.5 * MICRO  # g, how well a centrifuge knows K3
SINGLE_TESTS = 5  # single tests behind the Kip of `dual`; the source has several


@dataclass(frozen=True)
class StudiedMethod:
    """A method of the table.

    Parameters
    ----------
    collimated : "pairs", "every" or "none"
        What the autocollimator reads.
    estimator : callable
        Of `methods.dual_orthogonal`.
    priors : callable
        Priors in addition to the readings.
    """

    collimated: CollimationMode
    estimator: Callable[..., Estimate]
    priors: Callable[[DividingHeadCase], Sequence[Gaussian]]

    def __call__(self, case: DividingHeadCase) -> Estimate:
        """Return the estimate."""
        return self.estimator(case.observations, SENSOR, case.bench, case.steps, self.priors(case))


def _no_priors(_: DividingHeadCase) -> Sequence[Gaussian]:
    return ()


def _production_priors(case: DividingHeadCase) -> Sequence[Gaussian]:
    """Return the priors of Kip and K3 by the typical values of such accelerometers."""
    return case.production_prior("kip", SIZES["kip"]), case.production_prior("k3", SIZES["k3"])


def _centrifuge_priors(case: DividingHeadCase) -> Sequence[Gaussian]:
    """Return the make's Kip, and K3 of a centrifuge."""
    return case.production_prior("kip", SIZES["kip"]), case.measured_prior("k3", CENTRIFUGE_K3_SD)


def _single_test_priors(case: DividingHeadCase) -> Sequence[Gaussian]:
    """Return Kip of several single tests of twelve positions, and K3 of a centrifuge."""
    test = simulate(case.bench, 1, case.seed)
    once = single(test.observations, SENSOR, test.bench, test.steps).select(["a.kip"]).std
    sd = float(np.max(once)) / NATURAL_UNITS["kip"] / np.sqrt(SINGLE_TESTS)
    return case.measured_prior("kip", sd), case.measured_prior("k3", CENTRIFUGE_K3_SD)


EVERY_FACE = "joint, every face"
METHODS = {
    "single": StudiedMethod("none", single, _no_priors),
    "dual, Bayes": StudiedMethod("none", dual, _single_test_priors),
    "patent": StudiedMethod("pairs", patent, _centrifuge_priors),
    "patent, no centrifuge": StudiedMethod("pairs", patent, _production_priors),
    "joint": StudiedMethod("pairs", joint, _production_priors),
    EVERY_FACE: StudiedMethod("every", joint, _production_priors),
}
"""By name; the second and the third have K3 of a centrifuge."""


def method_errors(
    name: str,
    trials: int,
    seed: int,
    steps: Sequence[Index] | None = None,
    *,
    head: float = HEAD_ERROR,
    pier: float = 0.0,
    sizes: dict[str, float] = SIZES,
    noise: float = NOISE,
) -> dict[str, Array]:
    """Return the errors of a method, by `COLUMNS`.

    Parameters
    ----------
    name : str
        Of `METHODS`.
    trials, seed : int
    steps : sequence of Index, optional
        By default twelve positions.
    head, pier : float
        Deviations of the head and of the base's tilt, ″.
    sizes, noise
        As of `simulate`.

    Raises
    ------
    NotObserved
        Steps that the method cannot do with.
    """
    method = METHODS[name]
    drawn = replace(nominal_bench(head, method.collimated), pier=pier * ARCSEC)
    case = simulate(drawn, trials, seed, steps, sizes=sizes, noise=noise)
    return estimate_errors(method(case), case)
