"""The terms: expected periodograms against dense transforms, variograms against Allan variances."""

import numpy as np
import pytest

from inercal.basics.units import si_factor
from inercal.noise.spectrum import expected_periodogram
from inercal.noise.terms import FLICKER_FLOOR, TERMS, model_avar

N = 256
CASES = [("Q", 1.0), ("N", 1.0), ("B", 1.0), ("K", 1.0),
         ("G", 0.3), ("G", 5.0), ("G", 300.0), ("G", 1e5)]  # fmt: skip


@pytest.mark.parametrize(("symbol", "time"), CASES)
def test_expected_periodogram_is_the_diagonal_of_the_dense_transform(symbol: str, time: float):
    wide = np.longdouble
    k, j = np.meshgrid(np.arange(N), np.arange(N), indexing="ij")
    angle = wide("3.14159265358979323846264338327950288") * k * (j + wide(0.5)) / N
    dct = np.cos(angle) * np.sqrt(wide(2) / N)
    gamma = np.concatenate([[0.0], TERMS[symbol].variogram(np.arange(1.0, N), 0.25, time)])
    dense = -((dct @ gamma[np.abs(k - j)].astype(wide)) * dct).sum(axis=1)[1:]
    assert np.abs(expected_periodogram(symbol, N, 0.25, time) / dense - 1).max() < 1e-11


@pytest.mark.parametrize(("symbol", "time"), CASES)
@pytest.mark.parametrize("m", [1, 4, 32])
def test_the_variogram_of_block_means_gives_the_allan_variance(symbol: str, time: float, m: int):
    dt = 0.25
    gamma = np.concatenate([[0.0], TERMS[symbol].variogram(np.arange(1.0, 2 * m + 1), dt, time)])
    weights = np.repeat([-1.0, 1.0], m) / m
    lag = np.abs(np.subtract.outer(np.arange(2 * m), np.arange(2 * m)))
    variance = -0.5 * weights @ gamma[lag] @ weights
    expected = TERMS[symbol].avar(np.array([m * dt]), dt, time)[0]
    assert variance == pytest.approx(expected, rel=1e-6)


def test_gauss_markov_peaks_at_1_893_times_its_time_constant_with_617_sigma():
    tau = np.linspace(0.5, 5, 100_001)
    sigma = np.sqrt(model_avar({"G": 1.0}, tau, 0.01, 1.0))
    assert tau[sigma.argmax()] == pytest.approx(1.893, abs=1e-3)
    assert sigma.max() == pytest.approx(0.617, abs=5e-4)


def test_flicker_has_its_floor_at_0_664_b():
    assert np.isclose(FLICKER_FLOOR, 0.4413, atol=5e-5)


def test_units_of_random_walks_convert_as_the_standards_state():
    assert si_factor("°/√h") == pytest.approx(2.9089e-4, rel=1e-4)
    assert si_factor("°/√h") / si_factor("°/h/√Hz") == pytest.approx(60)
    assert si_factor("m/s/√h") / si_factor("µg/√Hz") == pytest.approx(1699.5, abs=0.1)
    assert si_factor("°/h/√h") / si_factor("°/h/√s") == pytest.approx(1 / 60)
