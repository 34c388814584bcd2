"""Errors of both methods' `ml` in three hundred sessions for each base seed."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
import pytest
from numpy.typing import NDArray
from tests.accuracy.ferraris import DEGREE, Handling, Imu, mems, record
from tests.accuracy.inercal_inputs import make_bench, make_observations, true_coefficients
from tests.base_seeds import SEEDS

from inercal.benches import Hand
from inercal.estimation import Estimate
from inercal.methods import METHODS
from inercal.physics.sensors import imu

Array = NDArray[np.float64]
TRIALS = 300
HANDS = Handling(
    gravity_sd=2e-4,
    latitude=47 * DEGREE,
    tilt=0.05 * DEGREE,
    turn_tilt=0.3 * DEGREE,
    turn_angle=0.5 * DEGREE,
    table=0.3 * DEGREE,
    timebase=1e-4,
)


@dataclass(frozen=True, eq=False)
class JudgedSessions:
    """What came out against what is true: errors (trials, p), and the estimate."""

    names: tuple[str, ...]
    error: Array
    estimate: Estimate

    @property
    def covariance(self) -> Array:
        p = len(self.names)
        return self.estimate.covariance[:, :p, :p]

    @property
    def std(self) -> Array:
        """As modelled, (trials, p)."""
        return np.sqrt(np.diagonal(self.covariance, axis1=-2, axis2=-1))

    @property
    def nees(self) -> Array:
        """Normalised error squared over p, (trials,)."""
        weighed = np.linalg.solve(self.covariance, self.error[..., None])[..., 0]
        return (self.error * weighed).sum(-1) / len(self.names)


@dataclass(frozen=True, eq=False)
class Sessions:
    """One sensor's sessions and their judgement by method."""

    device: Imu
    hands: Handling = HANDS
    judged: Mapping[str, JudgedSessions] = field(default_factory=dict)


@pytest.fixture(scope="session", params=SEEDS)
def sessions(request: pytest.FixtureRequest) -> Sessions:
    rng = np.random.default_rng([request.param, 20_260])
    # The accelerometers sit off the turning axis: a turn's mean specific force is not gravity.
    device = mems(rng, arm=np.array([0.03, -0.02, 0.05]))
    made = record(device, HANDS, rng, trials=TRIALS)
    found: dict[str, JudgedSessions] = {}
    for name, method in METHODS.items():
        if method.unknown_attitudes or method.bench is not Hand:
            continue
        sensor, steps = method.prepare(imu()), method.plan()
        estimate = method.estimator("ml")(
            make_observations(made, sensor, steps), sensor, make_bench(HANDS), steps
        )
        p = len(sensor.coefficients)
        error = estimate.value[:, :p] - true_coefficients(device, sensor)
        found[name] = JudgedSessions(sensor.coefficients, error, estimate)
    return Sessions(device, judged=found)
