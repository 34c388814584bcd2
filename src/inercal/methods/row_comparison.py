"""How observations are compared with what a bench states, and their noise."""

from collections.abc import Callable
from typing import NamedTuple

from inercal.basics.arrays import Array
from inercal.estimation.problem import NormalEquationsOf


class ReadingNoise(NamedTuple):
    """Deviations of readings, (..., m r), or if correlated their covariance, (..., m r, m r)."""

    noise: Array
    correlated: bool


class RowComparison(NamedTuple):
    """How n observations are compared with the bench's motion.

    Parameters
    ----------
    linearise : callable
        As `Problem.linearise`.
    noise : array or callable
    correlated : bool
        As of `Problem`.
    rows : tuple of n str
        Names of the observations.
    relative_size : callable
        From parameters to the largest ratio of an observation to its standard deviation.
    normal_equations : callable, optional
        As of `Problem`.
    """

    linearise: Callable[[Array], tuple[Array, Array]]
    noise: Array | Callable[[Array], Array]
    correlated: bool
    rows: tuple[str, ...]
    relative_size: Callable[[Array], float]
    normal_equations: NormalEquationsOf | None = None
