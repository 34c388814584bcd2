"""The simulated rate table: drawn devices, read in nine untilted states and sixteen groups.

The bench makes the force (`benches.rate_table.sensed_motion`), the sensor's model the readings. A
calibration is judged on fresh poses: any attitude, at any speed up to the fastest, without noise.
Inside, everything is in g.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from math import radians
from typing import NamedTuple

import numpy as np

from inercal.arrays import Array
from inercal.benches.rate_table.bench import RateTable, sensed_motion
from inercal.benches.rate_table.fixture import FAST, RPM, Reading, multi_angle_plan, planar_plan
from inercal.estimate import Estimate
from inercal.keys import CoefficientName
from inercal.motion import Motion
from inercal.plan import Spin
from inercal.recording import Observations
from inercal.sensors import G0, triad
from inercal.sensors.affine import Affine, to_affine
from inercal.units import Measured

SENSOR = triad().with_coefficients("k0", "k1", "delta_o", "delta_p")
RADIUS = 0.25  # m
POSE, SEAT, SPEED = radians(0.2), 0.5e-3, 0.05e-2  # rad, m, relative
NOISE = 0.3e-3  # g, of each mean
SIZES = {"k0": 0.04 * G0, "k1": 0.02, "delta_o": 0.012, "delta_p": 0.012}  # 1σ of the devices
SPEEDS = (0.0, 20.0, 46.0, 56.0, 66.0, 76.0, 86.0)  # r/min
FRESH = 300  # poses
MILLI = 1e-3
BENCH = RateTable(Measured(G0, 0.0), Measured(RADIUS, 0.0), SEAT, POSE, 0.0, SPEED)
EXACT = replace(BENCH, seat=0.0, pose=0.0, speed=0.0)


@dataclass(frozen=True, eq=False)
class Case:
    """Devices on one bench.

    Parameters
    ----------
    seen : Observations
        (trials, r, 3), m/s².
    steps : tuple of r Spin
        Nine untilted states, then the groups.
    device : Affine
        H and b of what a device reads, a = H f + b, of (trials,).
    bench : RateTable
        As the estimators are told.
    """

    seen: Observations
    steps: tuple[Spin, ...]
    device: Affine
    bench: RateTable = BENCH

    @property
    def level(self) -> slice:
        """The rows of the untilted states."""
        return slice(0, len(planar_plan()))

    @property
    def groups(self) -> slice:
        """The rows of the tilted ones."""
        return slice(len(planar_plan()), None)

    @cached_property
    def readings(self) -> Array:
        """In g, (trials, r, 3)."""
        return self.seen.mean / G0

    @cached_property
    def nominal(self) -> Array:
        """What the bench says was felt, (r, 3) g."""
        return said(self.steps)

    @cached_property
    def square(self) -> Array:
        """A² + 1 of the groups, g²."""
        return np.asarray((self.nominal[self.groups] ** 2).sum(-1))

    def one(self, trial: int) -> "Case":
        """Return one device by itself."""
        return replace(
            self,
            seen=replace(self.seen, mean=self.seen.mean[trial]),
            device=part(self.device, trial),
        )


def part(model: Affine, trials: int | slice) -> Affine:
    """Return the model of some trials, or of one."""
    return Affine(model.matrix[trials], model.offset[trials])


def said(steps: Sequence[Spin]) -> Array:
    """Return what is felt without any error, (r, 3) g."""
    return sensed_motion(EXACT, steps, {}).f / G0


def simulate(
    trials: int,
    seed: int,
    drawn: RateTable = BENCH,
    *,
    reading: Reading = "azimuth",
    noise: float = NOISE,
) -> Case:
    """Return the readings of so many devices; estimators are told of the usual bench.

    Parameters
    ----------
    trials, seed : int
    drawn : RateTable
        The sizes of the bench's errors.
    reading : "azimuth", "dihedral" or "successive"
        Of the pose of two tilts.
    noise : float
        Of each mean, g.
    """
    steps = (*planar_plan(), *multi_angle_plan(reading))
    rng = np.random.default_rng([seed, 2014])
    sizes = np.array([SIZES[CoefficientName(name).term] for name in SENSOR.coefficients])
    c = sizes * rng.standard_normal((trials, len(sizes)))
    q = {
        name: parameter.value + parameter.sd * rng.standard_normal(trials)
        for name, parameter in drawn.acting(steps).items()
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
    return Case(seen, steps, to_affine(SENSOR, c)[0].inverse)


def model_of(found: Estimate) -> Affine:
    """Return M and p of an estimate."""
    return to_affine(SENSOR, found.select(SENSOR.coefficients).value)[0]


def fresh(seed: int) -> Array:
    """Return what is felt in fresh poses, (300, 3) g: any direction, at any speed."""
    rng = np.random.default_rng([seed, FRESH])
    direction = rng.standard_normal((FRESH, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    a = (rng.uniform(0, FAST, FRESH) * RPM) ** 2 * RADIUS / G0
    return np.hypot(a, 1)[:, None] * direction


def errors(model: Affine, device: Affine, f: Array) -> Array:
    """Return M a + p − f where f (r, 3) is felt and a read without noise, (..., r, 3)."""
    return model.correct(device.correct(f)) - f


def length(vectors: Array) -> Array:
    """Return the rms length of vectors (..., r, 3)."""
    return np.sqrt((vectors**2).sum(-1).mean(-1))


def vector_rms(model: Affine, device: Affine, seed: int) -> Array:
    """Return the rms length of the error on fresh poses, (...) g."""
    return length(errors(model, device, fresh(seed)))


def norm_rms(model: Affine, case: Case) -> Array:
    """Return the rms of |M a + p| − √(A² + 1) over the groups, (...) g."""
    norm = np.linalg.norm(model.correct(case.readings[..., case.groups, :]), axis=-1)
    return np.sqrt(((norm - np.sqrt(case.square)) ** 2).mean(-1))


class Median(NamedTuple):
    """A median over devices, its Monte Carlo error, and the 95 % point."""

    value: float
    u: float
    high: float


def median(values: Array) -> Median:
    """Return the median of values (trials,); its error by the distribution's middle quarter."""
    low, middle, up, high = np.quantile(values, [0.375, 0.5, 0.625, 0.95])
    # A quantile scatters by √(q(1 − q)/n) of probability: half, over the density there.
    return Median(float(middle), float((up - low) / 0.25 / 2 / np.sqrt(len(values))), float(high))


def over(one: Median, other: Median) -> tuple[float, float]:
    """Return the ratio of two medians, and its error as if they had been drawn apart."""
    ratio = one.value / other.value
    return ratio, ratio * float(np.hypot(one.u / one.value, other.u / other.value))
