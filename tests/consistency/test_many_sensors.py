"""The big Monte Carlo: three thousand sessions of ten sensors, faces of a third of a degree."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from tests.accuracy.ferraris import DEGREE, mems, record
from tests.accuracy.inercal_inputs import make_bench, make_observations, true_coefficients
from tests.base_seeds import sampled
from tests.consistency.conftest import HANDS

from inercal.benches import Hand
from inercal.methods import METHODS
from inercal.physics.sensors import imu

Array = NDArray[np.float64]
TRIALS = 300
LEANING = replace(HANDS, tilt=0.3 * DEGREE)
PLANNED = [name for name, m in METHODS.items() if m.bench is Hand and not m.unknown_attitudes]


@pytest.mark.slow
@pytest.mark.parametrize(("base_seed", "sensors"), sampled(1, 10))
@pytest.mark.parametrize("method", PLANNED)
def test_stated_uncertainties_cover_the_truth_over_many_sensors(
    method: str, base_seed: int, sensors: int
):
    chosen = METHODS[method]
    sensor, steps = chosen.prepare(imu()), chosen.plan()
    p = len(sensor.coefficients)
    errors: list[Array] = []
    deviations: list[Array] = []
    nees: list[Array] = []
    for k in range(sensors):
        rng = np.random.default_rng([base_seed, k])
        device = mems(rng, arm=rng.uniform(-0.05, 0.05, 3))
        made = record(device, LEANING, rng, trials=TRIALS)
        observations = make_observations(made, sensor, steps)
        estimate = chosen.estimator("ml")(observations, sensor, make_bench(LEANING), steps)
        assert estimate.converged.all()
        error = estimate.value[:, :p] - true_coefficients(device, sensor)
        weighed = np.linalg.solve(estimate.covariance[:, :p, :p], error[..., None])[..., 0]
        errors.append(error)
        deviations.append(estimate.std[:, :p])
        nees.append((error * weighed).sum(axis=1) / p)
    error, deviation = np.concatenate(errors), np.concatenate(deviations)
    # Two deviations of Student's t with the 114 degrees of freedom of the noise cover 95.2 %.
    covered = 0.952 - 4 * np.sqrt(0.952 * 0.048 / (sensors * TRIALS))
    assert (np.mean(np.abs(error) < 2 * deviation, axis=0) > covered).all()
    # Weights found with 114 degrees of freedom in six channels enlarge the mean from 1 to as much
    # as 114/(114 − 6 − 1) in directions that noise alone decides (Hotelling's T²).
    band = 4 * np.sqrt(2 / (p * sensors * TRIALS))
    assert 1 - band < np.mean(nees) < 114 / 107 + band
    standard_errors = error.mean(axis=0) / (error.std(axis=0) / np.sqrt(len(error)))
    assert np.abs(standard_errors).max() < 4
