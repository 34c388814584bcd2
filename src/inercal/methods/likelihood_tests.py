"""Test estimators without meaningful residuals of their own, by maximum likelihood.

A closed formula uses only some of the readings, or all of them with equal weights, so its residuals
test nothing. The maximum-likelihood problem with the same observations and the stated bench gives a
χ² and score tests of the readings, whichever formula is used.

The formula itself is tested by its difference d from maximum likelihood. If both are valid, the
maximum-likelihood estimate is efficient. For any other estimate with covariance C (Hausman 1978,
Econometrica 46, 1251–1271)::

    cov(d) = C − C_ml        T = dᵀ (C − C_ml + ε C)⁻¹ d

T is at most a χ² variable with one degree of freedom per coefficient. The term with ε adds a tenth
of the formula's standard uncertainty, because C − C_ml is only rounding if the formula is as good
as maximum likelihood.
"""

from dataclasses import replace

import numpy as np

from inercal.basics.arrays import Array
from inercal.basics.errors import InputError, NotObserved
from inercal.estimation import Estimate, ModelTest, Problem, least_squares
from inercal.methods.observability import NOISE_ONLY_NOTE
from inercal.physics.sensors import Sensor

READINGS_TEST = "readings against the bench as stated"
FORMULA_TEST = "estimator against maximum likelihood"
_REGULARISATION = 0.01  # ε


def noise_only_estimate(sensor: Sensor, value: Array, spread: Array) -> Estimate:
    """Return the result of closed formulas, (p,) with covariance (p, p), for an exact bench."""
    information = np.linalg.inv(spread / np.outer(sensor.unit_scale, sensor.unit_scale))
    singular = np.sqrt(np.linalg.eigvalsh(information)[::-1])
    return Estimate.from_closed_form(
        sensor.coefficients, value, spread, singular, (NOISE_ONLY_NOTE,)
    )


def with_problem_tests(found: Estimate, by_problem: Estimate) -> Estimate:
    """Return a noise-only estimate with the tests of a problem that has the same observations."""
    p = len(found.names)
    agreement = ModelTest(READINGS_TEST, float(by_problem.chi2), by_problem.dof)
    return replace(
        found,
        tests=(agreement, *by_problem.tests),
        scoring=by_problem.scoring.then(
            lambda score_tests: score_tests.with_shifts(lambda shift: shift[:p])
        ),
        rows=by_problem.rows,
        notes=(*found.notes, *by_problem.notes),
    )


def with_tests(estimate: Estimate, whole: Problem, stated: Problem | None = None) -> Estimate:
    """Return an estimate with tests of its observations and of its formula.

    Parameters
    ----------
    estimate : Estimate
        Estimate from one recording. An estimate from many trials or without uncertainty is returned
        unchanged, and so is any estimate for which maximum likelihood fails.
    whole : Problem
        The maximum-likelihood problem with all stated errors of the bench.
    stated : Problem, optional
        The same problem, with only the errors that the estimate's covariance includes, if it
        includes fewer.
    """
    if estimate.value.ndim != 1 or not np.isfinite(estimate.covariance).all():
        return estimate
    try:
        best = least_squares(whole)
        reference = best if stated is None else least_squares(stated)
    except (NotObserved, InputError):
        return estimate
    if not (best.converged and reference.converged):
        return estimate
    tests = [ModelTest(READINGS_TEST, float(best.chi2), best.dof)] if best.dof else []
    at = [best.names.index(name) for name in estimate.names]
    formula = _hausman_test(estimate, reference.select(estimate.names))
    return replace(
        estimate,
        tests=(*estimate.tests, *tests, formula),
        scoring=best.scoring.then(
            lambda score_tests: score_tests.with_shifts(lambda shift: shift[at])
        ),
        rows=best.rows,
    )


def _hausman_test(estimate: Estimate, best: Estimate) -> ModelTest:
    """Test the difference between an estimate and the maximum-likelihood estimate."""
    sd = np.sqrt(np.diagonal(estimate.covariance))
    between = (estimate.covariance - best.covariance) / np.outer(sd, sd)
    size, axes = np.linalg.eigh(between)
    away = axes.T @ ((estimate.value - best.value) / sd)
    own = np.einsum("ik,ij,jk->k", axes, estimate.covariance / np.outer(sd, sd), axes)
    statistic = float(np.sum(away**2 / (np.maximum(size, 0.0) + _REGULARISATION * own)))
    return ModelTest(FORMULA_TEST, statistic, len(sd))
