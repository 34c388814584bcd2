"""Write sentences on how well the data agree with the model, and on causes of large residuals."""

from collections.abc import Iterator, Mapping

import numpy as np

from inercal.basics.keys import ErrorName
from inercal.basics.parameters import Parameter
from inercal.basics.units import format_count, si_factor
from inercal.calibration.grade import Assessment, HypothesisTest, two_digits
from inercal.calibration.suspect_text import (
    bench_words,
    best_cause_lines,
    chi2_text,
    degrees_of_freedom,
    p_value_text,
    suspect_lines,
)
from inercal.estimation import Estimate
from inercal.estimation.scores import SIGNIFICANCE_LEVEL
from inercal.physics.sensors import Sensor

_MIN_PULL = 2.0  # standard deviations; smaller residuals are not reported


def agreement(estimate: Estimate, *, wrong: bool = False) -> str:
    """Describe, with numbers, how well the data agree with a model that no test rejects.

    Parameters
    ----------
    estimate : Estimate
    wrong : bool
        Whether a check also found an error.
    """
    what = "the residuals agree" if wrong else "the data agree"
    if estimate.groups:
        if any(group.spread.excess for group in estimate.groups):
            return "the residuals are larger than usual, but not significantly; U includes them"
        tested = all(group.dof > 0 for group in estimate.groups)
        return (
            f"{what} with their noise"
            if tested
            else "all testable residuals agree with their noise"
        )
    if not estimate.dof:
        return f"{what} with the stated noise and bench according to the tests that were made"
    numbers = f"χ² = {chi2_text(float(estimate.chi2))} with {degrees_of_freedom(estimate.dof)}"
    if estimate.consistent:
        return f"{what} with the stated noise and bench ({numbers})"
    percent = two_digits(100 * float(estimate.p_value))
    return (
        f"chance explains the large residuals in {percent} % of runs; U is multiplied by "
        f"{float(estimate.birge):.2f}"
    )


def agreement_lines(
    estimate: Estimate, assessment: Assessment, count: int, *, wrong: bool
) -> Iterator[str]:
    """Yield sentences about whether the residuals agree with the noise, and about other tests.

    Parameters
    ----------
    estimate : Estimate
    assessment : Assessment
    count : int
        Number of estimated coefficients.
    wrong : bool
        Whether a check also found an error.
    """
    yield f"{count} coefficients were estimated."
    clause = agreement(estimate, wrong=wrong or assessment.rejects)
    p = float(estimate.p_value) if estimate.dof else 1.0
    if estimate.dof and not estimate.groups:
        chi2 = chi2_text(float(estimate.chi2))
        numbers = f"χ² = {chi2} with {degrees_of_freedom(estimate.dof)}, p = "
        numbers += f"{p:.2f}" if p >= SIGNIFICANCE_LEVEL else p_value_text(p).removeprefix("= ")
        clause = f"{clause.partition(' (')[0]} ({numbers})"
        if not estimate.consistent and assessment.rejects:
            clause = f"the residuals are larger than the stated noise and bench allow ({numbers})"
    elif not (assessment.tests or estimate.score_tests.scores):
        clause = "this estimator does not test how well the data agree with the model"
    elif estimate.groups and assessment.rejects:
        clause = "the residuals are larger than the noise explains"
        if not assessment.rejecting_tests:
            clause = "the residuals are not too large, but a test for a single cause rejects"
    if assessment.rejects and not assessment.tests:
        clause = "the residuals do not agree with the stated noise and bench"
    yield f"{clause[0].upper()}{clause[1:]}."
    if estimate.dof and not estimate.groups and not estimate.consistent and assessment.rejects:
        yield f"All uncertainties are multiplied by {float(estimate.birge):.2f} because of this."
    made = {test.name: test for test in assessment.tests}
    for group in estimate.groups:
        text = f"{group.name[0].upper()}{group.name[1:]}: χ² = {chi2_text(group.chi2)} with "
        text += degrees_of_freedom(group.dof)
        if test := made.get(f"residuals: {group.name}"):
            text += f", {_p_values(test, assessment)}"
        text += "."
        if group.spread.excess:
            unit = "µT" if group.unit == "T" else group.unit
            scatter = f"{two_digits(float(group.spread.excess) / si_factor(unit))} {unit}"
            text += f" All uncertainties include an additional scatter of {scatter}."
        if group.spread.share < 1:
            percent = two_digits(100 * float(group.spread.share))
            text += " Hand tremor averages out during a rest, so only "
            text += f"{percent} % of its variance is counted as noise."
        yield text
    for test in assessment.rejecting_tests:
        if not test.name.startswith("residuals"):
            yield (
                f"The test “{test.name}” rejects the model: χ² = {test.statistic:.1f} with "
                f"{degrees_of_freedom(test.dof)}, {_p_values(test, assessment)}."
            )


def _p_values(test: HypothesisTest, assessment: Assessment) -> str:
    """Return the p-value of a test, and the one that counts among all tests."""
    adjusted = p_value_text(test.adjusted).removeprefix("= ")
    among = format_count(len(assessment.tests), "test")
    return f"p {p_value_text(test.p_value)} ({adjusted} among {among})"


def cause_lines(
    estimate: Estimate,
    assessment: Assessment,
    sensor: Sensor,
    expected: Mapping[str, Parameter],
    row_word: str,
) -> Iterator[str]:
    """Yield sentences about the cause of large residuals, and about the row that fits worst."""
    if assessment.suspect is not None:
        yield from suspect_lines(assessment.suspect, estimate.score_tests, sensor, expected)
    elif assessment.best is not None:
        yield from best_cause_lines(assessment.best, estimate.score_tests, sensor, expected)
    elif no_cause(estimate, assessment):
        yield (
            "No single cause explains the residuals: the noise is larger than stated, or "
            "something changed from row to row."
        )
    if any("rotations" in one.name for one in assessment.rejecting_tests):
        yield (
            "Some turns between rests disagree with gravity. Samples lost during a turn change its "
            "angle, and a stated rate instead of a column of times hides this."
        )
    yield from _outlier_row_lines(assessment, row_word)
    if not (estimate.consistent or estimate.groups):
        yield from _largest_pull_lines(estimate, expected)


def no_cause(estimate: Estimate, assessment: Assessment) -> bool:
    """Return whether the residuals are too large although no single cause explains them."""
    return assessment.suspect is None and (
        assessment.scores_reject
        or (
            any(score.dof for score in estimate.score_tests.scores)
            and any(one.name.startswith("residuals") for one in assessment.rejecting_tests)
        )
    )


def _outlier_row_lines(assessment: Assessment, row_word: str) -> Iterator[str]:
    """Yield a line about the row that fits worst, if its difference is significant."""
    row, suspect = assessment.row, assessment.suspect
    if (
        row is None
        or row.adjusted >= SIGNIFICANCE_LEVEL
        or (suspect is not None and suspect.kind == "row")
    ):
        return
    alike = (
        f" (or {', '.join(row.indistinguishable)}, which the data cannot distinguish from it)"
        if row.indistinguishable
        else ""
    )
    yield (
        f"The {row_word} that agrees least with the others is “{row.name}”{alike}: χ² of its "
        f"readings is {chi2_text(row.chi2)} with {degrees_of_freedom(row.dof)} (p "
        f"{p_value_text(row.adjusted)}, corrected for the number of such rows)."
    )


def _largest_pull_lines(estimate: Estimate, expected: Mapping[str, Parameter]) -> Iterator[str]:
    """Yield lines about the largest residual and the bench parameter with the largest deviation."""
    if estimate.observations:
        worst = int(np.argmax(np.abs(estimate.whitened)))
        if (largest := abs(float(estimate.whitened[worst]))) > _MIN_PULL:
            yield (
                f"The largest residual is that of {estimate.observations[worst]}: "
                f"{two_digits(largest)} standard deviations."
            )
    pulls = {
        name: abs(float(value - expected[name].value)) / expected[name].sd
        for name, value in zip(estimate.names, estimate.value, strict=True)
        if name in expected and expected[name].sd > 0
    }
    name = max(pulls, key=lambda one: pulls[one], default="")
    if name and pulls[name] > _MIN_PULL:
        short, place = ErrorName(name).parts
        named = bench_words(short, (name,), expected) + (f" of {place}" if place else "")
        yield (
            f"The bench parameter farthest from its stated value is {named}: "
            f"{two_digits(pulls[name])} standard deviations."
        )
