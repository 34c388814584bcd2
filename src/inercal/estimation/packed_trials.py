"""Trials given by normal equations, which the problem computes directly without Jacobians."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from inercal.basics.arrays import Array
from inercal.estimation import gauss_newton_steps
from inercal.estimation.nullspace import Observability
from inercal.estimation.problem import NormalEquations, Problem
from inercal.estimation.result import Estimate
from inercal.estimation.search import Bools, merge
from inercal.estimation.whitened_problem import (
    gauge_basis,
    noise_error,
    prior_equations,
    prior_targets,
    require_finite,
)


class PackedPoint(NamedTuple):
    """Normal equations at x, in free coordinates; all arrays have a trials dimension."""

    x: Array  # (trials, p)
    residual: Array  # y − h(x), (trials, m)
    weight: Array  # as of `NormalEquations`, (trials, m)
    whitened: Array  # u, (trials, m)
    normal: Array  # lower triangle of AᵀA, (trials, k (k + 1)/2)
    gradient: Array  # Aᵀu, (trials, k)
    prior: Array  # whitened μ − x, (trials, b)


class PackedTrials:
    """The trials of a problem in the form that `inercal.estimation.search` needs.

    Parameters
    ----------
    problem : Problem
        A problem with `normal_equations`.
    trials : int

    Raises
    ------
    InputError
        At the start, a residual is not finite or a noise is not positive.
    """

    def __init__(self, problem: Problem, trials: int):
        assert problem.normal_equations is not None
        self.problem, self.trials, self._of = problem, trials, problem.normal_equations
        self.reweighted = callable(problem.noise)
        self.basis, start = gauge_basis(problem)
        self._prior_full, self._prior_rows, targets = prior_equations(problem, self.basis)
        self._target = prior_targets(targets, trials)
        self.first = self._point(
            np.broadcast_to(start, (trials, start.shape[-1])), np.arange(trials)
        )
        self.m = self.first.residual.shape[-1]
        require_finite(self.first.residual)
        positive = np.isfinite(self.first.weight).all(axis=0)
        if not positive.all():
            raise noise_error(problem, int(np.flatnonzero(~positive)[0]))

    @property
    def dof(self) -> int:
        """Degrees of freedom of χ²."""
        fixed = 0 if self.basis is None else self.basis.shape[0] - self.basis.shape[1]
        return self.m + len(self._prior_rows) + fixed - len(self.problem.names)

    def _point(self, x: Array, which: NDArray[np.intp]) -> PackedPoint:
        """Return the point for the trials with these indices, at their own x."""
        found = self._of(x, which)
        if self.basis is not None:
            found = _in_free_coordinates(found, self.basis)
        return PackedPoint(x, *found, self._target[which] - x @ self._prior_full.T)

    def cost(self, point: PackedPoint) -> Array:
        """Return the cost at a point; see `inercal.estimation.search.Trials`."""
        return _squares(point.whitened) + _squares(point.prior)

    def step(self, point: PackedPoint, damping: Array, active: Bools) -> tuple[Array, Array, Bools]:
        """Return the moves; see `inercal.estimation.search.Trials`."""
        some = slice(None) if active.all() else np.flatnonzero(active)
        normal, gradient, prior = point.normal[some], point.gradient[some], point.prior[some]
        step = gauss_newton_steps.solve_packed(
            normal, gradient, self._prior_rows, prior, damping[some]
        )
        return gauss_newton_steps.moves(step, self.basis, point.x, some)

    def tried(self, x: Array, point: PackedPoint, active: Bools) -> tuple[PackedPoint, Array]:
        """Return a trial point and its cost; see `inercal.estimation.search.Trials`."""
        which = np.flatnonzero(active)
        tried = self._point(x[which], which)
        if len(which) < len(active):
            whole = PackedPoint(*(a.copy() for a in point))
            for a, b in zip(whole, tried, strict=True):
                a[which] = b
            tried = whole
        if not self.reweighted:
            return tried, self.cost(tried)
        return tried, _squares(point.weight * tried.residual) + _squares(tried.prior)

    def with_values(self, point: PackedPoint, x: Array, chosen: Bools) -> PackedPoint:
        """Return the point with some values replaced; see `inercal.estimation.search.Trials`."""
        return point._replace(x=np.where(chosen[:, None], x, point.x))

    def accepted(self, tried: PackedPoint, point: PackedPoint, chosen: Bools) -> PackedPoint:
        """Return the merged point; see `inercal.estimation.search.Trials`."""
        return tried if chosen.all() else PackedPoint(*merge(chosen, tried, point))

    def estimate(
        self,
        point: PackedPoint,
        structure: Observability,
        converged: Bools,
        iterations: NDArray[np.intp],
    ) -> Estimate:
        """Return the estimate at a solution."""
        covariance, exists = gauss_newton_steps.covariance_packed(point.normal, self._prior_rows)
        if self.basis is not None:
            covariance = self.basis @ covariance @ self.basis.T
        return Estimate(
            names=self.problem.names,
            value=point.x,
            covariance=covariance,
            chi2=self.cost(point),
            dof=self.dof,
            residual=point.residual,
            whitened=point.whitened,
            observations=self.problem.observations,
            wanted=self.problem.wanted,
            **structure._asdict(),
            converged=converged & exists,
            iterations=iterations,
        )


def _squares(u: Array) -> Array:
    with np.errstate(over="ignore", invalid="ignore"):
        return np.einsum("ij,ij->i", u, u)


def _in_free_coordinates(found: NormalEquations, basis: Array) -> NormalEquations:
    """Transform the normal equations to the free coordinates t, where x = x₀ + B t."""
    (p, k), (trials, _) = basis.shape, found.normal.shape
    whole = np.zeros((trials, p, p))
    rows, columns = np.tril_indices(p)
    whole[:, rows, columns] = whole[:, columns, rows] = found.normal
    rows, columns = np.tril_indices(k)
    return found._replace(
        normal=(basis.T @ whole @ basis)[:, rows, columns], gradient=found.gradient @ basis
    )
