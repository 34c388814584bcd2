"""The verdict in plain words, computed from the numbers; `grade` has its rule."""

from collections.abc import Collection, Mapping, Sequence
from types import MappingProxyType

import numpy as np

from inercal.basics.keys import CoefficientName, ErrorName
from inercal.basics.parameters import Parameter
from inercal.basics.run_file_advice import Advice
from inercal.basics.units import format_value_and_uncertainty
from inercal.calibration.advising import CHANGE_PREFIX, Advisor, PlainAdvisor, changes_text
from inercal.calibration.best_cause import SuspectedCause
from inercal.calibration.detectability import (
    UndetectableCause,
    coefficient_definition,
    undetectable_causes,
    undetectable_exact_parameters,
)
from inercal.calibration.grade import (
    Assessment,
    Verdict,
    assess,
    grade_estimate,
    is_far_from_nominal,
)
from inercal.calibration.suspect_text import (
    best_cause_lines,
    p_value_text,
    suspect_lines,
)
from inercal.estimation import Estimate
from inercal.estimation.scores import SIGNIFICANCE_LEVEL
from inercal.estimation.uncertainty.coverage import COVERAGE
from inercal.physics.quantities import QUANTITIES
from inercal.physics.sensors import G0, Sensor
from inercal.recordings import Finding, merge_messages

UNDETECTED_START = "these data cannot show the following, and U does not hold it"
UNDETECTED_END = "): "
"""Around the sizes' explanation in the line on causes that the data cannot show."""

_DRIFT_PREFIX = "drift of "  # and the axis
_MIN_PULL = 2.0  # standard deviations; smaller residuals are not reported
_UNIT_RATIO_TOLERANCE = 0.1  # relative distance within which a scale factor is a ratio of units
NO_PARAMETERS: Mapping[str, Parameter] = MappingProxyType({})
LARGEST_UNCERTAINTIES = "expanded uncertainties (k = 2) are at most: "  # begins a line


def verdict(
    estimate: Estimate,
    sensor: Sensor,
    findings: Sequence[Finding],
    expected: Mapping[str, Parameter] = NO_PARAMETERS,
    possible: Collection[str] = (),
    row_word: str = "position or turn",
    advisor: Advisor | None = None,
) -> Verdict:
    """Return the verdict; its first line is the summary.

    Parameters
    ----------
    estimate : Estimate
        Without a trial axis.
    sensor : Sensor
    findings : sequence of Finding
    expected : mapping of str to Parameter, optional
        The bench's parameters by full name, as they were stated.
    possible : collection of str, optional
        Full names of the coefficients that the method can estimate.
    row_word : str
        Word for a row of the data: "position or turn".
    advisor : Advisor, optional
        What gives advice that can be followed.
    """
    advisor = advisor or PlainAdvisor(possible, row_word)
    advice: list[Advice] = []
    p = len(sensor.coefficients)
    assessment = assess(estimate, p, possible)
    scales = {
        name: 1 + float(value)
        for name, value in zip(sensor.coefficients, estimate.value[:p], strict=True)
        if CoefficientName(name).term in ("k1", "scale") and is_far_from_nominal(1 + float(value))
    }
    wrong = bool(scales) or any(one.severity == "refused" for one in findings)
    lines = _summary(estimate, assessment, p, wrong)
    if assessment.suspect is not None:
        advice.append(advisor.on_cause(assessment.suspect))
        lines += suspect_lines(assessment.suspect, sensor, expected, advice[-1])
    elif assessment.best is not None:
        lines += best_cause_lines(assessment.best)
    elif assessment.scores_reject or (
        any(score.dof for score in estimate.score_tests.scores)
        and any(one.name.startswith("residuals") for one in assessment.rejecting_tests)
    ):
        lines.append(
            "no single cause explains the residuals: the noise is larger than stated, or something "
            "changes from row to row"
        )
    lines += _outlier_row_lines(assessment, row_word)
    if not (estimate.consistent or estimate.groups):
        lines += _largest_pull_lines(estimate, expected)
    if estimate.dof or estimate.groups:
        lines += _largest_uncertainty_lines(estimate, sensor)
    lines += [
        f"{name} is {scale:.3g} times nominal: {_scale_error_cause(name, scale)}"
        for name, scale in scales.items()
    ]
    unseen, unseen_advice = _undetectable_lines(
        estimate, sensor, expected, possible, row_word, assessment.suspect, advisor
    )
    lines += unseen
    advice += unseen_advice
    lines += merge_messages(estimate.notes)
    given = {word for one in advice for word in one.coefficients}
    for finding in findings:
        words = Advice(finding.what, finding.changes).coefficients
        if set(words) - given and (
            tried := advisor.on_changes(Advice(finding.what, finding.changes))
        ):
            advice.append(tried)
            lines.append(f"to estimate it: {changes_text(tried.changes)}")
    told = [f.message for f in findings if f.severity == "warning" or f.factor is not None]
    lines += merge_messages(told)
    lines = list(dict.fromkeys(lines))
    return grade_estimate(estimate, assessment, findings, tuple(scales), tuple(lines), advice)


def _scale_error_cause(name: str, scale: float) -> str:
    """Return the probable cause of a scale factor this far from nominal."""
    if scale < 0:
        return "the axis is reversed"
    if name.endswith(".k1"):
        for ratio, words in (
            (G0, "m/s² stated as g"),
            (1 / G0, "g stated as m/s²"),
        ):
            if abs(scale / ratio - 1) < _UNIT_RATIO_TOLERANCE:
                return f"its column looks like {words}"
    return "its nominal scale or one of its readings is wrong"


def _summary(estimate: Estimate, assessment: Assessment, count: int, wrong: bool) -> list[str]:
    """Return lines on the agreement of the residuals; `wrong`: a check found an error besides."""
    first = f"{count} coefficients estimated"
    if estimate.groups:
        lines = _group_summary(estimate, assessment, first, wrong)
    elif not estimate.dof:
        tested = assessment.tests or estimate.score_tests.scores
        agree = "do not agree" if assessment.rejects else "agree"
        what = "the residuals" if wrong else "the data"
        lines = [
            f"{first}; {what} {agree} with the stated noise and bench by the tests that were made"
            if tested
            else f"{first}; this estimator makes no test of how well the data agree"
        ]
    else:
        p = float(estimate.p_value)
        numbers = f"χ² = {estimate.chi2:.1f} with {estimate.dof} degrees of freedom, " + (
            f"p = {p:.2f}" if p >= SIGNIFICANCE_LEVEL else f"p {p_value_text(p)}"
        )
        if estimate.consistent:
            whole = "the residuals agree" if assessment.rejects or wrong else "the data agree"
            tail = ", but further tests reject the model" if assessment.rejects else ""
            lines = [f"{first}; {whole} with the stated noise and bench ({numbers}){tail}"]
        else:
            large = (
                ", but the residuals are larger than noise and bench allow"
                if assessment.rejects
                else f"; the residuals are large, which chance explains in {100 * p:.1g} % of runs"
            )
            by = f"all uncertainties are scaled by {float(estimate.birge):.2f}"
            lines = [f"{first}{large} ({numbers}): {by}"]
    lines += [
        f"{test.name}: χ² = {test.statistic:.1f} with {test.dof} degrees of freedom, p "
        f"{p_value_text(test.p_value)} ({p_value_text(test.adjusted).removeprefix('= ')} among "
        f"{len(assessment.tests)} tests): the model is rejected"
        for test in assessment.rejecting_tests
        if not test.name.startswith("residuals")
    ]
    return lines


def _group_summary(
    estimate: Estimate, assessment: Assessment, first: str, wrong: bool
) -> list[str]:
    """Return lines on the agreement of each kind of observations with its noise."""
    numbers = "; ".join(
        f"{group.name} χ² = {group.chi2:.1f} with {group.dof}, p {p_value_text(group.p_value)}"
        for group in estimate.groups
    )
    beyond = [group for group in estimate.groups if group.spread.excess]
    within = [group for group in estimate.groups if group.spread.share < 1]
    lines: list[str] = []
    if within:
        shares = ", ".join(f"{group.spread.share:.2g} for {group.name}" for group in within)
        lines.append(
            "some observations agree better than the scatter within rests predicts, as for a "
            f"sensor in a trembling hand; the share of the variance that counts is {shares}"
        )
    if not beyond:
        tested = all(group.dof > 0 for group in estimate.groups)
        what = "the residuals agree" if wrong else "the data agree"
        agree = f"{what} with their noise" if tested else "what can be tested agrees"
        return [f"{first}; {agree} ({numbers})", *lines]
    added = ", ".join(f"{group.spread.excess:.2g} {group.unit} of {group.name}" for group in beyond)
    # Excess is added beyond 95 %, a test rejects beyond 99 %: between them the verdict agrees.
    large = (
        ", but the residuals are larger than their noise"
        if assessment.rejects
        else "; the residuals are large, which chance explains"
    )
    return [
        f"{first}{large} ({numbers}): a scatter of {added} is added to it, and so to all "
        "uncertainties",
        *lines,
    ]


def _undetectable_lines(
    estimate: Estimate,
    sensor: Sensor,
    expected: Mapping[str, Parameter],
    possible: Collection[str],
    row_word: str,
    suspect: SuspectedCause | None,
    advisor: Advisor,
) -> tuple[list[str], list[Advice]]:
    """Return a line on omitted causes that no test of these data can detect: U does not hold them.

    Also returns advice on those that the method can estimate.

    The suspect is excluded: a test has detected it.
    """
    own = (suspect.name, *suspect.components) if suspect is not None else ()
    short = {CoefficientName(name).term for name in own}
    found = [
        one
        for one in undetectable_causes(estimate, sensor)
        if CoefficientName(one.name).term not in short
    ]
    parts = [
        f"wrong readings of one {row_word}" if one.name == "row" else one.name for one in found
    ]
    for k, one in enumerate(found):
        if np.isfinite(one.size):
            parts[k] += f" ({_undetected_size_text(sensor, one)})"
    texts: list[str] = []
    advice: list[Advice] = []
    if parts:
        free = [one.name for one in found if one.component in possible]
        tail = ""
        if free and (given := advisor.on_coefficients(free)):
            advice.append(given)
            tail = f"; the method can estimate {given.reason}: {changes_text(given.changes)}"
        texts.append(
            f"{UNDETECTED_START} (in brackets the size that shifts a coefficient by "
            f"5 u{UNDETECTED_END}{', '.join(parts)}{tail}"
        )
    if exact := undetectable_exact_parameters(estimate, sensor, expected):
        texts.append(
            f"these data cannot show an error of {', '.join(exact)}, which the run file takes as "
            "exact: state its uncertainty"
        )
        advice += [Advice(name, action="state its uncertainty") for name in exact]
    return (["; ".join(texts)] if texts else []), advice


def _undetected_size_text(sensor: Sensor, one: UndetectableCause) -> str:
    """Return a size with two digits, in the unit of reports."""
    if one.component.startswith((_DRIFT_PREFIX, CHANGE_PREFIX)):
        # "drift of ax", or "change of ax within r10".
        axis = one.component.removeprefix(CHANGE_PREFIX).removeprefix(_DRIFT_PREFIX)
        axis = axis.removeprefix("of ").partition(" ")[0]
        line = coefficient_definition(sensor, f"{axis}.{QUANTITIES[_measures(sensor, axis)].bias}")
    else:
        line = coefficient_definition(sensor, one.component)
    return f"{format_value_and_uncertainty(0.0, one.size / line.si)[1]} {line.unit}"


def _measures(sensor: Sensor, name: str) -> str:
    return next(axis.measures for axis in sensor.axes if axis.name == name)


def _outlier_row_lines(assessment: Assessment, row_word: str) -> list[str]:
    """Return a line on the row that agrees least with the others, where this is significant."""
    row, suspect = assessment.row, assessment.suspect
    if (
        row is None
        or row.adjusted >= SIGNIFICANCE_LEVEL
        or (suspect is not None and suspect.kind == "row")
    ):
        return []
    alike = (
        f" (or {', '.join(row.indistinguishable)}: these data cannot distinguish them)"
        if row.indistinguishable
        else ""
    )
    return [
        f"the {row_word} that agrees least with the others is {row.name}{alike}: χ² of its "
        f"readings is {row.chi2:.1f} with {row.dof}, p {p_value_text(row.adjusted)} over all rows"
    ]


def _largest_pull_lines(estimate: Estimate, expected: Mapping[str, Parameter]) -> list[str]:
    """Return lines on the largest residual and the bench parameter farthest from its statement."""
    lines: list[str] = []
    if estimate.observations:
        worst = int(np.argmax(np.abs(estimate.whitened)))
        if (largest := abs(float(estimate.whitened[worst]))) > _MIN_PULL:
            lines.append(
                f"the largest residual is {estimate.observations[worst]}, "
                f"{format_value_and_uncertainty(0.0, largest)[1]} standard deviations"
            )
    # What the coefficients take up, or what would be implausibly large, is no explanation.
    useless = {
        name
        for score in estimate.score_tests.scores
        if score.kind == "bench"
        and (not score.dof or score.is_implausible or score.contradicts_statement)
        for name in score.components
    }
    pulls = {
        name: abs(float(value - expected[name].value)) / expected[name].sd
        for name, value in zip(estimate.names, estimate.value, strict=True)
        if name in expected and expected[name].sd > 0 and name not in useless
    }
    name = max(pulls, key=lambda one: pulls[one], default="")
    if name and pulls[name] > _MIN_PULL:
        short, place = ErrorName(name).parts
        named = f"{short} of {place}" if place else short
        size = format_value_and_uncertainty(0.0, pulls[name])[1]
        lines.append(
            f"of the bench, {named} is farthest from its stated value, {size} standard deviations"
        )
    return lines


def _largest_uncertainty_lines(estimate: Estimate, sensor: Sensor) -> list[str]:
    """Return a line with the largest uncertainty of each group and unit."""
    p = len(sensor.coefficients)
    measures = {axis.name: axis.measures for axis in sensor.axes}
    groups: dict[tuple[str, str], list[int]] = {}
    for k, name in enumerate(sensor.coefficients):
        kind = "accelerometer" if measures[CoefficientName(name).axis] == "f" else "gyro"
        line = sensor.coefficient(name)
        group = line.group.partition("_")[0]  # all of temperature together
        groups.setdefault((f"{kind} {group}", line.unit), []).append(k)
    std = estimate.std[:p]
    parts: list[str] = []
    for (group, _), members in groups.items():
        worst = max(members, key=lambda k: float(std[k]))
        line = sensor.coefficient(sensor.coefficients[worst])
        size = format_value_and_uncertainty(0.0, COVERAGE * float(std[worst]) / line.si)[1]
        parts.append(f"{group} {size} {line.unit}")
    return [LARGEST_UNCERTAINTIES + ", ".join(parts)]


__all__ = ["NO_PARAMETERS", "verdict"]
