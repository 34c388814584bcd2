import numpy as np
import pytest
from numpy.testing import assert_allclose
from numpy.typing import NDArray
from scipy.optimize import minimize
from scipy.special import chdtri

from inercal.basics.errors import InputError
from inercal.estimation.uncertainty.components import variance_components

Array = NDArray[np.float64]


def lots_of(sizes: list[int]) -> NDArray[np.intp]:
    return np.repeat(np.arange(len(sizes)), sizes)


def draw(
    rng: np.random.Generator, lots: NDArray[np.intp], std: Array, within: float, between: float
) -> Array:
    count = lots.max() + 1
    return (
        5.0
        + between * rng.normal(size=count)[lots]
        + within * rng.normal(size=lots.size)
        + std * rng.normal(size=lots.size)
    )


def test_equal_uncertainties_give_the_analysis_of_variance():
    """Balanced lots: σ² = MS_within − u², σ_L² = (MS_between − MS_within)/m (ISO 5725-2)."""
    rng = np.random.default_rng(1)
    lots, u = lots_of([20] * 10), np.full(200, 0.7)
    y = draw(rng, lots, u, 1.0, 2.0).reshape(10, 20)
    inside = y.var(axis=1, ddof=1).mean()
    between = 20 * y.mean(axis=1).var(ddof=1)
    found = variance_components(y.ravel(), u, lots)
    assert found.lots is not None
    assert_allclose(found.within.sd**2, inside - 0.49, rtol=1e-6)
    assert_allclose(found.lots.sd**2, (between - inside) / 20, rtol=1e-6)
    assert_allclose(found.mean, y.mean(), rtol=1e-9)
    assert_allclose(found.std**2, between / 200, rtol=1e-6)
    limits = [190 * inside / chdtri(190, p) - 0.49 for p in (0.02275, 0.97725)]
    assert_allclose([found.within.low**2, found.within.high**2], limits, rtol=1e-6)


def test_unequal_uncertainties_are_near_restricted_maximum_likelihood():
    rng = np.random.default_rng(2)
    lots = lots_of([6, 16, 10, 24, 12, 8, 14, 18])
    u = rng.uniform(0.2, 1.5, lots.size)
    y = draw(rng, lots, u, 1.0, 0.8)

    def minus_likelihood(logs: Array) -> float:
        within, between = np.exp(2 * logs)
        v = np.diag(u**2 + within) + between * (lots[:, None] == lots)
        inverse = np.linalg.inv(v)
        a = inverse.sum()
        r = y - (inverse @ y).sum() / a
        return np.linalg.slogdet(v)[1] + np.log(a) + r @ inverse @ r

    reml = np.exp(minimize(minus_likelihood, np.zeros(2), method="Nelder-Mead").x)
    found = variance_components(y, u, lots)
    assert found.lots is not None
    assert_allclose([found.within.sd, found.lots.sd], reml, rtol=0.06)


def test_intervals_hold_the_truth_with_their_coverage_and_the_estimates_have_no_bias():
    rng = np.random.default_rng(3)
    lots, trials = lots_of([6, 9, 12, 8, 5, 10, 7, 11]), 300
    u = rng.uniform(0.3, 1.2, lots.size)
    held = np.zeros(2)
    variances = np.zeros((trials, 2))
    for k in range(trials):
        found = variance_components(draw(rng, lots, u, 1.0, 1.5), u, lots)
        assert found.lots is not None
        held += [found.within.low <= 1.0 <= found.within.high,
                 found.lots.low <= 1.5 <= found.lots.high]  # fmt: skip
        variances[k] = found.within.sd**2, found.lots.sd**2
    assert np.all(np.abs(held / trials - 0.9545) < 3 * np.sqrt(0.0455 * 0.9545 / trials))
    error = variances.mean(axis=0) - [1.0, 2.25]
    assert np.all(np.abs(error) < 3 * variances.std(axis=0) / np.sqrt(trials))


def test_scatter_below_the_stated_uncertainty_is_no_scatter_between_sensors():
    rng = np.random.default_rng(4)
    u = np.ones(400)
    found = variance_components(0.5 * rng.normal(size=400), u)
    assert (found.within.sd, found.within.low, found.lots) == (0.0, 0.0, None)
    assert_allclose(found.std, 1 / 20)


def test_values_without_uncertainty_have_their_own_standard_deviation():
    rng = np.random.default_rng(5)
    y = 1e6 + rng.normal(size=50)
    assert_allclose(variance_components(y, np.zeros(50)).within.sd, y.std(ddof=1), rtol=1e-6)
    assert variance_components(np.ones(5), np.zeros(5)).within.sd == 0


def test_lots_of_one_sensor_are_refused():
    with pytest.raises(InputError, match="two values"):
        variance_components(np.arange(4.0), np.ones(4), np.arange(4))
