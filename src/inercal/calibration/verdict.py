"""The verdict in plain words, computed from the numbers by the rule in `grade`.

The verdict has a few short lines. Its explanation contains all findings.
"""

import re
from collections import Counter
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from inercal.basics.arrays import Array
from inercal.basics.keys import CoefficientName, ErrorName
from inercal.basics.parameters import Parameter
from inercal.basics.run_file_advice import Advice
from inercal.calibration import explanation
from inercal.calibration.agreement_text import agreement, agreement_lines, cause_lines, no_cause
from inercal.calibration.best_cause import CHANGE_PREFIX, Advisor, PlainAdvisor, is_estimable
from inercal.calibration.detectability import (
    UndetectableCause,
    coefficient_definition,
    undetectable_causes,
    undetectable_exact_parameters,
)
from inercal.calibration.explanation import (
    MOST_CHARACTERS,
    ExplanationSection,
    first_fit,
    fit,
    fit_list,
    sentence,
)
from inercal.calibration.grade import (
    NO_SINGLE_CAUSE,
    SHARED_TILTS,
    Assessment,
    Verdict,
    assess,
    finding_reasons,
    grade_estimate,
    is_far_from_nominal,
    two_digits,
)
from inercal.calibration.next_steps import (
    CAUSES,
    NextStep,
    next_line,
    steps_on_cause,
    steps_on_findings,
    steps_on_undetectable,
)
from inercal.calibration.plausible_sizes import (
    bias_remarks,
    counts_remark,
    implausible_sizes,
    scale_remarks,
    wrong_unit,
)
from inercal.calibration.suspect_text import (
    alternatives,
    bench_words,
    cause_line,
    chi2_text,
    degrees_of_freedom,
)
from inercal.estimation import Estimate
from inercal.estimation.scores import (
    LINEARISATION,
    SIGNIFICANCE_LEVEL,
    chi2_tail_probability,
    sufficiency_p_value,
)
from inercal.estimation.uncertainty import COVERAGE
from inercal.physics.quantities import QUANTITIES
from inercal.physics.sensors import Sensor
from inercal.physics.sensors.coefficient_selection import GROUP_WORDS, axis_words, coefficient_words
from inercal.recordings import Finding, merge_messages
from inercal.recordings.samples import STANDARD_GRAVITY

_DRIFT_PREFIX = "drift of "  # followed by the axis
_NO_REACTION = 3.0  # standard uncertainties of a scale factor that cannot be told from 0
NO_PARAMETERS: Mapping[str, Parameter] = MappingProxyType({})
UNSEEN = "unseen"
"""`Finding.what` for an effect that a method cannot detect."""
ALL_SCALES = "the stated field, or the unit or scale of all three magnetometers, is wrong"
"""`Finding.cause` if all three magnetometers differ from the stated field by the same factor."""
_NO_CAUSE = (
    "No single cause explains this: the noise is larger than stated, or several things are wrong."
)
_TOLD_NOTES = (
    "gap", "sections", "repeated", "order", "implausible", "angles", "gravity", STANDARD_GRAVITY,
)  # fmt: skip
_NONLINEAR = 0.9  # remaining χ² of a fit, divided by that of the linear step, if it was far off
_MAIN_SHARE = 0.5  # share of a variance that one bench quantity must contribute, or a row to χ²


class _Uncertainty(NamedTuple):
    """The largest expanded uncertainty of a group of coefficients in one unit.

    `source` is the bench quantity that contributes more than half of the variance; empty if there
    is none.
    """

    kind: str
    group: str
    size: str
    unit: str
    term: str
    source: str = ""

    def __str__(self) -> str:
        return f"{self.size} {self.unit}{self.source and f' (mostly from {self.source})'}"


def verdict(
    estimate: Estimate,
    sensor: Sensor,
    findings: Sequence[Finding],
    expected: Mapping[str, Parameter] = NO_PARAMETERS,
    possible: Collection[str] = (),
    row_word: str = "position or turn",
    advisor: Advisor | None = None,
    added: str = "",
) -> Verdict:
    """Return the verdict, with its lines and its explanation.

    Parameters
    ----------
    estimate : Estimate
        An estimate without a trial axis.
    sensor : Sensor
    findings : sequence of Finding
    expected : mapping of str to Parameter, optional
        The bench's parameters by full name, as they were stated.
    possible : collection of str, optional
        Full names of the coefficients that the method can estimate.
    row_word : str
        Word for a row of the data, such as "position or turn".
    advisor : Advisor, optional
        Advisor that tries its advice, so the advice can be followed.
    added : str, optional
        A sentence on the coefficients that the run added automatically. It becomes the second line.
    """
    advisor = advisor or PlainAdvisor(possible, row_word)
    findings = (*findings, *implausible_sizes(estimate, sensor))
    assessment = assess(estimate, len(sensor.coefficients), possible)
    assessment = _refitted(assessment, estimate.score_tests.noise_dof, advisor, possible)
    row = _dominant_row(estimate, assessment)
    shared = any(one.cause == ALL_SCALES for one in findings)
    far = dict(_scale_errors(estimate, sensor, row, shared=shared))
    graded = grade_estimate(estimate, sensor, assessment, findings, tuple(far))
    unseen = _undetectable(estimate, sensor, assessment)
    shown = "" if assessment.suspect is None else assessment.suspect.name
    exact = {
        name: (accepted, size)
        for name, size in undetectable_exact_parameters(estimate, sensor, expected).items()
        if name != ErrorName(shown).name
        # Otherwise the error cannot occur in this run.
        and (accepted := advisor.accepts_uncertainty(name)) is not False
    }
    found = next((one.cause for one in findings if one.cause), "")
    known = found or next(filter(None, (CAUSES.get(one.what) for one in findings)), "")
    steps = [
        *(
            ()
            if known
            else steps_on_cause(assessment, advisor, tuple(far), row_word, row, possible)
        ),
        *steps_on_undetectable(unseen, sensor, advisor, possible),
        *(
            NextStep(
                f"State the uncertainty of {bench_words(name, (name,), expected)} in the run file; "
                f"it is now treated as exact{size and f' (an error of {size} counts)'}.",
                Advice(name, action="state its uncertainty"),
                needed=False,
            )
            for name, (accepted, size) in exact.items()
            if accepted
        ),
    ]
    steps += steps_on_findings(findings, advisor, steps)
    advice = tuple(one.advice for one in steps if one.advice is not None)
    steps.sort(key=lambda one: (not one.needed, not one.has_keys))
    undetectable = (
        *(_undetectable_text(one, sensor, row_word) for one in unseen),
        *(one.message for one in findings if one.what == UNSEEN),
        *(
            f"error of {bench_words(name, (name,), expected)}{size and f': {size}'}"
            for name, (_, size) in exact.items()
        ),
    )
    largest = _largest_uncertainties(estimate, sensor, expected)
    wrong = bool(far) or any(one.severity == "refused" for one in findings)
    told = [f.message for f in findings if f.severity == "warning" or f.factor is not None]
    noted = [f.message for f in findings if f.severity == "note" and f.what in _TOLD_NOTES]
    scales = tuple(f"{sentence(one)}: {why}." for one, why in far.items())
    sections = {
        explanation.AGREEMENT: (
            *agreement_lines(estimate, assessment, len(sensor.coefficients), wrong=wrong),
            *((added,) if added else ()),
        ),
        explanation.CAUSE: (
            *cause_lines(estimate, assessment, sensor, expected, row_word),
            *scales,
        ),
        explanation.NEXT_STEPS: tuple(one.text for one in steps),
        explanation.UNCERTAINTIES: _uncertainties_by_group(largest),
        explanation.UNDETECTABLE: undetectable,
        explanation.REMARKS: merge_messages(
            (
                *estimate.notes,
                *counts_remark(estimate, sensor),
                *(() if far else scale_remarks(estimate, sensor)),
                *bias_remarks(estimate, sensor),
            )
        ),
        explanation.CHECKS: merge_messages([*told, *noted]),
    }
    word = sentence(graded.word)
    why = graded.reasons[0] if graded.reasons else agreement(estimate, wrong=wrong)
    if why == NO_SINGLE_CAUSE:  # the next line says this
        tests = estimate.score_tests
        size = f"χ² = {chi2_text(tests.chi2)} with {degrees_of_freedom(tests.dof)}"
        why = f"the residuals are not random ({size})"
    if not graded.reasons and (factor := _noise_factor(findings)):
        why = f"the residuals are {factor} times smaller than noise and bench imply"
        shared = any(one.what == SHARED_TILTS for one in findings)
        word, why = word + ", but U is too large" * (not shared), why + ": state placement" * shared
    cause = found or next(iter(far.values()), known)
    named = cause_line(assessment, sensor, expected)
    others = "" if added or cause or not named or assessment.best is None else _alternatives_line(
        alternatives(assessment.best, estimate.score_tests, sensor, expected)
    )  # fmt: skip
    step = "" if graded.grade == "consistent" else next_line(
        steps, told, only=not assessment.rejects
    )  # fmt: skip
    warned = _warning_line(findings, (why, step))
    lines = (
        _first_line(word, why),
        fit(added),
        fit(f"Most likely cause: {cause}.")
        if cause
        else named or _NO_CAUSE * no_cause(estimate, assessment),
        others,
        step,
        warned,
        # The table of coefficients shows U, too, if there is no line left for it.
        "" if warned and (added or others) else _uncertainty_line(largest),
        _count_line(len(undetectable)),
    )
    return replace(
        graded,
        lines=tuple(filter(None, lines)),
        explanation=tuple(
            ExplanationSection(heading, tuple(dict.fromkeys(text)))
            for heading, text in sections.items()
            if text
        ),
        advice=advice,
        undetectable=tuple(unseen),
    )


def _refitted(
    assessment: Assessment, noise_dof: float, advisor: Advisor, possible: Collection[str]
) -> Assessment:
    """Return the assessment with the χ² of an actual fit if the best cause explains only a part.

    The score test of a large effect predicts χ² by a single linear step, which may be far too
    large. The sizes by this step are then omitted.
    """
    best = assessment.best
    if best is None or assessment.suspect is not None or not is_estimable(best, possible):
        return assessment
    left = advisor.on_cause(best).chi2
    if left is None or left > _NONLINEAR * best.remaining_chi2:
        return assessment
    drop = best.chi2 + best.remaining_chi2 - left
    unknown = (np.nan,) * len(best.components)
    p_value = chi2_tail_probability(left, best.remaining_dof, noise_dof)
    enough = sufficiency_p_value(left, best.remaining_dof, drop, noise_dof, LINEARISATION)
    return replace(
        assessment,
        best=replace(
            best, chi2=drop, remaining_chi2=left, remaining_p_value=p_value, sizes=unknown,
            sds=unknown, is_sufficient=enough >= SIGNIFICANCE_LEVEL,
        ),
    )  # fmt: skip


def _noise_factor(findings: Sequence[Finding]) -> str:
    """Say by what factor noise and bench were stated too large; empty if they were not."""
    factors = [one.factor for one in findings if one.factor is not None and one.factor > 1]
    return two_digits(max(factors)) if factors else ""


def _dominant_row(estimate: Estimate, assessment: Assessment) -> str:
    """Return the row that contributes most of χ²; empty if there is none."""
    row = assessment.row
    if row is None or row.adjusted >= SIGNIFICANCE_LEVEL:
        return ""
    return row.name if row.chi2 > _MAIN_SHARE * estimate.score_tests.chi2 else ""


def _scale_errors(
    estimate: Estimate, sensor: Sensor, row: str, *, shared: bool
) -> Iterator[tuple[str, str]]:
    """Yield a sentence, with a probable cause, for each scale factor far from nominal.

    If the magnetometers have a `shared` cause, one sentence is about all of them.
    """
    sds = np.sqrt(np.diag(estimate.covariance)).tolist()
    for name, value, sd in zip(sensor.coefficients, estimate.value.tolist(), sds, strict=False):
        axis, term = CoefficientName(name).parts
        scale = 1 + value
        if term not in ("k1", "scale") or not is_far_from_nominal(scale):
            continue
        if abs(scale) < _NO_REACTION * sd:
            cause = "it is broken or not connected, or all its rows contain the same reading"
            felt = "gravity" if term == "k1" else "rotation"
            yield f"{axis_words(sensor, axis)} does not react to {felt}", cause
            continue
        reading = f"the reading of “{row}”" if row else "one of its readings"
        cause = f"its nominal scale factor or {reading} is wrong"
        if scale < 0:
            cause = f"the axis is reversed{sensor.negative_scales}"
        else:
            cause = wrong_unit(next(a for a in sensor.axes if a.name == axis), scale) or cause
        words = axis_words(sensor, axis)
        if shared and sensor.measures[axis] == "m":
            words, cause = "each magnetometer", ALL_SCALES
        times = f"{'−' * (scale < 0)}{two_digits(abs(scale))}"
        yield f"the scale factor of {words} is {times} times nominal", cause
        if cause == ALL_SCALES:
            return  # the magnetometers come last


def _first_line(word: str, why: str) -> str:
    """Return the grade and its main reason; without what stands in brackets, if too long."""
    short = re.sub(r" \([^()]*\)", "", why)
    cut = fit(short, MOST_CHARACTERS - len(f"{word}: "))
    end = "." * (not why.endswith("…"))
    return first_fit(f"{word}: {why}{end}", f"{word}: {short}{end}", f"{word}: {cut}")


def _warning_line(findings: Sequence[Finding], told: Collection[str]) -> str:
    """Return a line with the refusals and warnings that the other lines do not tell; or "".

    Without any, the line is a note that gravity is stated as standard gravity.
    """
    hidden = [
        reason
        for severity in ("refused", "warning")
        for reason in finding_reasons(findings, severity)
        if not any(reason in line for line in told)
    ]
    if hidden:
        return fit_list("Warning: ", hidden, "; ")
    doubted = [one for one in findings if one.what == STANDARD_GRAVITY]
    return fit(f"Note: {next(finding_reasons(doubted, 'note'))}.") if doubted else ""


def _alternatives_line(others: Sequence[str]) -> str:
    """Return a line on causes that cannot be distinguished from the most likely; or ""."""
    if not others:
        return ""
    few = "1 other cause explains" if len(others) == 1 else f"{len(others)} other causes explain"
    return first_fit(
        f"The data cannot distinguish it from {' or '.join(others)}.",
        f"{few} the data equally well. {explanation.EXPLAIN}",
    )


def _undetectable(
    estimate: Estimate, sensor: Sensor, assessment: Assessment
) -> list[UndetectableCause]:
    """Return the causes that no test can detect, except the suspect, which was detected."""
    suspect = assessment.suspect
    own = () if suspect is None else (suspect.name, *suspect.components)
    shown = {CoefficientName(name).term for name in own}
    return [
        one
        for one in undetectable_causes(estimate, sensor)
        if CoefficientName(one.name).term not in shown
    ]


def _undetectable_text(one: UndetectableCause, sensor: Sensor, row_word: str) -> str:
    """Describe an effect and its size, with two digits, in the report unit."""
    if one.name == "row":
        return f"wrong readings at one {row_word}"
    words, name = one.name, ""  # the words of a change of the magnetic field
    if one.component.startswith((_DRIFT_PREFIX, CHANGE_PREFIX)):
        # The name is, for example, "drift of ax" or "change of ax within r10".
        axis = one.component.removeprefix(CHANGE_PREFIX).removeprefix(_DRIFT_PREFIX)
        axis = axis.removeprefix("of ").partition(" ")[0]
        name = f"{axis}.{QUANTITIES[sensor.measures[axis]].bias}" if axis in sensor.measures else ""
    elif CoefficientName(one.component).axis in sensor.measures:
        words, name = coefficient_words(sensor, one.name, (one.component,)), one.component
    if not name or not np.isfinite(one.size):
        return words
    line = coefficient_definition(sensor, name)
    return f"{words}: {two_digits(one.size / line.si)} {line.unit}"


def _largest_uncertainties(
    estimate: Estimate, sensor: Sensor, expected: Mapping[str, Parameter]
) -> list[_Uncertainty]:
    """Return the largest uncertainty of each group and unit; empty if nothing was tested."""
    if not (estimate.dof or estimate.groups):
        return []
    groups: dict[tuple[str, str, str], tuple[float, int, _Uncertainty]] = {}
    for k, (name, std) in enumerate(zip(sensor.coefficients, estimate.std.tolist(), strict=False)):
        kind = QUANTITIES[sensor.measures[CoefficientName(name).axis]].sensor
        line = sensor.coefficient(name)
        group = line.group.partition("_")[0]  # all temperature terms together
        key = (kind, group, line.unit)
        if key not in groups or std > groups[key][0]:
            size = two_digits(COVERAGE * std / line.si)
            word = line.meaning if group == "temperature" else GROUP_WORDS.get(group, group)
            groups[key] = std, k, _Uncertainty(kind, word, size, line.unit, line.name)
    sources = _main_sources(estimate, expected, [k for _, k, _ in groups.values()])
    return [
        one._replace(source=source)
        for (_, _, one), source in zip(groups.values(), sources, strict=True)
    ]


def _uncertainties_by_group(largest: Sequence[_Uncertainty]) -> tuple[str, ...]:
    """Return a line for each group and unit, with the coefficient if a group has several units."""
    units = Counter((one.kind, one.group) for one in largest)
    return tuple(
        f"{one.kind} {one.group}{f' ({one.term})' * (units[one.kind, one.group] > 1)}: {one}"
        for one in largest
    )


def _main_sources(
    estimate: Estimate, expected: Mapping[str, Parameter], rows: Sequence[int]
) -> list[str]:
    """Return, for each estimate, the bench quantity that contributes over half of the variance.

    The name is empty if there is no such quantity.
    """
    variances, shares = np.square(estimate.std[list(rows)]), dict[str, Array]()
    for name, parameter in expected.items():
        slope = estimate.sensitivity(name, parameter.sd) if parameter.sd > 0 else None
        if slope is not None:
            meaning = parameter.meaning.partition(",")[0] or ErrorName(name).name
            word = meaning if name == "g" else f"the {meaning}"
            share = np.square(slope[list(rows)] * parameter.sd) / variances
            shares[word] = shares.get(word, 0.0) + share
    return [
        next((word for word, share in shares.items() if share[k] > _MAIN_SHARE), "")
        for k in range(len(rows))
    ]


def _uncertainty_line(largest: Sequence[_Uncertainty]) -> str:
    """Return a line with the largest uncertainties, and as many of their sources as fit."""
    sourced = [k for k, one in enumerate(largest) if one.source]
    for count in range(len(sourced), -1, -1):
        groups: dict[str, list[str]] = {}
        for k, one in enumerate(largest):
            told = one if k in sourced[:count] else one._replace(source="")
            groups.setdefault(one.group, []).append(str(told))
        parts = [f"{group} {', '.join(each)}" for group, each in groups.items()]
        text = f"Largest U (k = 2): {'; '.join(parts)}."
        if len(text) <= MOST_CHARACTERS or not count:
            return fit_list("Largest U (k = 2): ", parts, "; ") if parts else ""
    return ""


def _count_line(count: int) -> str:
    """Return a line with the number of undetectable effects; empty if there are none."""
    if not count:
        return ""
    effects = f"{count} effects are" if count > 1 else "1 effect is"
    return f"{effects} not detectable from these data and not included in U. {explanation.EXPLAIN}"


__all__ = ["NO_PARAMETERS", "verdict"]
