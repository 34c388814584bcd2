"""Priors on coefficients act as Bayes' theorem says."""

import numpy as np
import pytest
from tests.accuracy.ferraris import DEGREE, Handling, mems, record
from tests.accuracy.inercal_inputs import make_bench, make_observations
from tests.refusals import refused

from inercal.estimation import Gaussian
from inercal.methods import METHODS
from inercal.physics.sensors import imu

# Nearly exact faces and turns: the problem is then linear, and the dense formula exact.
HANDS = Handling(
    gravity_sd=2e-4,
    latitude=47 * DEGREE,
    tilt=1e-5,
    turn_tilt=1e-5,
    turn_angle=1e-4,
    timebase=1e-6,
)


@pytest.mark.parametrize("method", ["six_position", "ferraris"])
def test_the_estimate_moves_as_bayes_says(method: str):
    """With H x known to be m ± R beforehand: x̂ + K (m − H x̂), C − K H C, K = C Hᵀ(H C Hᵀ + R)⁻¹."""
    rng = np.random.default_rng(80)
    device = mems(rng)
    made = record(device, HANDS, rng)
    chosen = METHODS[method]
    sensor, steps = chosen.prepare(imu()), chosen.plan()
    seen, hands = make_observations(made, sensor, steps, 0), make_bench(HANDS)
    alone = chosen.estimator("ml")(seen, sensor, hands, steps)
    p = len(sensor.coefficients)
    x, C = alone.value[:p], alone.covariance[:p, :p]
    # As vague as what the data say; one alone, and two that are correlated.
    single, pair = ("ay.k0",), ("ax.k1", "az.delta_o")
    index = [sensor.coefficients.index(name) for name in (*single, *pair)]
    sd = np.sqrt(np.diag(C))[index]
    correlation = np.array([[1, 0, 0], [0, 1, 0.6], [0, 0.6, 1]])
    R = correlation * np.outer(sd, sd)
    m = x[index] + sd * np.array([1.0, -0.7, 0.5])
    priors = (Gaussian(single, m[:1], R[:1, :1]), Gaussian(pair, m[1:], R[1:, 1:]))
    both = chosen.estimator("ml")(seen, sensor, hands, steps, priors)
    gain = C[:, index] @ np.linalg.inv(C[np.ix_(index, index)] + R)
    moved = gain @ (m - x[index])
    left = C - gain @ C[index]
    std = np.sqrt(np.diag(left))
    assert np.abs(moved / std).max() > 0.4
    np.testing.assert_allclose((both.value[:p] - x) / std, moved / std, atol=1e-3)
    apart = (both.covariance[:p, :p] - left) / np.outer(std, std)
    np.testing.assert_allclose(apart, 0, atol=1e-3)
    assert both.dof == alone.dof + 3


def test_classical_refuses_priors():
    rng = np.random.default_rng(81)
    made = record(mems(rng), HANDS, rng)
    chosen = METHODS["six_position"]
    sensor, steps = chosen.prepare(imu()), chosen.plan()
    prior = Gaussian.independent(("ax.k0",), [0.0], [1.0])
    with refused(key="priors", names=("ax.k0",)):
        chosen.estimator("classical")(
            make_observations(made, sensor, steps, 0), sensor, make_bench(HANDS), steps, (prior,)
        )
