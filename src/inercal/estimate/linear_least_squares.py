"""Weighted linear least squares: y = h₀ + A x + noise, solved in one step and refined once."""

import numpy as np

from inercal.estimate import gauss_newton_steps, nullspace
from inercal.estimate.least_squares import estimate_at_solution
from inercal.estimate.problem import Problem
from inercal.estimate.result import Estimate
from inercal.estimate.whitened_problem import WhitenedProblem


def linear_least_squares(problem: Problem) -> Estimate:
    """Solve a problem whose model is linear in its parameters.

    The second step, from the residual of the first solution, removes what rounding left in the
    first (iterative refinement). Were it large, the model would not have been linear.

    Parameters
    ----------
    problem : Problem
        Its Jacobian does not depend on x.

    Returns
    -------
    Estimate
        `converged` is False for a trial whose model turned out not to be linear.

    Raises
    ------
    InputError
        Shapes, noise or values that cannot be used.
    NotObserved
        Wanted parameters that neither data nor priors nor gauges determine.
    """
    system = WhitenedProblem(problem)
    structure = nullspace.observability(system, system.first)
    point, left = system.first, np.zeros(system.trials)
    for _ in range(2):
        step = gauss_newton_steps.solve(
            point.rows,
            point.weight,
            point.whitened,
            system.prior_rows,
            point.prior,
            np.zeros(system.trials),
        )
        move = step.step if system.basis is None else step.step @ system.basis.T
        x = point.x + move
        point, left = system.point(x, *system.evaluate(x)), step.predicted
    chi2 = np.sum(point.whitened**2, axis=-1) + np.sum(point.prior**2, axis=-1)
    linear_model = left <= 1e-10 * np.maximum(chi2, 1.0)
    return estimate_at_solution(system, point, structure, linear_model, np.full(system.trials, 2))
