"""Tumble tests of one device, simulated without inercal, and the errors of their estimates."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from math import pi

import numpy as np
from numpy.typing import NDArray
from tests.accuracy.tumble import Device, Scale

from inercal.basics.units import Measured
from inercal.benches.dividing_head.bench import DividingHead
from inercal.estimation import Estimate
from inercal.methods.tumble import fourier, least_squares
from inercal.physics.plan import Index
from inercal.physics.sensors import G0, Sensor, single
from inercal.recordings import Observations

Array = NDArray[np.float64]
SIX: tuple[str, ...] = ("k0", "k1", "delta_o", "k2", "kip", "k3")
ARCSEC = pi / 648_000
# 300 µg, 200 ppm, 100″, 10 µg/g², 20 µg/g², 5 µg/g³
DEVICE = Device(3e-4, 2e-4, 100 * ARCSEC, 1e-5, 2e-5, 5e-6)
G = 1.0007  # local gravity in g
EXACT = DividingHead(Measured(G * G0, 0.0), collimated="none")
NOISE = 2e-7  # g
ESTIMATORS = [fourier, least_squares]
SEEDS = [1, 2, 3]
Estimator = Callable[..., Estimate]


def sensor(*terms: str) -> Sensor:
    return single().with_coefficients(*(terms or SIX))


def positions(n: int, start: float = 0.0, *, back: bool = False) -> tuple[Index, ...]:
    """Return n evenly spaced positions from `start`, rad, and on wish the same ones back."""
    there = [Index(f"p{k}", start + 2 * pi * k / n) for k in range(n)]
    again = [Index(f"{step.label}_back", step.angle, -1) for step in reversed(there)]
    return (*there, *again[: n * back])


def angles(plan: Sequence[Index]) -> Array:
    return np.array([step.angle for step in plan])


def seen(plan: Sequence[Index], reading: Array, sd: float = NOISE) -> Observations:
    """Return readings in g, (..., r), as observations."""
    r = len(plan)
    return Observations(
        tuple(step.label for step in plan),
        reading[..., None] * G0,
        np.full((r, 1, 1), (sd * G0) ** 2),
        np.ones(r),
        np.ones(r, dtype=np.int64),
        np.arange(r, dtype=float),
        ("i",),
    )


def in_g(found: Estimate, made: Sensor) -> dict[str, Array]:
    p = len(made.coefficients)
    value = found.value[..., :p] / made.unit_scale
    return {name[2:]: value[..., k] for k, name in enumerate(made.coefficients)}


def truth(device: Device, made: Sensor) -> Array:
    """Return the device's coefficients in the sensor's order, in g."""
    by_name = dict(zip(SIX, list(vars(device).values())[:6], strict=True))
    return np.array([by_name[name[2:]] for name in made.coefficients])


def error(found: Estimate, made: Sensor, device: Device = DEVICE) -> Array:
    p = len(made.coefficients)
    return found.value[..., :p] / made.unit_scale - truth(device, made)


def spread(found: Estimate, made: Sensor) -> Array:
    p = len(made.coefficients)
    return found.covariance[..., :p, :p] / np.outer(made.unit_scale, made.unit_scale)


def run(
    estimator: Estimator,
    plan: Sequence[Index],
    made: Sensor,
    device: Device = DEVICE,
    head: Scale | None = None,
    bench: DividingHead = EXACT,
) -> Estimate:
    true = (head or Scale()).true(angles(plan))
    return estimator(seen(plan, device.reading(true, G)), made, bench, plan)


def all_of(
    estimator: Estimator,
    observed: Observations,
    made: Sensor,
    bench: DividingHead,
    plan: Sequence[Index],
) -> tuple[Array, Array]:
    """Return values and covariances of trials, in g; `fourier` takes one at a time."""
    if estimator is fourier:
        alone = [fourier(replace(observed, mean=mean), made, bench, plan) for mean in observed.mean]
        value = np.array([found.value for found in alone]) / made.unit_scale
        return value, np.array([spread(found, made) for found in alone])
    found = estimator(observed, made, bench, plan)
    return found.value[:, : len(made.coefficients)] / made.unit_scale, spread(found, made)
