"""Families of messages of least squares, filters on a turntable and positions held by hand."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
from tests.accuracy.ferraris import DEGREE

from inercal.basics.units import Measured
from inercal.benches import Hand, Turntable
from inercal.estimation import Gauge, Gaussian, Problem, least_squares
from inercal.estimation.uncertainty import pooled_mean_covariances
from inercal.methods.multi_position import METHOD as HAND_METHOD
from inercal.methods.multi_position import gyro_delay, joint
from inercal.methods.turntable import model
from inercal.methods.turntable.drift import drift_model
from inercal.methods.turntable_discrete import METHOD as MEANS
from inercal.methods.turntable_kalman import METHOD as FILTERS
from inercal.methods.turntable_kalman.combined_estimate import split_priors
from inercal.methods.turntable_kalman.gyros import GyroFilter
from inercal.physics.plan import Position
from inercal.physics.sensors import Noise, Sensor, imu
from inercal.recordings import Observations, Track

DESIGN = np.array([[1.0, 0.0], [1.0, 1.0], [1.0, 2.0]])
PROBLEM = Problem(
    ("a", "b"), np.zeros(2), lambda x: (1 - x @ DESIGN.T, DESIGN), np.ones(3), np.ones(2)
)
TABLE = Turntable(Measured(9.81, 0.0), 0.7, Measured(0.0, 1e-4), latency=Measured(0.0, 5e-3))
HAND = Hand(Measured(9.81, 0.0), 47 * DEGREE)
STILL = Track(
    np.arange(1200) / 100,
    np.zeros((1200, 6)),
    np.zeros((1200, 3)),
    np.zeros(1200, dtype=np.int64),
)


def _imu(**noise: float) -> Sensor:
    """Return an IMU whose axes state this noise."""
    whole = imu().with_coefficients("bias", "scale", "misalignment")
    return replace(whole, axes=tuple(replace(a, noise=Noise(**noise)) for a in whole.axes))


NOISY = _imu(white=1e-4)


def _means(sensor: Sensor, up: np.ndarray) -> Observations:
    """Return a second of rest in each attitude, as an ideal triad reads it."""
    n, m = len(up), len(sensor.axes)
    mean = np.zeros((n, m))
    mean[:, :3] = 9.81 * up
    return Observations(
        tuple(f"r{k}" for k in range(n)),
        mean,
        np.tile(1e-8 * np.eye(m), (n, 1, 1)),
        np.ones(n),
        np.full(n, 100),
        np.arange(n, dtype=np.float64),
        sensor.channels,
    )


def _accelerometers() -> Sensor:
    return imu().select_axes("f").with_coefficients("bias", "scale")


def _loose_latency(_: Path) -> object:
    bench = replace(TABLE, latency=Measured(0.0, 50e-3))
    return GyroFilter.from_track(NOISY, bench, replace(STILL, time=2 * STILL.time))


def _undetermined_triad(_: Path) -> object:
    triad = model.triad_model(NOISY, "w")
    covariance = np.diag(model.expected_size(triad) ** 2 * ([1e-6] * 11 + [1.0]))
    return model.require_decided(triad, covariance, "gyros")


CASES: dict[str, Callable[[Path], object]] = {
    "parameter declared twice": lambda _: replace(PROBLEM, names=("a", "a")),
    "unknown parameter of a prior": lambda _: replace(
        PROBLEM, priors=(Gaussian.independent(("c",), 0, 1),)
    ),
    "covariance of a prior": lambda _: Gaussian(
        ("a", "b"), np.zeros(2), np.array([[1.0, 2.0], [2.0, 1.0]])
    ),
    "deviation of an observation": lambda _: least_squares(
        replace(PROBLEM, noise=np.array([1.0, 0.0, 1.0]), observations=("p1", "p2", "p3"))
    ),
    "dependent gauges": lambda _: least_squares(
        replace(
            PROBLEM,
            gauges=tuple(Gauge(w, ("a",), np.ones((1, 1)), np.ones(1)) for w in ("one", "two")),
        )
    ),
    "parameters that the data do not determine": lambda _: least_squares(
        replace(PROBLEM, linearise=lambda x: (np.ones(3), np.ones((3, 2))))
    ),
    "sections that are too short": lambda _: pooled_mean_covariances([np.zeros((2, 6))]),
    "rests in one plane": lambda _: joint(
        _means(_accelerometers(), np.array([(np.cos(a), np.sin(a), 0.0) for a in range(12)])),
        _accelerometers(),
        HAND,
        (),
    ),
    "gyros without transitions": lambda _: joint(
        _means(NOISY, np.eye(3)), HAND_METHOD.prepare(imu()), HAND, ()
    ),
    "delay without turns": lambda _: gyro_delay(
        _means(NOISY, np.eye(3)),
        NOISY,
        least_squares(PROBLEM),
        9.81,
    ),
    "noise that is not stated": lambda _: model.triad_model(_imu(), "w"),
    "correlation times that differ": lambda _: drift_model(
        [Noise(1.0, 1.0, correlation=t) for t in (1.0, 1.0, 2.0)], 60.0, "imu"
    ),
    "first rest that is too short": lambda _: model.coarse_bias(
        TABLE, STILL, model.triad_model(NOISY, "w")
    ),
    "latency that is too uncertain": _loose_latency,
    "coefficient that filters do not have": lambda _: model.triad_model(
        NOISY.with_coefficients("bias", "ax.koq"), "f"
    ),
    "prior across two filters": lambda _: split_priors(
        NOISY,
        [Gaussian(("gx.scale", "ax.k1"), np.zeros(2), np.array([[1e-6, 5e-7], [5e-7, 1e-6]]))],
    ),
    "filters of means": lambda _: FILTERS.estimator("full")(
        _means(NOISY, np.eye(3)), NOISY, TABLE, ()
    ),
    "coefficients that a run does not determine": _undetermined_triad,
    "angles of another table": lambda _: MEANS.estimator("")(
        _means(NOISY, np.eye(3)[:1]),
        NOISY,
        TABLE,
        (Position("r0", (0.0, 1.0), 1.0),),
    ),
}
