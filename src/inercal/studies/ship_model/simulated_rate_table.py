"""Simulate the rate table: random devices, read in nine untilted states and sixteen groups.

The bench model gives the specific force (`benches.rate_table.sensed_motion`), and the sensor model
gives the readings. A calibration is judged on fresh poses without noise: any attitude, at any speed
up to the fastest. Internally, everything is in g.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from math import radians
from typing import NamedTuple

import numpy as np

from inercal.basics.arrays import Array
from inercal.basics.keys import CoefficientName
from inercal.basics.units import Measured
from inercal.benches.rate_table import fixture
from inercal.benches.rate_table.bench import RateTable, sensed_motion
from inercal.estimation import Estimate
from inercal.physics.motion import Motion
from inercal.physics.plan import Spin
from inercal.physics.sensors import G0, triad
from inercal.physics.sensors.affine import AffineModel, to_affine
from inercal.recordings import Observations

SENSOR = triad().with_coefficients("k0", "k1", "delta_o", "delta_p")
RADIUS = 0.25  # m
POSE_SD, SEAT_SD, SPEED_SD = radians(0.2), 0.5e-3, 0.05e-2  # rad, m, relative
NOISE = 0.3e-3  # g, noise of each mean
# 1σ of the devices' coefficients.
SIZES = {"k0": 0.04 * G0, "k1": 0.02, "delta_o": 0.012, "delta_p": 0.012}
SPEEDS = (0.0, 20.0, 46.0, 56.0, 66.0, 76.0, 86.0)  # r/min
POSE_COUNT = 300  # poses
MILLI = 1e-3
BENCH = RateTable(Measured(G0, 0.0), Measured(RADIUS, 0.0), SEAT_SD, POSE_SD, 0.0, SPEED_SD)
EXACT_BENCH = replace(BENCH, seat=0.0, pose=0.0, speed=0.0)


@dataclass(frozen=True, eq=False)
class ShipModelCase:
    """Simulated devices on one bench.

    Parameters
    ----------
    observations : Observations
        Readings, (trials, r, 3), m/s².
    steps : tuple of r Spin
        Nine untilted states, then the groups.
    device : AffineModel
        H and b in the readings a = H f + b of each device, (trials,).
    bench : RateTable
        The bench as the estimators know it.
    """

    observations: Observations
    steps: tuple[Spin, ...]
    device: AffineModel
    bench: RateTable = BENCH

    @property
    def level_rows(self) -> slice:
        """Return the rows of the untilted states."""
        return slice(0, len(fixture.planar_plan()))

    @property
    def group_rows(self) -> slice:
        """Return the rows of the tilted groups."""
        return slice(len(fixture.planar_plan()), None)

    @cached_property
    def readings(self) -> Array:
        """Return the readings, (trials, r, 3) g."""
        return self.observations.mean / G0

    @cached_property
    def nominal(self) -> Array:
        """Return the nominal specific force on the bench, (r, 3) g."""
        return nominal_force(self.steps)

    @cached_property
    def squared_norm(self) -> Array:
        """Return A² + 1 for the groups, g²."""
        return np.asarray((self.nominal[self.group_rows] ** 2).sum(-1))

    def single_device(self, trial: int) -> "ShipModelCase":
        """Return the case with only one device."""
        return replace(
            self,
            observations=replace(self.observations, mean=self.observations.mean[trial]),
            device=select_trials(self.device, trial),
        )


def select_trials(model: AffineModel, trials: int | slice) -> AffineModel:
    """Return the model for some trials, or for one trial."""
    return AffineModel(model.matrix[trials], model.offset[trials])


def nominal_force(steps: Sequence[Spin]) -> Array:
    """Return the specific force without any error, (r, 3) g."""
    return sensed_motion(EXACT_BENCH, steps, {}).f / G0


def simulate(
    trials: int,
    seed: int,
    drawn: RateTable = BENCH,
    *,
    reading: fixture.TiltConvention = "azimuth",
    noise: float = NOISE,
) -> ShipModelCase:
    """Simulate the readings of devices; the estimators assume the usual bench.

    Parameters
    ----------
    trials, seed : int
    drawn : RateTable
        Bench with the sizes of its errors.
    reading : "azimuth", "dihedral" or "successive"
        Interpretation of the pose with two tilts.
    noise : float
        Noise of each mean, g.
    """
    steps = (*fixture.planar_plan(), *fixture.multi_angle_plan(reading))
    rng = np.random.default_rng([seed, 2014])
    sizes = np.array([SIZES[CoefficientName(name).term] for name in SENSOR.coefficients])
    c = sizes * rng.standard_normal((trials, len(sizes)))
    q = {
        name: parameter.value + parameter.sd * rng.standard_normal(trials)
        for name, parameter in drawn.acting_parameters(steps).items()
    }
    exact = SENSOR.forward(Motion(sensed_motion(drawn, steps, q).f), c)
    r = len(steps)
    seen = Observations(
        tuple(step.label for step in steps),
        exact + noise * G0 * rng.standard_normal((trials, r, 3)),
        np.broadcast_to((NOISE * G0) ** 2 * np.eye(3), (r, 3, 3)),
        np.array([step.seconds for step in steps]),
        np.ones(r, dtype=np.int64),
        np.arange(r, dtype=float),
        SENSOR.channels,
    )
    return ShipModelCase(seen, steps, to_affine(SENSOR, c)[0].inverse)


def model_from_estimate(found: Estimate) -> AffineModel:
    """Return M and p of an estimate."""
    return to_affine(SENSOR, found.select(SENSOR.coefficients).value)[0]


def random_pose_forces(seed: int) -> Array:
    """Return the specific force in fresh poses of any direction and speed, (300, 3) g."""
    rng = np.random.default_rng([seed, POSE_COUNT])
    direction = rng.standard_normal((POSE_COUNT, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    a = (rng.uniform(0, fixture.FAST_SPEED_RPM, POSE_COUNT) * fixture.RPM) ** 2 * RADIUS / G0
    return np.hypot(a, 1)[:, None] * direction


def calibration_errors(model: AffineModel, device: AffineModel, f: Array) -> Array:
    """Return M a + p − f, (..., r, 3), for the force f, (r, 3), and its noise-free reading a."""
    return model.correct(device.correct(f)) - f


def rms_length(vectors: Array) -> Array:
    """Return the rms length of vectors (..., r, 3)."""
    return np.sqrt((vectors**2).sum(-1).mean(-1))


def vector_rms(model: AffineModel, device: AffineModel, seed: int) -> Array:
    """Return the rms length of the error vector on fresh poses, (...) g."""
    return rms_length(calibration_errors(model, device, random_pose_forces(seed)))


def norm_rms(model: AffineModel, case: ShipModelCase) -> Array:
    """Return the rms of |M a + p| − √(A² + 1) over the groups, (...) g."""
    norm = np.linalg.norm(model.correct(case.readings[..., case.group_rows, :]), axis=-1)
    return np.sqrt(((norm - np.sqrt(case.squared_norm)) ** 2).mean(-1))


class MedianEstimate(NamedTuple):
    """A median over devices, its Monte Carlo error and the 95 % quantile."""

    value: float
    u: float
    percentile_95: float


def median_estimate(values: Array) -> MedianEstimate:
    """Return the median of values, (trials,), with its error from the middle quarter."""
    low, middle, up, high = np.quantile(values, [0.375, 0.5, 0.625, 0.95])
    # The probability of a quantile scatters by √(q(1 − q)/n); divide by the density there.
    return MedianEstimate(
        float(middle), float((up - low) / 0.25 / 2 / np.sqrt(len(values))), float(high)
    )


def median_ratio(one: MedianEstimate, other: MedianEstimate) -> tuple[float, float]:
    """Return the ratio of two medians, and its error for independent draws."""
    ratio = one.value / other.value
    return ratio, ratio * float(np.hypot(one.u / one.value, other.u / other.value))
