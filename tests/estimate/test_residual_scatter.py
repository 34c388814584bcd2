"""Scatter by residuals, against data whose scatter is known."""

import numpy as np
import pytest
from numpy.typing import NDArray
from tests.base_seeds import SEEDS

from inercal.estimation.residual_scatter import ScatterModel, chi_squared, fit_scatter

Array = NDArray[np.float64]
ROWS, COLUMNS = 400, 3


def judged(seed: int, share: float, excess: float, least: float = 0.0) -> ScatterModel:
    """Return the spread of rows of stated deviations 0.5 to 2 whose true ones are others."""
    rng = np.random.default_rng(seed)
    stated = rng.uniform(0.5, 2.0, ROWS)
    jacobian = rng.standard_normal((ROWS, COLUMNS))
    residual = np.sqrt(share * stated**2 + excess**2) * rng.standard_normal(ROWS)

    def whiten(found: ScatterModel, columns: Array) -> Array:
        return columns / np.sqrt(found.share * stated**2 + found.excess**2)[:, None]

    return fit_scatter(residual, jacobian, whiten, ROWS - COLUMNS, least=least)


@pytest.mark.parametrize("seed", SEEDS)
def test_noise_as_stated_stays_as_it_is(seed: int):
    assert judged(seed, 1.0, 0.0) == ScatterModel()


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("true", [0.7, 3.0, 50.0])
def test_the_excess_of_a_scatter_beyond_the_noise_is_found(seed: int, true: float):
    found = judged(seed, 1.0, true)
    assert found.share == 1
    # The variance of a variance: 2 (σ² + v)² over the rows, σ² is about 1.6.
    sd = (true**2 + 1.6) * (2 / ROWS) ** 0.5
    assert found.excess**2 == pytest.approx(true**2, abs=4 * sd)


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("true", [0.5, 0.01])
def test_the_share_of_noise_that_the_rows_do_not_feel_is_found(seed: int, true: float):
    found = judged(seed, true, 0.0)
    assert found.excess == 0
    assert found.share == pytest.approx(true, rel=4 * (2 / ROWS) ** 0.5)


def test_no_share_is_taken_below_what_can_be_told():
    assert judged(1, 0.01, 0.0, least=0.2).share == 0.2
    assert judged(1, 0.01, 0.0, least=5.0).share == 1


def test_chi_squared_is_what_the_parameters_cannot_take_away():
    rng = np.random.default_rng(4)
    jacobian, rest = rng.standard_normal((20, 3)), rng.standard_normal(20)
    solution = np.linalg.lstsq(jacobian, rest, rcond=None)[0]
    expected = float(np.sum((rest - jacobian @ solution) ** 2))
    found = chi_squared(rest + jacobian @ [5.0, -3.0, 1e3], jacobian, lambda a: a)
    assert found == pytest.approx(expected, rel=1e-9)
