"""Describe an estimation problem: its parameters, observations and prior knowledge.

y = h(x) + noise, where x contains the wanted parameters and the nuisances. `linearise` returns the
residual y − h(x) and the exact derivative ∂h/∂x. All arrays may have a leading trials dimension;
trials are separate problems with the same structure.

Knowledge from outside the observations is stated by priors and gauges. A Gaussian prior N(μ, Σ) on
some parameters enters as whitened rows L⁻¹(μ − x) with Σ = L Lᵀ, as if those parameters had been
observed once. A gauge C x = d is exact: it fixes properties that no observation can determine (for
example the orientation of a frame). The solver imposes it by moving only within its null space, x =
x₀ + Z t with C Z = 0, not by a large weight.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from inercal.basics.arrays import Array, Indices
from inercal.basics.errors import InputError
from inercal.estimation.scores import Candidate


@dataclass(frozen=True, eq=False)
class Gaussian:
    """A Gaussian prior on some of the parameters.

    Parameters
    ----------
    names : tuple of str
        The k parameters.
    mean : (..., k) array
        Their expected values, with or without the problem's leading trials dimension.
    covariance : (k, k) array
        Their covariance, positive definite.
    temperature : (float, float) or None
        Temperature range of the data behind the prior, K; None if it is unknown.

    Raises
    ------
    InputError
        A shape does not fit, a value is not finite, or the covariance is not symmetric and positive
        definite.
    """

    names: tuple[str, ...]
    mean: Array
    covariance: Array
    temperature: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        k, what = len(self.names), f"prior on {', '.join(self.names)}"
        if self.mean.shape[-1:] != (k,) or self.covariance.shape != (k, k):
            raise InputError(
                f"{what}: mean {self.mean.shape} and covariance {self.covariance.shape} do not fit"
                f" {k} names; expected (..., {k}) and ({k}, {k})",
                key="mean",
                names=self.names,
            )
        if not np.all(np.isfinite(self.mean)):
            raise InputError(
                f"{what}: a mean is not finite; give finite numbers", key="mean", names=self.names
            )
        cholesky(self.covariance, what, self.names)

    @classmethod
    def independent(cls, names: Sequence[str], mean: ArrayLike, sd: ArrayLike) -> "Gaussian":
        """Return an uncorrelated prior, from standard deviations (k,) or a common one."""
        k = len(names)
        means = np.asarray(mean, dtype=float)
        sds = np.broadcast_to(np.asarray(sd, dtype=float), (k,))
        means = means if means.ndim else np.full(k, float(means))
        return cls(tuple(names), means, np.diag(sds**2))

    def marginal(self, names: Sequence[str]) -> "Gaussian | None":
        """Return the prior restricted to the parameters in `names`, or None if there are none."""
        keep = [i for i, name in enumerate(self.names) if name in names]
        if not keep:
            return None
        kept = tuple(self.names[i] for i in keep)
        return Gaussian(kept, self.mean[..., keep], self.covariance[np.ix_(keep, keep)])

    def of_trials(self, part: slice) -> "Gaussian":
        """Return the prior for some of the trials, unchanged if all trials share it."""
        return self if self.mean.ndim == 1 else replace(self, mean=self.mean[part])

    def rows(self, names: Sequence[str]) -> tuple[Array, Array]:
        """Return the whitened rows L⁻¹ for all parameters `names`, (k, p), and L⁻¹ μ, (..., k)."""
        inverse = np.linalg.inv(np.linalg.cholesky(self.covariance))
        rows = np.zeros((len(self.names), len(names)))
        rows[:, [names.index(name) for name in self.names]] = inverse
        return rows, self.mean @ inverse.T


@dataclass(frozen=True, eq=False)
class Gauge:
    """An exact linear constraint C x = d on some of the parameters.

    Parameters
    ----------
    words : str
        Description of the constraint for reports, such as "x is the triad's first axis".
    names : tuple of str
        The k parameters.
    matrix : (q, k) array
        The matrix C, which has full row rank.
    value : (q,) array
        The right-hand side d.

    Raises
    ------
    InputError
        A shape does not fit, or rows are linearly dependent.
    """

    words: str
    names: tuple[str, ...]
    matrix: Array
    value: Array

    def __post_init__(self) -> None:
        q, k = len(self.value), len(self.names)
        if self.matrix.shape != (q, k):
            raise InputError(
                f"gauge '{self.words}': matrix {self.matrix.shape} does not fit {q} values of"
                f" {k} names; expected ({q}, {k})",
                key="matrix",
                names=self.names,
            )
        if np.linalg.matrix_rank(self.matrix) < q:
            raise InputError(
                f"gauge '{self.words}': its {q} rows are not independent; remove a dependent row",
                key="matrix",
                names=self.names,
            )

    def rows(self, names: Sequence[str]) -> Array:
        """Return C with one column for each parameter in `names`, (q, p)."""
        rows = np.zeros((len(self.value), len(names)))
        rows[:, [names.index(name) for name in self.names]] = self.matrix
        return rows


def cholesky(covariance: Array, what: str, names: tuple[str, ...] = ()) -> Array:
    """Return the lower triangular Cholesky factor L, with L Lᵀ = covariance, (..., m, m).

    Parameters
    ----------
    covariance : (..., m, m) array
    what : str
        The subject of the error message.
    names : tuple of str
        The parameters of the covariance, which the error carries as data.

    Raises
    ------
    InputError
        The covariance is not finite, not symmetric or not positive definite.
    """

    def refusal(fault: str) -> InputError:
        return InputError(
            f"{what}: the covariance is not {fault}; correct it", key="covariance", names=names
        )

    if not np.all(np.isfinite(covariance)):
        raise refusal("finite")
    # Judged from correlations, because the parameters' units may differ by many decades.
    with np.errstate(invalid="ignore", divide="ignore"):
        sd = np.sqrt(np.linalg.diagonal(covariance))
        correlation = covariance / (sd[..., :, None] * sd[..., None, :])
    asymmetry = np.abs(correlation - correlation.mT)
    if not np.all(asymmetry < 1e-8):
        raise refusal("symmetric with a positive diagonal")
    try:
        lower = np.asarray(np.linalg.cholesky(correlation), dtype=float)
    except np.linalg.LinAlgError:
        raise refusal("positive definite") from None
    return sd[..., :, None] * lower


Linearise = Callable[[Array], tuple[Array, Array]]
Candidates = Callable[[Array], Iterable[Candidate]]


class NormalEquations(NamedTuple):
    """Normal equations of trials, linearised and whitened at one x each, for a solver step."""

    residual: Array  # y − h(x), (trials, m)
    weight: Array  # 1/sd of the observations, (trials, m); ones where they are correlated
    whitened: Array  # u, (trials, m)
    normal: Array  # lower triangle of AᵀA, row after row, (trials, p (p + 1)/2)
    gradient: Array  # Aᵀu, (trials, p)

    @classmethod
    def empty(cls, trials: int, m: int, p: int) -> "NormalEquations":
        """Return uninitialised arrays."""
        return cls(*(np.empty((trials, size)) for size in (m, m, m, p * (p + 1) // 2, p)))


NormalEquationsOf = Callable[[Array, Indices], NormalEquations]
KnownNull = tuple[str, Array | Callable[[Array], Array]]


@dataclass(frozen=True, eq=False)
class Problem:
    """An estimation problem: parameters, observations, noise, priors and gauges.

    Parameters
    ----------
    names : tuple of str
        The p parameters, in the order of every vector.
    start : (p,) or (trials, p) array
        Point at which the search starts and observability is determined: wanted parameters at
        nominal, nuisances at their prior mean. Without a trials dimension, all trials share this
        point.
    linearise : callable
        Function of x that returns the residual y − h(x), (..., m), and the Jacobian ∂h/∂x, (..., m,
        p). It is first called with x = `start`, and then, if there are trials, with all of them,
        (trials, p). A Jacobian that all trials share may have the shape (m, p).
    noise : array or callable
        Standard deviation of the observations, (m,) or (trials, m); with `correlated`, their
        covariance, (m, m) or (trials, m, m). A callable of x that returns this is also allowed: the
        weights are then constant within a step and updated between steps. It is called after
        `linearise`, with the same x.
    scale : (p,) array
        Typical size of each parameter, positive; it makes singular values dimensionless.
    priors : tuple of Gaussian
        Independent priors; priors that share a name are multiplied.
    gauges : tuple of Gauge
        Exact constraints.
    wanted : tuple of str, optional
        The parameters to estimate (all, when empty); the others are nuisances.
    observations : tuple of str, optional
        One label for each of the m observations.
    known_nulls : tuple of (words, direction)
        Directions that the method knows to be unobservable in some plans, with their names. A
        direction is a vector (p,) or vectors (k, p) in the parameters' units, or a callable of x
        (p,) that returns them.
    rounding : float or (trials,) array
        Relative error of χ² due to rounding in `linearise`; a smaller decrease is not significant.
    candidates : callable, optional
        Function of the solution x (p,) that returns candidates for score tests: parameters that the
        problem omits or assumes known, with the derivatives of the observations, not whitened. It
        is called only for a problem without trials.
    correlated : bool
        Whether `noise` is a covariance. Its shape is ambiguous if there are as many trials as
        observations.
    normal_equations : callable, optional
        The same model for many trials, in one pass and without an array of all derivatives. It is a
        function of x (k, p) and of the indices of these k trials (k,) that returns their normal
        equations, where A is the whitened Jacobian and u the whitened residual.
        `least_squares_of_trials` uses it instead of `linearise` and `noise`. Noise that depends on
        x must be uncorrelated here.

    Raises
    ------
    InputError
        Shapes do not fit, names are unknown, or values are not finite or not positive.
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
    rounding: float | Array = 1e-12
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
                f"start: {', '.join(unset)} is not finite; give a finite number",
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
