"""Tests of an estimator without residuals of its own, by maximum likelihood.

A closed formula uses some of the readings, or all with equal weights; its residuals test nothing.
The problem of maximum likelihood of the same observations, with the bench as stated, has a χ² and
score tests of the readings, whatever formula is used.

The formula itself is tested by its difference d from maximum likelihood. Where both hold, an
efficient estimate and any other of covariance C have (Hausman 1978, Econometrica 46, 1251–1271)::

    cov(d) = C − C_ml        T = dᵀ (C − C_ml + ε C)⁻¹ d

T is at most χ² with one degree of freedom per coefficient. ε adds a tenth of the formula's standard
uncertainty: where the formula is as good as maximum likelihood, C − C_ml is rounding.
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
    """Return a noise-only estimate with the tests of the problem of the same observations."""
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
    """Return an estimate with the tests of its observations and of its formula.

    Parameters
    ----------
    estimate : Estimate
        Of one recording. An estimate of many trials or without uncertainty is returned unchanged,
        as is any estimate where the maximum likelihood fails.
    whole : Problem
        Of maximum likelihood, with all stated errors of the bench.
    stated : Problem, optional
        The same with the errors in the estimate's covariance, where these are fewer.
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
    """Return the test of an estimate's difference from that of maximum likelihood."""
    sd = np.sqrt(np.diagonal(estimate.covariance))
    between = (estimate.covariance - best.covariance) / np.outer(sd, sd)
    size, axes = np.linalg.eigh(between)
    away = axes.T @ ((estimate.value - best.value) / sd)
    own = np.einsum("ik,ij,jk->k", axes, estimate.covariance / np.outer(sd, sd), axes)
    statistic = float(np.sum(away**2 / (np.maximum(size, 0.0) + _REGULARISATION * own)))
    return ModelTest(FORMULA_TEST, statistic, len(sd))
