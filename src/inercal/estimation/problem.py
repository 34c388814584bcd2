"""An estimation problem: parameters, observations and prior knowledge.

y = h(x) + noise, where x holds the wanted parameters and the nuisances. `linearise` gives the
residual y − h(x) and the exact derivative ∂h/∂x. Everything may carry a leading axis of trials,
which are separate problems of one structure.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from inercal.basics.arrays import Array
from inercal.basics.errors import InputError
from inercal.estimation.priors_and_gauges import Gauge, Gaussian
from inercal.estimation.scores import Candidate

Linearise = Callable[[Array], tuple[Array, Array]]
Candidates = Callable[[Array], Iterable[Candidate]]


class NormalEquations(NamedTuple):
    """What a step needs of the observations of trials, linearised and whitened at one x each."""

    residual: Array  # y − h(x), (trials, m)
    weight: Array  # 1/sd of the observations, (trials, m); ones where they are correlated
    whitened: Array  # u, (trials, m)
    normal: Array  # lower triangle of AᵀA, row after row, (trials, p (p + 1)/2)
    gradient: Array  # Aᵀu, (trials, p)


NormalEquationsOf = Callable[[Array, NDArray[np.intp]], NormalEquations]
KnownNull = tuple[str, Array | Callable[[Array], Array]]


@dataclass(frozen=True, eq=False)
class Problem:
    """Parameters, observations through `linearise`, their noise, priors and gauges.

    Parameters
    ----------
    names : tuple of str
        The p parameters; their order is that of every vector.
    start : (p,) or (trials, p) array
        Where the search starts and where observability is determined: wanted parameters at nominal,
        nuisances at their prior mean. Without an axis of trials it is the start of all.
    linearise : callable
        x to the residual y − h(x), (..., m), and the Jacobian ∂h/∂x, (..., m, p). It is called
        with x as `start` first, and then, where there are trials, for all of them, (trials, p). A
        Jacobian that all trials share may stay (m, p).
    noise : array or callable
        Standard deviation of the observations, (m,) or (trials, m); with `correlated` their
        covariance, (m, m) or (trials, m, m). Or a callable of x that returns it: the weights are
        constant within a step and updated between steps. It is called after `linearise`, with the
        same x.
    scale : (p,) array
        Typical size of each parameter, positive; it makes singular values free of units.
    priors : tuple of Gaussian
        Independent priors; those that share a name multiply.
    gauges : tuple of Gauge
        Exact constraints.
    wanted : tuple of str, optional
        The parameters to estimate (all, when empty); the others are nuisances.
    observations : tuple of str, optional
        One label for each of the m observations.
    known_nulls : tuple of (words, direction)
        Directions that a method knows to be unobservable in some plans, with their names: a vector
        (p,) or vectors (k, p) in the parameters' units, or a callable of x (p,) giving them.
    rounding : float
        Relative error of χ² by the rounding of `linearise`; a smaller fall is not significant.
    candidates : callable, optional
        From the solution x (p,) to the parameters that the problem omits or takes as known, with
        the derivatives of the observations, not whitened; each gets a score test. Called only for a
        problem without trials.
    correlated : bool
        Whether `noise` is a covariance: of as many trials as observations its shape cannot tell.
    normal_equations : callable, optional
        The same model for many trials, in one pass and without an array of all derivatives: from x
        (k, p) and the places of these k trials (k,) to their normal equations, with A the whitened
        Jacobian and u the whitened residual. `least_squares_of_trials` takes it instead of
        `linearise` and `noise`. A noise that depends on x is without correlations here.

    Raises
    ------
    InputError
        Shapes that do not fit, unknown names, values that are not finite or not positive.
    """

    names: tuple[str, ...]
    start: Array
    linearise: Linearise
    noise: Array | Callable[[Array], Array]
    scale: Array
    priors: tuple[Gaussian, ...] = ()
    gauges: tuple[Gauge, ...] = ()
    wanted: tuple[str, ...] = ()
    observations: tuple[str, ...] = ()
    known_nulls: tuple[KnownNull, ...] = ()
    rounding: float = 1e-12
    candidates: Candidates | None = None
    correlated: bool = False
    normal_equations: NormalEquationsOf | None = None

    def __post_init__(self) -> None:
        p = len(self.names)
        if len(set(self.names)) != p:
            twice = tuple(sorted({name for name in self.names if self.names.count(name) > 1}))
            raise InputError(
                f"parameter {', '.join(twice)} is declared twice; remove or rename it",
                key="names",
                names=twice,
            )
        if self.start.shape[-1:] != (p,) or self.start.ndim > 2:
            raise InputError(
                f"start has shape {self.start.shape}; expected ({p},) or (trials, {p})", key="start"
            )
        bad = ~np.isfinite(np.atleast_2d(self.start)).all(axis=0)
        if bad.any():
            unset = tuple(self.names[k] for k in np.flatnonzero(bad))
            raise InputError(
                f"start: {', '.join(unset)} is not a finite number; give one",
                key="start",
                names=unset,
            )
        if self.scale.shape != (p,) or not np.all(np.isfinite(self.scale) & (self.scale > 0)):
            raise InputError(
                f"scale must be {p} finite, positive sizes, one for each parameter", key="scale"
            )
        for what, factors in (("prior", self.priors), ("gauge", self.gauges)):
            for factor in factors:
                self._known(factor.names, what)
        self._known(self.wanted, "wanted")
        if not self.wanted:
            object.__setattr__(self, "wanted", self.names)

    def _known(self, names: tuple[str, ...], what: str) -> None:
        unknown = tuple(name for name in names if name not in self.names)
        if unknown:
            raise InputError(
                f"{what}: there is no parameter {unknown[0]!r}; this problem has "
                f"{', '.join(self.names)}",
                key=what,
                names=unknown,
            )

    @property
    def nuisances(self) -> tuple[str, ...]:
        """The parameters that are not wanted."""
        return tuple(name for name in self.names if name not in self.wanted)
