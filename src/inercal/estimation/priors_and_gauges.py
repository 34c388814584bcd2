"""Describe what is known apart from the observations: Gaussian priors and exact gauges.

A prior N(μ, Σ) on some parameters enters as whitened rows L⁻¹(μ − x) with Σ = L Lᵀ, as if those
parameters had been observed once. A gauge C x = d is exact: it fixes properties that no observation
can determine (for example the orientation of a frame). The solver imposes it by moving only within
its null space, x = x₀ + Z t with C Z = 0, not by a large weight.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from inercal.basics.arrays import Array
from inercal.basics.errors import InputError


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

    Raises
    ------
    InputError
        A shape does not fit, a value is not finite, or the covariance is not symmetric and positive
        definite.
    """

    names: tuple[str, ...]
    mean: Array
    covariance: Array

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
        sd = np.sqrt(np.diagonal(covariance, axis1=-2, axis2=-1))
        correlation = covariance / (sd[..., :, None] * sd[..., None, :])
    asymmetry = np.abs(correlation - np.swapaxes(correlation, -1, -2))
    if not np.all(asymmetry < 1e-8):
        raise refusal("symmetric with a positive diagonal")
    try:
        lower = np.asarray(np.linalg.cholesky(correlation), dtype=float)
    except np.linalg.LinAlgError:
        raise refusal("positive definite") from None
    return sd[..., :, None] * lower
