"""Tests of an estimator that leaves no residuals of its own, by maximum likelihood.

A closed formula uses some of the readings, or weighs them alike, and its remainder tests nothing.
The same observations have a problem of maximum likelihood with the bench as stated. Its χ² tests
the readings whatever formula is used, and so do its score tests.

The formula itself is tested by its difference d from maximum likelihood. Where both hold, an
efficient estimate and any other of covariance C have (Hausman 1978, Econometrica 46, 1251–1271)::

    cov(d) = C − C_ml        T = dᵀ (C − C_ml + ε C)⁻¹ d

T is at most χ² of as many degrees of freedom as there are coefficients. ε leaves a tenth of what
the formula states as uncertainty: where it is as good as maximum likelihood, C − C_ml is rounding.
"""

from dataclasses import replace

import numpy as np

from inercal.errors import InputError, NotObserved
from inercal.estimate import Estimate, ModelTest, Problem, least_squares

READINGS_TEST = "readings against the bench as stated"
FORMULA_TEST = "estimator against maximum likelihood"
_REGULARISATION = 0.01  # ε


def with_tests(estimate: Estimate, whole: Problem, stated: Problem | None = None) -> Estimate:
    """Return an estimate with the tests of its observations and of its formula.

    Parameters
    ----------
    estimate : Estimate
        Of one recording; of many trials, or without uncertainty, it is returned as it is, and so
        it is where maximum likelihood cannot be had.
    whole : Problem
        Of maximum likelihood, with all that the bench states.
    stated : Problem, optional
        The same with what the estimate's covariance holds, where that is less.
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
