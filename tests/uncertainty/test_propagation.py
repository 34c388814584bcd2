import numpy as np
import pytest
from numpy.testing import assert_allclose
from numpy.typing import NDArray

from inercal.estimation.uncertainty import jacobian, propagate

Array = NDArray[np.float64]


def polar(x: Array) -> Array:
    """Return the ieee-1293 kind of change: (gain, tilt) from two linear coefficients."""
    return np.stack([np.hypot(1 + x[..., 0], x[..., 1]), np.arctan2(x[..., 1], 1 + x[..., 0])], -1)


def polar_jacobian(x: Array) -> Array:
    g, d = 1 + x[..., 0], x[..., 1]
    r = np.hypot(g, d)
    return np.stack([np.stack([g / r, d / r], -1), np.stack([-d / r**2, g / r**2], -1)], -2)


@pytest.mark.parametrize("size", [1e-9, 1e-6, 1e-3, 1e-1])
@pytest.mark.parametrize("sd", [1e-8, 1e-5, 1e-3])
def test_the_jacobian_is_the_analytic_one(size: float, sd: float):
    x = size * np.random.default_rng(0).normal(size=(6, 2))
    found = jacobian(polar, x, np.full(2, 0.1 * sd))
    assert_allclose(found, polar_jacobian(x), atol=2e-6 if sd < 1e-6 else 1e-8)


def test_propagation_agrees_with_the_analytic_jacobian_on_trials():
    rng = np.random.default_rng(1)
    x = 0.05 * rng.normal(size=(5, 2))
    covariance = 1e-6 * np.array([[1.0, 0.4], [0.4, 2.0]])
    value, found = propagate(polar, x, np.broadcast_to(covariance, (5, 2, 2)))
    j = polar_jacobian(x)
    assert_allclose(value, polar(x), rtol=1e-15)
    assert_allclose(found, j @ covariance @ np.swapaxes(j, -1, -2), rtol=1e-8, atol=1e-16)


def test_parameters_of_very_different_size_each_get_their_step():
    scale = np.array([1e-9, 1.0, 1e7])
    x = np.array([3e-9, 0.0, 2e7])
    sd = 1e-3 * scale

    def function(x: Array) -> Array:
        u = x / scale
        return np.stack([u[..., 0] * np.exp(u[..., 1]), np.sin(u[..., 1]) * u[..., 2]], axis=-1)

    _, covariance = propagate(function, x, np.diag(sd**2))
    j = np.array([[1, 3, 0], [0, 2, 0]]) * 1e-3
    assert_allclose(covariance, j @ j.T, rtol=1e-8)


def test_a_value_without_uncertainty_adds_none():
    _, covariance = propagate(lambda x: x**2, np.array([3.0, 0.0]), np.diag([0.01, 0.0]))
    assert_allclose(covariance, np.diag([0.36, 0.0]), rtol=1e-9)


def test_resistance_and_reactance_of_gum_h2():
    # GUM H.2: means of V, I, φ with their standard uncertainties and correlations (table H.2).
    value = np.array([4.9990, 19.6610e-3, 1.04446])
    sd = np.array([0.0032, 0.0095e-3, 0.00075])
    correlation = np.array([[1, -0.36, 0.86], [-0.36, 1, -0.65], [0.86, -0.65, 1]])

    def impedance(x: Array) -> Array:
        v, i, phi = (x[..., k] for k in range(3))
        return np.stack([v / i * np.cos(phi), v / i * np.sin(phi), v / i], axis=-1)

    found, covariance = propagate(impedance, value, correlation * np.outer(sd, sd))
    u = np.sqrt(np.diag(covariance))
    # Table H.3; the inputs are rounded in print, and so the results agree to the digits printed.
    assert np.all(np.abs(found - [127.732, 219.847, 254.260]) < 0.011)
    assert np.all(np.abs(u - [0.071, 0.295, 0.236]) < 0.0015)
    r = covariance / np.outer(u, u)
    assert np.all(np.abs([r[0, 1] + 0.588, r[0, 2] + 0.485, r[1, 2] - 0.993]) < 0.01)
