"""Linear regression against certified values: NIST StRD and the GUM's thermometer (H.3)."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from numpy.typing import NDArray

from inercal.estimation import Estimate, Problem, least_squares

Array = NDArray[np.float64]

# fmt: off
LONGLEY = np.array([  # y, x1 … x6
    [60323, 83.0, 234289, 2356, 1590, 107608, 1947],
    [61122, 88.5, 259426, 2325, 1456, 108632, 1948],
    [60171, 88.2, 258054, 3682, 1616, 109773, 1949],
    [61187, 89.5, 284599, 3351, 1650, 110929, 1950],
    [63221, 96.2, 328975, 2099, 3099, 112075, 1951],
    [63639, 98.1, 346999, 1932, 3594, 113270, 1952],
    [64989, 99.0, 365385, 1870, 3547, 115094, 1953],
    [63761, 100.0, 363112, 3578, 3350, 116219, 1954],
    [66019, 101.2, 397469, 2904, 3048, 117388, 1955],
    [67857, 104.6, 419180, 2822, 2857, 118734, 1956],
    [68169, 108.4, 442769, 2936, 2798, 120445, 1957],
    [66513, 110.8, 444546, 4681, 2637, 121950, 1958],
    [68655, 112.6, 482704, 3813, 2552, 123366, 1959],
    [69564, 114.2, 502601, 3931, 2514, 125368, 1960],
    [69331, 115.7, 518173, 4806, 2572, 127852, 1961],
    [70551, 116.9, 554894, 4007, 2827, 130081, 1962],
])
LONGLEY_VALUE = [
    -3482258.63459582, 15.0618722713733, -0.358191792925910e-1, -2.02022980381683,
    -1.03322686717359, -0.511041056535807e-1, 1829.15146461355,
]
LONGLEY_SD = [
    890420.383607373, 84.9149257747669, 0.334910077722432e-1, 0.488399681651699,
    0.214274163161675, 0.226073200069370, 455.478499142212,
]
NORRIS_Y = [
    0.1, 338.8, 118.1, 888.0, 9.2, 228.1, 668.5, 998.5, 449.1, 778.9, 559.2, 0.3, 0.1, 778.1, 668.8,
    339.3, 448.9, 10.8, 557.7, 228.3, 998.0, 888.8, 119.6, 0.3, 0.6, 557.6, 339.3, 888.0, 998.5,
    778.9, 10.2, 117.6, 228.9, 668.4, 449.2, 0.2,
]
NORRIS_X = [
    0.2,
    337.4, 118.2, 884.6, 10.1, 226.5, 666.3, 996.3, 448.6, 777.0, 558.2, 0.4, 0.6, 775.5, 666.9,
    338.0, 447.5, 11.6, 556.0, 228.1, 995.8, 887.6, 120.2, 0.3, 0.3, 556.8, 339.1, 887.2, 999.0,
    779.0, 11.1, 118.3, 229.2, 669.1, 448.9, 0.5,
]
# fmt: on


def problem(design: Array, y: Array, trials: int | None = None) -> Problem:
    p = design.shape[1]
    size = np.abs(design).max(axis=0)
    return Problem(
        names=tuple(f"b{i}" for i in range(p)),
        start=np.zeros(p) if trials is None else np.zeros((trials, p)),
        linearise=lambda x: (y - x @ design.T, design),
        noise=np.ones(len(y)),
        scale=np.abs(y).max() / size,
    )


def scaled_sd(estimate: Estimate) -> Array:
    """Return standard deviations by the residuals, as the sources state them."""
    return np.sqrt(np.diagonal(estimate.covariance, axis1=-2, axis2=-1)) * np.sqrt(
        np.asarray(estimate.chi2 / estimate.dof)[..., None]
    )


@pytest.mark.parametrize(("trials", "digits"), [(None, 1e-10), (20, 1e-9)])
def test_longley_is_certified(trials: int | None, digits: float):
    design = np.column_stack([np.ones(16), LONGLEY[:, 1:]])
    estimate = least_squares(problem(design, LONGLEY[:, 0], trials))
    assert np.all(estimate.converged)
    shape = (trials, 7) if trials else 7
    assert_allclose(estimate.value, np.broadcast_to(LONGLEY_VALUE, shape), rtol=digits)
    # The covariance is not refined: the normal equations lose the square of the condition.
    assert_allclose(
        scaled_sd(estimate), np.broadcast_to(LONGLEY_SD, shape), rtol=1e-6 if trials else 1e-10
    )


def test_norris_is_certified():
    design = np.column_stack([np.ones(36), NORRIS_X])
    estimate = least_squares(problem(design, np.array(NORRIS_Y)))
    assert_allclose(estimate.value, [-0.262323073774029, 1.00211681802045], rtol=1e-12)
    assert_allclose(scaled_sd(estimate), [0.232818234301152, 0.429796848199937e-3], rtol=1e-12)
    assert_allclose(np.sqrt(estimate.chi2 / estimate.dof), 0.884796396144373, rtol=1e-12)


@pytest.mark.parametrize("base", [1.0, 0.1], ids=["Wampler1", "Wampler2"])
@pytest.mark.parametrize("trials", [None, 20])
def test_wampler_is_certified(base: float, trials: int | None):
    x = np.arange(21.0)
    design = x[:, None] ** np.arange(6)
    coefficients = base ** np.arange(6)
    y = design @ coefficients
    estimate = least_squares(problem(design, y, trials))
    # Certified are the coefficients themselves, with no residual.
    np.testing.assert_allclose(
        np.atleast_2d(estimate.value), np.broadcast_to(coefficients, (trials or 1, 6)), rtol=1e-9
    )


def test_thermometer_of_gum_h3():
    t = np.array(
        [21.521, 22.012, 22.512, 23.003, 23.507, 23.999, 24.513, 25.002, 25.503, 26.010, 26.511]
    )
    b = -np.array([171, 169, 166, 159, 164, 165, 156, 157, 159, 161, 160]) * 1e-3
    estimate = least_squares(problem(np.column_stack([np.ones(11), t - 20]), b))
    sd = scaled_sd(estimate)
    half_a_digit = np.array([5e-5, 5e-6])
    assert np.all(np.abs(estimate.value - [-0.1712, 0.00218]) < half_a_digit)
    assert np.all(np.abs(sd - [0.0029, 0.00067]) < half_a_digit)
    assert_allclose(estimate.correlation[0, 1], -0.930, atol=5e-4)
    # H.3.4: the correction at 30 °C, −0.1494(41) °C, correlation included.
    row = np.array([1.0, 10.0])
    covariance = estimate.covariance * estimate.chi2 / estimate.dof
    assert_allclose(row @ estimate.value, -0.1494, atol=5e-5)
    assert_allclose(np.sqrt(row @ covariance @ row), 0.0041, atol=5e-5)
