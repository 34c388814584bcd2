"""Flicker as a chain of Gauss–Markov processes, which a filter can have as states.

The Allan variance of Gauss–Markov processes of times T_k and variances v_k is that of flicker of
B = 1, 2 ln 2/π, between two averaging times; the largest misfit of the deviation is least over the
T_k, evenly spaced in ln T, and the v_k ≥ 0. A state of a filter with steps of Δ has φ = e^(−Δ/T)
and the variance q = v (1 − φ²) of its driving noise.
"""

from dataclasses import dataclass

import numpy as np

from inercal.basics.arrays import Array
from inercal.noise.numerics import nonnegative_least_squares
from inercal.noise.terms import FLICKER_FLOOR, TERMS

_POINTS = 24  # averaging times a decade
_ENDS = np.geomspace(0.2, 1.6, 19)  # T of the ends over the averaging times of the ends
_ROUNDS = 6  # of weights that even out the misfit
_SHORTEST = 1e-6  # of the averaging times, Δ of the continuous-time variance


@dataclass(frozen=True, eq=False)
class FlickerStates:
    """Gauss–Markov processes whose sum is flicker of B = 1.

    Parameters
    ----------
    times : (k,) array
        T, s.
    variances : (k,) array
    misfit : float
        Largest relative error of the Allan deviation between the averaging times.
    """

    times: Array
    variances: Array
    misfit: float


def flicker_states(shortest: float, longest: float, states: int) -> FlickerStates:
    """Return the chain for averaging times from `shortest` to `longest`, s.

    Parameters
    ----------
    shortest, longest : float
    states : int
        2 or more.
    """
    tau: Array = np.geomspace(
        shortest, longest, int(_POINTS * np.log10(longest / shortest)) + 2, dtype=np.float64
    )
    best: FlickerStates | None = None
    for low in _ENDS:
        for high in _ENDS:
            times: Array = np.geomspace(float(low) * shortest, float(high) * longest, states)
            found = _chain(tau, times)
            if best is None or found.misfit < best.misfit:
                best = found
    assert best is not None
    return best


def _chain(tau: Array, times: Array) -> FlickerStates:
    avar = TERMS["G"].avar
    columns = np.stack([avar(tau, _SHORTEST * tau[0], float(one)) for one in times], 1)
    columns = columns / FLICKER_FLOOR
    weight, variances, misfit = np.ones(tau.size), np.zeros(times.size), np.inf
    for _ in range(_ROUNDS):
        trial = nonnegative_least_squares(columns * weight[:, None], weight)
        error = np.abs(np.sqrt(columns @ trial) - 1)
        if error.max() < misfit:
            variances, misfit = trial, float(error.max())
        # Lawson's weights lead towards the least largest error.
        weight = weight * np.sqrt(error / error.max() + 1e-3)
    return FlickerStates(times, variances, misfit)
