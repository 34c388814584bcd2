"""List the methods of the study, with the priors that each uses.

The patent's empirical Bayes is a prior from tests of single accelerometers. It is made from
calibration files, as by `inercal prior`.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from inercal.basics.arrays import Array
from inercal.benches.dividing_head.bench import CollimationMode, Index, mounted_sensor
from inercal.calibration import Calibration
from inercal.calibration.files import save
from inercal.estimation import Estimate, Gaussian
from inercal.laboratory.type_prior import type_prior
from inercal.methods.dual_orthogonal import dual, joint, patent, single
from inercal.physics.sensors import Sensor
from inercal.runfile.priors import type_prior_of
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

CENTRIFUGE_K3_SD = 0.5 * MICRO  # g, uncertainty of K3 from a centrifuge
SINGLE_TESTS = 5  # number of single tests for the Kip of `dual`; the source uses several
_TYPE_SEED = 101852817  # added to the seed for tests of other accelerometers


@dataclass(frozen=True)
class StudiedMethod:
    """A method in the table.

    Parameters
    ----------
    collimated : "pairs", "every" or "none"
        Positions that the autocollimator reads.
    estimator : callable
        Estimator from `methods.dual_orthogonal`.
    priors : callable
        Function that returns priors in addition to the readings.
    """

    collimated: CollimationMode
    estimator: Callable[..., Estimate]
    priors: Callable[[DividingHeadCase], Sequence[Gaussian]]

    def __call__(self, case: DividingHeadCase) -> Estimate:
        """Return the estimate for a case."""
        return self.estimator(case.observations, SENSOR, case.bench, case.steps, self.priors(case))


def _no_priors(_: DividingHeadCase) -> Sequence[Gaussian]:
    return ()


def _production_priors(case: DividingHeadCase) -> Sequence[Gaussian]:
    """Return priors for Kip and K3 from the typical values of such accelerometers."""
    return case.production_prior("kip", SIZES["kip"]), case.production_prior("k3", SIZES["k3"])


def _centrifuge_priors(case: DividingHeadCase) -> Sequence[Gaussian]:
    """Return priors: Kip from typical values, and K3 from a centrifuge."""
    return case.production_prior("kip", SIZES["kip"]), case.measured_prior("k3", CENTRIFUGE_K3_SD)


def _single_test_priors(case: DividingHeadCase) -> Sequence[Gaussian]:
    """Return priors: Kip from several twelve-position tests, and K3 from a centrifuge."""
    test = simulate(case.bench, 1, case.seed)
    once = single(test.observations, SENSOR, test.bench, test.steps).select(["a.kip"]).std
    sd = float(np.max(once)) / NATURAL_UNITS["kip"] / np.sqrt(SINGLE_TESTS)
    return case.measured_prior("kip", sd), case.measured_prior("k3", CENTRIFUGE_K3_SD)


def _type_priors(case: DividingHeadCase) -> Sequence[Gaussian]:
    """Return priors: Kip from files of other accelerometers of the type, K3 from a centrifuge."""
    others = simulate(nominal_bench(collimated="none"), SINGLE_TESTS, case.seed + _TYPE_SEED)
    tests = single(others.observations, SENSOR, others.bench, others.steps)
    return prior_from_files(tests, ("kip",), SENSOR), case.measured_prior("k3", CENTRIFUGE_K3_SD)


def prior_from_files(tests: Estimate, terms: Sequence[str], sensor: Sensor) -> Gaussian:
    """Return the prior of a sensor, made in the same way as by `inercal prior`.

    Parameters
    ----------
    tests : Estimate
        Estimates of other accelerometers of the type, one for each test; the first axis is used.
    terms : sequence of str
    sensor : Sensor
    """
    axis = sensor.channels[0]
    picks = [k for k, name in enumerate(tests.names) if name.startswith(f"{axis}.")]
    with TemporaryDirectory() as folder:
        files: list[Path] = []
        for k, (value, covariance) in enumerate(zip(tests.value, tests.covariance, strict=True)):
            one = mounted_sensor(f"test {k + 1}", (axis,)).with_coefficients(
                *(tests.names[pick] for pick in picks)
            )
            found = Calibration(
                one, value[picks], covariance[np.ix_(picks, picks)], "tumble", "single", shared=()
            )
            files.append(save(found, Path(folder) / f"{k + 1}.calibration.json"))
        return type_prior_of(type_prior(files, terms).save(f"{folder}/type.prior.toml"), sensor)


EVERY_FACE = "joint, every face"
METHODS = {
    "single": StudiedMethod("none", single, _no_priors),
    "dual, Bayes": StudiedMethod("none", dual, _single_test_priors),
    "patent": StudiedMethod("pairs", patent, _centrifuge_priors),
    "patent, no centrifuge": StudiedMethod("pairs", patent, _production_priors),
    "dual, empirical Bayes": StudiedMethod("none", dual, _type_priors),
    "patent, empirical Bayes": StudiedMethod("pairs", patent, _type_priors),
    "joint": StudiedMethod("pairs", joint, _production_priors),
    EVERY_FACE: StudiedMethod("every", joint, _production_priors),
}
"""Methods by name; dual and patent use K3 from a centrifuge unless their name excludes it."""


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
    """Return the errors of a method by `COLUMNS`.

    Parameters
    ----------
    name : str
        Name of a method in `METHODS`.
    trials, seed : int
    steps : sequence of Index, optional
        Positions; by default twelve.
    head, pier : float
        Standard deviations of the head and of the base's tilt, ″.
    sizes, noise
        As in `simulate`.

    Raises
    ------
    NotObserved
        The method cannot use these steps.
    """
    method = METHODS[name]
    drawn = replace(nominal_bench(head, method.collimated), pier=pier * ARCSEC)
    case = simulate(drawn, trials, seed, steps, sizes=sizes, noise=noise)
    return estimate_errors(method(case), case)
