"""Calibrations on a rate table, and how far corrected readings are off, in mg."""

from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from tests.accuracy import rate_table as made
from tests.accuracy.rate_table import PLANAR, RADIUS, TILTED, Bench, Draw, draw, random_pose_forces

from inercal.basics.units import Measured
from inercal.benches.rate_table.bench import RateTable
from inercal.benches.rate_table.fixture import TiltConvention, multi_angle_plan, planar_plan
from inercal.estimation import Estimate
from inercal.methods.ship_multi_angle import damped, joint, planar, planar_norm
from inercal.physics.plan import Spin
from inercal.physics.sensors import G0, triad
from inercal.physics.sensors.affine import to_affine
from inercal.recordings import Observations

Array = NDArray[np.float64]
SENSOR = triad().with_coefficients("k0", "k1", "delta_o", "delta_p")
STEPS = (*planar_plan(), *multi_angle_plan())
TYPICAL = Bench()
EXACT = Bench(pose=0.0, seat=0.0, speed=0.0, noise=0.0)
ESTIMATORS = {"planar": planar, "planar_norm": planar_norm, "damped": damped, "joint": joint}


class Case(NamedTuple):
    seen: Observations
    bench: RateTable
    steps: tuple[Spin, ...]
    draw: Draw

    @property
    def truth(self) -> Array:
        """Coefficients, (trials, 12) SI; the misalignments of a cyclic triad."""
        h, b = self.draw.matrix, self.draw.bias
        by = {}
        for i, axis in enumerate("xyz"):
            j, k = (i + 1) % 3, (i + 2) % 3
            by[f"{axis}.k0"] = b[:, i] * G0
            by[f"{axis}.k1"] = h[:, i, i] - 1
            by[f"{axis}.delta_o"] = h[:, i, j]
            by[f"{axis}.delta_p"] = -h[:, i, k]
        return np.stack([by[name] for name in SENSOR.coefficients], axis=-1)


def observed(readings: Array, steps: tuple[Spin, ...], noise: float) -> Observations:
    """Return readings (..., r, 3) in g as observations."""
    r = len(steps)
    return Observations(
        tuple(step.label for step in steps),
        readings * G0,
        np.broadcast_to((noise * G0) ** 2 * np.eye(3), (r, 3, 3)),
        np.full(r, 150.0),
        np.full(r, 15000, dtype=np.int64),
        np.arange(r, dtype=float),
        SENSOR.channels,
    )


def declared(bench: Bench) -> RateTable:
    return RateTable(
        Measured(G0, G0 * bench.gravity),
        Measured(RADIUS, bench.radius),
        bench.seat,
        bench.pose,
        bench.rate,
        bench.speed,
        bench.lean,
    )


def case(
    seed: int, trials: int, bench: Bench = TYPICAL, reading: TiltConvention = "azimuth"
) -> Case:
    given = draw(seed, trials, bench, PLANAR + TILTED, reading)
    steps = (*planar_plan(), *multi_angle_plan(reading))
    # Without noise its deviation still weighs the rows.
    return Case(observed(given.readings, steps, bench.noise or 3e-4), declared(bench), steps, given)


@cache
def calibrated(name: str, seed: int, trials: int, reading: TiltConvention = "azimuth"):
    given = case(seed, trials, reading=reading)
    return given, ESTIMATORS[name](given.seen, SENSOR, given.bench, given.steps)


def off(found: Estimate, given: Case, seed: int = 1) -> Array:
    """Return the vector rms on fresh poses, (trials,) mg."""
    model, _ = to_affine(SENSOR, found.select(SENSOR.coefficients).value)
    return 1e3 * made.vector_rms(model.matrix, model.offset, given.draw, random_pose_forces(seed))


def nees(found: Estimate, given: Case) -> Array:
    """Return the squared errors over the covariance, per coefficient, (trials,)."""
    alone = found.select(SENSOR.coefficients)
    e = alone.value - given.truth
    return (e * np.linalg.solve(alone.covariance, e[..., None])[..., 0]).sum(-1) / 12
