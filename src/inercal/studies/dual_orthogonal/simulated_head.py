"""Simulate the bench: a dividing head with two perpendicular accelerometers.

The bench model gives the specific force (`benches.dividing_head.sensed_motion`), and the sensor
model gives the readings. Each error is drawn by its name, so benches with other error sizes use the
same random numbers.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import pi
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
from inercal.estimation import Estimate, Gaussian
from inercal.physics.motion import Motion
from inercal.physics.sensors import G0
from inercal.recordings import Observations
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
