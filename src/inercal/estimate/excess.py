"""Scatter that the stated noise does not explain: the variance that would.

Observations that disagree by more than their noise have errors of their own, which more samples do
not average away: a rest repeated differs from the first by more than its own noise says. Enlarging
every variance by χ²/ν (Birge) keeps the longest observations in charge; adding one variance v to
all of them does not, and v is found where the weighted residuals have the size they should:

    χ²(v) = ν

Source: Paule and Mandel 1982, J. Research NBS 87, 377–385, equations 8 to 10, for a weighted mean;
here for any linear model. χ²(v) falls with v, so there is one root or none.
"""

# pyright: reportMissingTypeStubs=false

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtri

Array = NDArray[np.float64]
Whiten = Callable[[float, Array], Array]
_LEVEL = 0.95
_HALVINGS = 30  # of a factor of 2²⁰ or so: v to 1e-7 of itself


def chi_squared(residual: Array, jacobian: Array, whiten: Callable[[Array], Array]) -> float:
    """Return the least sum of squares of whitened residuals over moves of the parameters.

    Parameters
    ----------
    residual : (m,) array
    jacobian : (m, p) array
        Without columns that are all zero.
    whiten : callable
        From (m, k) to the same whitened.
    """
    both = whiten(np.column_stack([jacobian, residual]))
    size = np.linalg.norm(both[:, :-1], axis=0)
    both[:, :-1] /= np.where(size > 0, size, 1.0)
    triangle: Array = np.asarray(np.linalg.qr(both, mode="r"), dtype=np.float64)
    p = jacobian.shape[1]
    return float(np.sum(triangle[p:, p] ** 2))


def excess(residual: Array, jacobian: Array, whiten: Whiten, expected: float, dof: int) -> float:
    """Return the variance to add, in the residuals' unit squared; 0 where none is needed.

    Parameters
    ----------
    residual : (m,) array
        At a solution.
    jacobian : (m, p) array
    whiten : callable
        (v, (m, k) array) to the array whitened by the noise with v added.
    expected : float
        What χ² should be.
    dof : int
        Degrees of freedom: v is looked for only where χ² lies beyond the 95 % bound of so many.
    """
    if dof < 1:
        return 0.0
    beyond = chi_squared(residual, jacobian, lambda a: whiten(0.0, a)) - expected
    if beyond <= float(chdtri(dof, 1 - _LEVEL)) - dof:
        return 0.0
    high = float(np.mean(residual**2))
    while chi_squared(residual, jacobian, lambda a, v=high: whiten(v, a)) > expected:
        high *= 4.0
    low = high * 2.0**-20
    for _ in range(_HALVINGS):
        middle = np.sqrt(low * high)
        if chi_squared(residual, jacobian, lambda a, v=middle: whiten(v, a)) > expected:
            low = middle
        else:
            high = middle
    return float(np.sqrt(low * high))
