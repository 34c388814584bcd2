"""Simulate the bench: a dividing head with two perpendicular accelerometers.

The bench model gives the specific force (`benches.dividing_head.sensed_motion`), and the sensor
model gives the readings. Each error is drawn by its name, so benches with other error sizes use the
same random numbers.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from math import pi
from pathlib import Path
from tempfile import TemporaryDirectory
from zlib import crc32

import numpy as np

from inercal.basics.arrays import Array
from inercal.basics.keys import CoefficientName
from inercal.basics.units import Measured
from inercal.benches.dividing_head.bench import (
    CollimationMode,
    DividingHead,
    Index,
    mounted_sensor,
    position_plan,
    sensed_motion,
)
from inercal.calibration import Calibration
from inercal.calibration.files import save
from inercal.estimation import Estimate, Gaussian
from inercal.laboratory.type_prior import type_prior
from inercal.methods.dual_orthogonal import dual, joint, patent, single
from inercal.physics.motion import Motion
from inercal.physics.sensors import G0, Sensor
from inercal.recordings import Observations
from inercal.runfile.priors import type_prior_of
from inercal.studies.claim import Rms

ARCSEC = pi / 648_000  # rad
MICRO = 1e-6
SENSOR = mounted_sensor().with_coefficients("k0", "k1", "k2", "k3", "kip", "delta_o")
NOISE = 0.2e-6  # g, noise of each reading
HEAD_ERROR = 3.0  # ″ rms
# Shares of the head's variance: one turn, half a turn, graduations.
VARIANCE_SHARES = (0.4, 0.3, 0.3)
AUTOCOLLIMATOR = 0.1  # ″, noise of each reading
HEAD_ZERO, SPINDLE_LEAN = 5.0, 20.0  # ″

SIZES = {  # coefficients of the accelerometers, 1σ in their customary units
    "k0": 300e-6,
    "k1": 200e-6,
    "delta_o": 100 * ARCSEC,
    "k2": 10e-6,
    "k3": 5e-6,
    "kip": 20e-6,
}
LARGE_SIZES = SIZES | {"k0": 1e-3, "k1": 1e-3, "delta_o": 300 * ARCSEC}
NATURAL_UNITS = {"k0": G0, "k1": 1.0, "delta_o": 1.0, "k2": 1 / G0, "k3": 1 / G0**2, "kip": 1 / G0}
COLUMNS = ("K0", "k1", "δ", "K2", "K3", "Kip", "k1 + K3")
"""The quantities to be judged, in µg (ppm, µrad); δ is the angle between the axes."""
JUDGED_COLUMNS = ("K0", "k1 + K3", "δ", "K2", "Kip")
"""The quantities that the bench determines without K3 from other measurements."""


def nominal_bench(head: float = HEAD_ERROR, collimated: CollimationMode = "pairs") -> DividingHead:
    """Return the bench with a head error of `head` arc seconds rms."""
    first, second, rest = head * ARCSEC * np.sqrt(VARIANCE_SHARES)
    return DividingHead(
        Measured(G0, 0.0),
        (float(first), float(second)),
        float(rest),
        AUTOCOLLIMATOR * ARCSEC,
        collimated,
        base=HEAD_ZERO * ARCSEC,
        lean=SPINDLE_LEAN * ARCSEC,
    )


def standard_normal_draws(seed: int, name: str, shape: tuple[int, ...]) -> Array:
    """Return standard normal numbers, which depend only on the seed, the name and the shape."""
    return np.random.default_rng([seed, crc32(name.encode())]).standard_normal(shape)


@dataclass(frozen=True, eq=False)
class DividingHeadCase:
    """One bench with the readings from many trials.

    Parameters
    ----------
    observations : Observations
        Readings, (trials, r, 2), m/s².
    bench : DividingHead
        The bench as the estimators know it.
    steps : sequence of r Index
    truth : mapping of str to (trials, 2) array
        Coefficients of a and b by term, in customary units.
    seed : int
    """

    observations: Observations
    bench: DividingHead
    steps: Sequence[Index]
    truth: dict[str, Array]
    seed: int

    def production_prior(self, term: str, sd: float) -> Gaussian:
        """Return the prior of a coefficient from typical values: mean 0, sd in customary units."""
        return self._prior(term, np.zeros(2), sd)

    def measured_prior(self, term: str, sd: float) -> Gaussian:
        """Return the prior of a coefficient from another test, with standard deviation sd."""
        truth = self.truth[term]
        off = sd * standard_normal_draws(self.seed, f"{term} elsewhere", truth.shape)
        return self._prior(term, truth + off, sd)

    def _prior(self, term: str, mean: Array, sd: float) -> Gaussian:
        unit = NATURAL_UNITS[term]
        return Gaussian.independent((f"a.{term}", f"b.{term}"), mean * unit, sd * unit)

    @property
    def true_values(self) -> Array:
        """Return the true coefficients in the order of the sensor's, (trials, 12) SI."""
        return coefficient_vector(self.truth)


def coefficient_vector(truth: dict[str, Array]) -> Array:
    """Convert coefficients by term, (..., 2), to those of the sensor, (..., 12) SI."""
    parts = [CoefficientName(name).parts for name in SENSOR.coefficients]
    columns = [NATURAL_UNITS[term] * truth[term][..., "ab".index(axis)] for axis, term in parts]
    return np.stack(columns, axis=-1)


def simulate(
    drawn: DividingHead,
    trials: int,
    seed: int,
    steps: Sequence[Index] | None = None,
    *,
    stated: DividingHead | None = None,
    sizes: dict[str, float] = SIZES,
    noise: float = NOISE,
) -> DividingHeadCase:
    """Simulate the readings for a number of trials.

    Parameters
    ----------
    drawn : DividingHead
        Bench with the sizes of its errors.
    trials, seed : int
    steps : sequence of Index, optional
        Positions; by default twelve.
    stated : DividingHead, optional
        The bench as the estimators know it, if it differs.
    sizes : dict of str to float
        Standard deviations of the coefficients.
    noise : float
        Noise of each reading, g. If it is 0, the estimators assume the usual noise.
    """
    steps = position_plan(12) if steps is None else steps
    r = len(steps)
    truth = {
        term: size * standard_normal_draws(seed, term, (trials, 2)) for term, size in sizes.items()
    }
    q = {
        name: parameter.value + parameter.sd * standard_normal_draws(seed, name, (trials,))
        for name, parameter in drawn.simulated_parameters(steps).items()
    }
    exact = SENSOR.forward(Motion(sensed_motion(drawn, steps, q).f), coefficient_vector(truth))
    each = [standard_normal_draws(seed, f"noise[{step.label}]", (trials, 2)) for step in steps]
    sd = G0 * (noise or NOISE)
    seen = Observations(
        tuple(step.label for step in steps),
        exact + noise * G0 * np.stack(each, axis=1),
        np.broadcast_to(sd**2 * np.eye(2), (r, 2, 2)),
        np.ones(r),
        np.ones(r, dtype=np.int64),
        np.arange(r, dtype=float),
        SENSOR.channels,
    )
    return DividingHeadCase(seen, stated or drawn, steps, truth, seed)


def estimate_errors(found: Estimate, case: DividingHeadCase) -> dict[str, Array]:
    """Return the errors by `COLUMNS`, (trials, 2) or (trials,), in µg."""
    off: dict[str, Array] = {}
    for term in SIZES:
        value = found.select([f"{axis}.{term}" for axis in "ab"]).value / NATURAL_UNITS[term]
        off[term] = (value - case.truth[term]) / MICRO
    delta = off["delta_o"][:, 1] - off["delta_o"][:, 0]
    values = (off["k0"], off["k1"], delta, off["k2"], off["k3"], off["kip"], off["k1"] + off["k3"])
    return dict(zip(COLUMNS, values, strict=True))


def rms_ratio(error: Array, other: Array) -> Rms:
    """Return the ratio of two RMS errors from the same draws, with its error."""
    one, two = (np.mean(e.reshape(len(e), -1) ** 2, axis=1) for e in (error, other))
    value = float(np.sqrt(one.mean() / two.mean()))
    spread = (one / one.mean() - two / two.mean()).std()
    return Rms(value, float(value * spread / 2 / np.sqrt(len(one))))


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
