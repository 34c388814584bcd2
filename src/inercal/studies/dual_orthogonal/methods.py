"""The methods compared: what each reads, how it estimates, and what it is told from elsewhere."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from inercal.arrays import Array
from inercal.benches.dividing_head.bench import Collimated, Index
from inercal.estimate import Estimate, Gaussian
from inercal.methods.dual_orthogonal import dual, joint, patent, single
from inercal.studies.dual_orthogonal.experiment import (
    ARCSEC,
    HEAD,
    MICRO,
    NATURAL,
    NOISE,
    SENSOR,
    SIZES,
    Case,
    bench,
    errors,
    simulate,
)

CENTRIFUGE = 0.5 * MICRO  # g, how well a centrifuge knows K3
TESTS = 5  # single tests behind the Kip of `dual`; the source has several


@dataclass(frozen=True)
class Method:
    """A method of the table.

    Parameters
    ----------
    collimated : "pairs", "every" or "none"
        What the autocollimator reads.
    estimator : callable
        Of `methods.dual_orthogonal`.
    priors : callable
        What is told besides the readings.
    """

    collimated: Collimated
    estimator: Callable[..., Estimate]
    priors: Callable[[Case], Sequence[Gaussian]]

    def __call__(self, case: Case) -> Estimate:
        """Return the estimate."""
        return self.estimator(case.seen, SENSOR, case.bench, case.steps, self.priors(case))


def _nothing(_: Case) -> Sequence[Gaussian]:
    return ()


def _make(case: Case) -> Sequence[Gaussian]:
    """Return what the make tells of Kip and K3: the size of either."""
    return case.made("kip", SIZES["kip"]), case.made("k3", SIZES["k3"])


def _centrifuge(case: Case) -> Sequence[Gaussian]:
    """Return the make's Kip, and K3 of a centrifuge."""
    return case.made("kip", SIZES["kip"]), case.measured("k3", CENTRIFUGE)


def _elsewhere(case: Case) -> Sequence[Gaussian]:
    """Return Kip of several single tests of twelve positions, and K3 of a centrifuge."""
    test = simulate(case.bench, 1, case.seed)
    once = single(test.seen, SENSOR, test.bench, test.steps).select(["a.kip"]).std
    sd = float(np.max(once)) / NATURAL["kip"] / np.sqrt(TESTS)
    return case.measured("kip", sd), case.measured("k3", CENTRIFUGE)


FACES = "joint, every face"
METHODS = {
    "single": Method("none", single, _nothing),
    "dual, Bayes": Method("none", dual, _elsewhere),
    "patent": Method("pairs", patent, _centrifuge),
    "patent, no centrifuge": Method("pairs", patent, _make),
    "joint": Method("pairs", joint, _make),
    FACES: Method("every", joint, _make),
}
"""By name; the second and the third have K3 of a centrifuge."""


def tried(
    name: str,
    trials: int,
    seed: int,
    steps: Sequence[Index] | None = None,
    *,
    head: float = HEAD,
    pier: float = 0.0,
    sizes: dict[str, float] = SIZES,
    noise: float = NOISE,
) -> dict[str, Array]:
    """Return the errors that a method makes, by `COLUMNS`.

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
    drawn = replace(bench(head, method.collimated), pier=pier * ARCSEC)
    case = simulate(drawn, trials, seed, steps, sizes=sizes, noise=noise)
    return errors(method(case), case)
