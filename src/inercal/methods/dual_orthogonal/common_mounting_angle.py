"""The common mounting angle, which g² does not see: from where the head says that it stood.

Two accelerometers that are compensated tell at which angle they stand. Its mean beyond the head's
angles is their common mounting angle and what the head errs by in the mean, its zero above all.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from inercal.benches.dividing_head.bench import DividingHead
from inercal.benches.dividing_head.head_angles import sensor_angles
from inercal.estimate import Estimate
from inercal.methods.dual_orthogonal import g_squared
from inercal.plan import Index
from inercal.recording import Observations
from inercal.sensors import Sensor


def with_common_angle(
    estimate: Estimate,
    observations: Observations,
    sensor: Sensor,
    bench: DividingHead,
    steps: Sequence[Index],
) -> Estimate:
    """Return an estimate of mounting angles ± δ/2 with their common part, and what it is known to.

    Parameters
    ----------
    estimate : Estimate
        Of g², whose mounting angles are without a common part.
    observations : Observations
        (..., r, 2), m/s².
    sensor : Sensor
    bench : DividingHead
    steps : sequence of r Index
    """
    if not set(g_squared.MOUNTING_ANGLES) <= set(sensor.coefficients):
        return estimate
    g, stated = bench.gravity.value, sensor_angles(bench, steps)
    p = len(sensor.coefficients)
    sensed = g_squared.compare_with_gravity(
        sensor, observations.mean, estimate.value[..., :p], g
    ).force
    beyond = np.arctan2(sensed[..., 0], sensed[..., 1]) - stated.nominal
    common = np.mean((beyond + np.pi) % (2 * np.pi) - np.pi, axis=-1)

    declared = bench.acting_parameters(steps)
    by_bench = sum(
        (declared[name].sd * weight.mean()) ** 2 for name, weight in stated.weights.items()
    )
    across = np.stack([np.cos(stated.nominal), -np.sin(stated.nominal)], axis=-1).ravel()
    across = across / (g * len(steps))
    variance = by_bench + across @ observations.full_covariance @ across
    both = [estimate.names.index(name) for name in g_squared.MOUNTING_ANGLES]
    value, covariance = estimate.value.copy(), estimate.covariance.copy()
    value[..., both] += common[..., None]
    rows, columns = np.ix_(both, both)
    covariance[..., rows, columns] += np.asarray(variance)[..., None, None]
    moved = {name: by.copy() for name, by in estimate.sensitivities.items()}
    for name, weight in stated.weights.items():
        # The head is taken to stand further on by what is stated: less is left to the mounting.
        by = moved.setdefault(name, np.zeros_like(value))
        by[..., both] -= weight.mean()
    return replace(estimate, value=value, covariance=covariance, sensitivities=moved)
