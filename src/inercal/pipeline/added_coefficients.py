"""Add the coefficients that the score tests of a run find, if `[method] also` is "auto".

The run follows the advice of the verdict as long as two conditions are met: the tests reject the
model, and the best tested cause is a group of coefficients that the method can estimate. The new
fit must confirm an addition: it must explain what the score predicted (`RunAdvisor.on_cause`), and
the coefficients x with covariance C must differ significantly from zero. The statistic for this is
W = xᵀC⁻¹x, at the significance level of all tests together. The score tests divide this level among
all candidates, so a correct model is extended in less than 1 % of runs.

At most `MOST_ADDITIONS` groups are added, and at most half of the degrees of freedom are used.
Temperature coefficients are never added; [method] temperature_order chooses them.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace

from inercal.calibration.best_cause import SuspectedCause, familywise_p_value
from inercal.calibration.detectability import coefficient_definition
from inercal.calibration.explanation import Addition
from inercal.calibration.grade import assess
from inercal.estimation.scores import SIGNIFICANCE_LEVEL, chi2_tail_probability
from inercal.pipeline.advisor import RunAdvisor, wald_statistic
from inercal.pipeline.outcome import FittedRun

MOST_ADDITIONS = 5


def with_added_coefficients(
    fitted: FittedRun, advise: Callable[[FittedRun], RunAdvisor]
) -> tuple[FittedRun, RunAdvisor, tuple[Addition, ...]]:
    """Return the fit with all added coefficients, the advisor of this fit, and the additions.

    Parameters
    ----------
    fitted : FittedRun
        The fit without additions.
    advise : callable
        Function that returns the advisor of a fit.
    """
    advisor, additions = advise(fitted), tuple[Addition, ...]()
    least_dof = fitted.estimate.score_tests.dof / 2
    while len(additions) < MOST_ADDITIONS:
        larger = _larger_fit(fitted, advisor)
        if larger is None or larger[0].estimate.score_tests.dof < least_dof:
            break
        fitted, advisor, additions = larger[0], advise(larger[0]), (*additions, larger[1])
    return fitted, advisor, additions


def _larger_fit(fitted: FittedRun, advisor: RunAdvisor) -> tuple[FittedRun, Addition] | None:
    """Return the fit after adding the coefficients that explain the residuals best.

    The result is None if no cause is found, if the method cannot estimate its coefficients, or if
    they are not significant in the new fit.
    """
    sensor, estimate = fitted.run.sensor, fitted.estimate
    possible = fitted.run.method.possible(sensor)
    cause = assess(estimate, len(sensor.coefficients), possible).best
    if cause is None or not set(cause.components) <= set(possible):
        return None
    terms = [coefficient_definition(sensor, one) for one in cause.components]
    if any(term.basis.uses("dT", "dTdt") for term in terms):
        return None
    for group in _groups(cause, fitted, possible):
        advice = advisor.on_cause(group)
        if {(one.section, one.key) for one in advice.changes} != {("method", "also")}:
            continue
        larger = advisor.followed(advice)
        if _is_significant(group, fitted, larger):
            before, after = estimate.score_tests, larger.estimate.score_tests
            drop = advisor.explained(group, before.chi2 - after.chi2, advice.changes)
            return larger, Addition(
                group.name,
                group.components,
                after.chi2 + drop,
                before.dof,
                after.chi2,
                after.dof,
                cause.indistinguishable,
            )
    return None


def _groups(
    cause: SuspectedCause, fitted: FittedRun, possible: Sequence[str]
) -> Iterator[SuspectedCause]:
    """Yield the cause with the same coefficients of other axes, and then only the cause.

    If the tests find the coefficient of one axis, the coefficients of other axes may also differ
    from zero. If they were omitted, the result could be biased by more than its U.
    """
    tests = fitted.estimate.score_tests
    for score in tests.scores:
        whole = score.kind == "coefficient" and score.dof == len(score.components)
        names = set(score.components)
        if whole and set(cause.components) < names <= set(possible):
            yield replace(
                cause,
                name=score.name,
                components=score.components,
                chi2=score.chi2,
                dof=score.dof,
                remaining_chi2=max(tests.chi2 - score.chi2, 0.0),
            )
    yield cause


def _is_significant(cause: SuspectedCause, fitted: FittedRun, larger: FittedRun) -> bool:
    """Return whether added coefficients differ significantly from zero in the new fit."""
    tests = fitted.estimate.score_tests
    score = next(one for one in tests.scores if one.name == cause.name)
    wald = wald_statistic(larger.estimate, cause.components)
    p = chi2_tail_probability(wald, len(cause.components), tests.noise_dof)
    return familywise_p_value(tests, score, p) < SIGNIFICANCE_LEVEL
