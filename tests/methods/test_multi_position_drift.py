"""A drift of the accelerometers in `multi_position`: it is part of the noise of the fits.

Sessions are made by `tests.accuracy.handheld`, which imports nothing of inercal.
"""

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from tests.accuracy.ferraris import G0, mems
from tests.accuracy.handheld import record
from tests.methods.test_multi_position import BENCH, SESSION, observed, session, truth

from inercal.methods.multi_position import METHOD, joint
from inercal.methods.multi_position.rest_observations import Rests, Scatter
from inercal.methods.multi_position.row_whitening import whitener, whitener_with_drift
from inercal.physics.sensors import Noise, imu

Array = NDArray[np.float64]


def test_the_drift_of_each_axis_is_in_the_covariance_of_all_rows() -> None:
    rests, x = session()
    rows = rests.rows(x)
    band = whitener(rests, rows, Scatter())
    every = np.eye(len(rows.residual))
    known = band(every)
    both = whitener_with_drift(rests, rows, band)(every)
    columns: list[Array] = []
    for course in rests.accelerometer_drift:
        for axis in range(3):
            moved = rests.observations.mean.copy()
            moved[:, axis] += 1e-5 * course[:, axis]
            drifted = replace(rests, observations=replace(rests.observations, mean=moved))
            drifted.__dict__["cross_directions"] = rests.cross_directions
            change = drifted.rows(x, rows).residual - rows.residual
            columns.append(1e5 * change)
    drift = np.stack(columns, axis=-1)
    inverse = np.linalg.inv(known)
    whole = inverse @ inverse.T + drift @ drift.T
    # The drift is a hundred times the noise: 0.1 is 0.1 % of the derivatives.
    np.testing.assert_allclose(both @ whole @ both.T, every, rtol=0, atol=0.1)


def accelerometers(seed: int, drift: float, noise: Noise | None = None) -> tuple[Rests, Array]:
    """Return the rests of three accelerometers whose biases drift over the run, and the truth."""
    rng = np.random.default_rng([seed, 19])
    device = mems(rng)
    made = record(device, replace(SESSION, positions=20), rng)
    place = np.linspace(-0.5, 0.5, made.data.shape[1])
    made.data[0, :, :3] += drift * place[:, None] * rng.choice([-1.0, 1.0], 3)
    sensor = METHOD.prepare(imu().select_axes("f"))
    if noise is not None:
        sensor = replace(sensor, axes=tuple(replace(axis, noise=noise) for axis in sensor.axes))
    return Rests(observed(made, sensor), sensor, BENCH), truth(device, sensor)


@pytest.mark.slow
def test_errors_of_drifting_accelerometers_are_within_their_uncertainty() -> None:
    beyond: list[float] = []
    for seed in range(12):
        rests, true = accelerometers(seed, 0.5e-3 * G0)
        found = joint(rests.observations, rests.sensor, BENCH, ())
        p = len(true)
        beyond.append(float(np.mean(np.abs((found.value[:p] - true) / found.std[:p]) > 2)))
    assert np.mean(beyond) < 0.12  # 5 %, and three standard deviations of 108 draws


def test_slow_noise_that_is_stated_and_means_without_times_leave_no_drift_open() -> None:
    rests, _ = accelerometers(1, 0.0)
    assert rests.accelerometer_drift.shape == (2, 20, 3)
    assert rests.accelerometer_drift.any()
    stated, _ = accelerometers(1, 0.0, Noise(bias_instability=1e-4))
    assert not stated.accelerometer_drift.size
    table = replace(rests, observations=replace(rests.observations, timed=False))
    assert not table.accelerometer_drift.size
