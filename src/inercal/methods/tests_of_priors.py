"""Test the priors of an estimate that has no other score tests, such as the one of a filter."""

from dataclasses import replace

import numpy as np

from inercal.estimation import Estimate, ScoreTestSet, score_tests
from inercal.estimation.candidate_scores import rows_from_products
from inercal.estimation.lazy_value import LazyValue
from inercal.methods import Priors
from inercal.methods.candidates import prior_candidates
from inercal.physics.sensors import Sensor

# Share of a prior's information; with less from the data, rounding would decide a test of the prior
_LEAST_INFORMATION = 1e-6


def with_tests_of_priors(estimate: Estimate, sensor: Sensor, priors: Priors) -> Estimate:
    """Return an estimate that has no score tests, such as from a filter, with those of priors.

    With the prior N(μ, S), and the estimate x̂ with covariance P, the products of
    `rows_from_products` are S⁻¹ − S⁻¹ P S⁻¹ and S⁻¹ (x̂ − μ). A prior that is wrong by δ shifts
    the estimate by −P S⁻¹ δ.
    """
    if not priors:
        return estimate
    roots, targets = zip(*(prior.rows(estimate.names) for prior in priors), strict=True)
    root = np.concatenate(roots)
    inverse, moved = root.T @ root, estimate.covariance @ root.T @ root
    gram = inverse - inverse @ moved
    decided = np.diagonal(gram) < _LEAST_INFORMATION * np.diagonal(inverse)  # by the priors
    gram[decided], gram[:, decided] = 0.0, 0.0
    product = root.T @ (root @ estimate.value - np.concatenate(targets))
    residual, rows = rows_from_products(gram, np.where(decided, 0.0, product))
    column = dict(zip(estimate.names, rows.T, strict=True))
    found = [
        replace(one, moved=moved @ one.moved)
        for one in prior_candidates(sensor, estimate.names, priors, column)
        if one.moved is not None
    ]

    def tested() -> ScoreTestSet:
        scores = score_tests(residual, np.zeros((len(residual), 0)), found)
        return replace(scores, chi2=float(estimate.chi2), dof=estimate.dof)

    return replace(estimate, scoring=LazyValue(tested))
