"""The rule for the verdict, which states how reliable a result is.

The rule is the same for all methods. An estimate is tested in three ways: the χ² test of its
residuals, additional tests of the method, and the score tests for effects that the model does not
include. If there are groups of residuals, each group has a χ² test. If their noise was estimated
from the recording, an F test replaces the χ² test. The overall significance level is 1 %: .8 % for
the score tests and .2 % for the others, or 1 % for the others if there are no score tests. The
grade is::

    consistent                 no test rejects the model, and no check warns
    usable with reservations   a test rejects the model, or a check warns, or nothing was tested
    not to be relied on        the fit did not converge, a scale factor is far from nominal, a check
                               refused, or a test rejects the model and either the scatter is more
                               than twice the stated scatter (three times that measured within
                               rests), also of the mean residuals of steps, or the best of the
                               causes tested shifts a coefficient by more than its U

The limit is wider for noise that was measured within rests. Such noise does not contain changes
from one rest to the next, which every sensor shows to some extent, and U includes this scatter.

`inercal.calibration.best_cause` finds the best of the tested causes. This cause is called the
suspect if the remaining residuals are not significant. If they are significant, no single cause
explains the residuals.

A check of the stated noise warns if the noise was stated too large. This warning makes a result
usable with reservations, because its uncertainties are too large.
"""

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np

from inercal.basics.keys import PRIOR_OF
from inercal.basics.run_file_advice import Advice
from inercal.basics.units import format_value_and_uncertainty
from inercal.calibration.best_cause import (
    CHANGE_PREFIX,
    OutlierRow,
    SuspectedCause,
    familywise_p_value,
    find_best_cause,
    find_outlier_row,
)
from inercal.calibration.detectability import UndetectableCause
from inercal.calibration.explanation import Addition, ExplanationSection, fit
from inercal.estimation import Estimate
from inercal.estimation.scores import (
    SCORE_TEST_SHARE,
    SIGNIFICANCE_LEVEL,
    CandidateKind,
    chi2_tail_probability,
)
from inercal.physics.sensors import Sensor
from inercal.physics.sensors.coefficient_selection import coefficient_words
from inercal.recordings import Finding, RoundedChannel

Grade = Literal["consistent", "reservations", "unreliable"]
GRADE_WORDS: dict[Grade, str] = {
    "consistent": "consistent",
    "reservations": "usable with reservations",
    "unreliable": "not to be relied on",
}
GRADE_TONES: dict[Grade, str] = {"consistent": "good", "reservations": "care", "unreliable": "bad"}
SHARED_TILTS = "shared tilts"
"""Kind of a finding on small residuals that equal tilts at each visit to a face would explain."""
NO_SINGLE_CAUSE = "no single cause explains the residuals"
_MAX_SCATTER = 2.0  # times the stated scatter
_SEVERAL = 10  # degrees of freedom; fewer means do not show a scatter
_MAX_SCATTER_OF_RESTS = 3.0  # times the scatter measured within rests
_MAX_SHIFT = 1.0  # U
_LEAST_CHI2 = 6.6  # no smaller χ² is significant at 1 %, whatever its degrees of freedom
_SCALE_LIMITS = (0.65, 1.5)  # times nominal; even low-grade sensors are within 25 % of nominal
_MOST_REASON = 75  # largest number of characters of a reason from a check
_SHIFTED_BY: dict[CandidateKind, str] = {
    "coefficient": "an omitted effect",
    "bench": "a deviation of the bench",
    "time": "a change during the run",
    "row": "a wrong reading",
}


@dataclass(frozen=True)
class HypothesisTest:
    """A test with χ², degrees of freedom, p-value, and p-value adjusted for all tests."""

    name: str
    statistic: float
    dof: int
    p_value: float
    adjusted: float

    @property
    def rejects(self) -> bool:
        """Whether this test rejects the model at the overall level."""
        return self.adjusted < SIGNIFICANCE_LEVEL


@dataclass(frozen=True)
class Assessment:
    """Results of the tests of an estimate.

    `best` is the tested cause that explains the residuals best. It is the suspect if it is
    sufficient.
    """

    tests: tuple[HypothesisTest, ...]
    best: SuspectedCause | None
    row: OutlierRow | None
    scores_reject: bool

    @property
    def suspect(self) -> SuspectedCause | None:
        """The single cause that explains the residuals, if there is such a cause."""
        best = self.best
        return best if best and best.is_sufficient else None

    @property
    def rejecting_tests(self) -> tuple[HypothesisTest, ...]:
        """The tests that reject the model."""
        return tuple(test for test in self.tests if test.rejects)

    @property
    def rejects(self) -> bool:
        """Whether any test rejects the model."""
        return bool(self.rejecting_tests) or self.scores_reject


class NoiseFactor(NamedTuple):
    """A stated noise that the data contradict.

    Parameters
    ----------
    what : str
        Kind of finding: "noise" for the sensor noise, "residuals" for noise and bench together,
        or "shared tilts" if equal tilts at each visit may explain it.
    channel : str or None
        The axis for which this is most significant; None for all axes.
    factor : float
        Stated standard deviation divided by observed standard deviation.
    """

    what: str
    channel: str | None
    factor: float


@dataclass(frozen=True)
class Verdict:
    """The verdict on a result, with the reasons for it; iterating over a verdict yields its lines.

    Parameters
    ----------
    grade : "consistent", "reservations" or "unreliable"
    reasons : tuple of str
        Short reasons against the grade "consistent"; the main reason comes first.
    lines : tuple of str
        At most six lines of at most 100 characters; a text to paste may be longer. They contain the
        grade and main reason, the cause, what to do next, the largest uncertainties, and the number
        of undetectable effects.
    explanation : tuple of ExplanationSection
        All findings, sorted under headings.
    tests : tuple of HypothesisTest
    suspect : SuspectedCause or None
        The single cause that explains the residuals; None if there is no such cause.
    best : SuspectedCause or None
        The best of the tested causes, with the residuals that it does not explain.
    advice : tuple of Advice
        What to change in the run file or to do at the bench. Changes of keys were tried before they
        were advised.
    scatter : float
        Ratio of the observed scatter of the residuals to the stated scatter, if the uncertainties
        were multiplied by this ratio; otherwise 1.
    noise : tuple of NoiseFactor
        Noise that was stated as too large or too small.
    rounding : tuple of RoundedChannel
        Channels whose resolution limits the information from the rests.
    additions : tuple of Addition
        Coefficients that `also = "auto"` added, in order.
    warned : tuple of str
        Kinds of the findings that are warnings or refusals (`Finding.what`).
    undetectable : tuple of UndetectableCause or None
        Causes that no test can detect in the data and that U does not include; None if the file
        does not state them.
    """

    grade: Grade
    reasons: tuple[str, ...] = ()
    lines: tuple[str, ...] = ()
    explanation: tuple[ExplanationSection, ...] = ()
    tests: tuple[HypothesisTest, ...] = ()
    suspect: SuspectedCause | None = None
    best: SuspectedCause | None = None
    advice: tuple[Advice, ...] = ()
    scatter: float = 1.0
    noise: tuple[NoiseFactor, ...] = ()
    rounding: tuple[RoundedChannel, ...] = ()
    additions: tuple[Addition, ...] = ()
    warned: tuple[str, ...] = ()
    undetectable: tuple[UndetectableCause, ...] | None = None

    @property
    def statements(self) -> tuple[str, ...]:
        """All lines of the explanation without the headings."""
        return tuple(line for section in self.explanation for line in section.lines)

    @property
    def word(self) -> str:
        """The grade in words, as shown in the terminal, report, register, page and JSON."""
        return GRADE_WORDS[self.grade]

    @property
    def tone(self) -> str:
        """The name of the grade's colour: "good", "care" or "bad"."""
        return GRADE_TONES[self.grade]

    def __str__(self) -> str:
        """Return the lines of the verdict."""
        return "\n".join(self.lines)

    def __iter__(self) -> Iterator[str]:
        return iter(self.lines)

    def __len__(self) -> int:
        return len(self.lines)

    def __getitem__(self, k: int) -> str:
        return self.lines[k]


def assess(estimate: Estimate, count: int, possible: Collection[str] = ()) -> Assessment:
    """Test an estimate; the p-values are adjusted for the number of tests.

    Parameters
    ----------
    estimate : Estimate
        An estimate without a trial axis.
    count : int
        Number of coefficients, which are the first parameters of the estimate.
    possible : collection of str, optional
        Full names of the coefficients that the method can estimate.
    """
    nu, channels = estimate.noise_dof, 1
    named = [(f"residuals: {group.name}", group.chi2, group.dof) for group in estimate.groups]
    if not named and estimate.dof:
        named = [("residuals", float(estimate.chi2), estimate.dof)]
        channels = estimate.noise_channels
    real = [
        (name, chi2, dof, chi2_tail_probability(chi2, dof, nu, channels))
        for name, chi2, dof in named
        if dof > 0
    ]
    # The additional tests of a method are χ² tests, no matter how the noise was estimated.
    real += [(one.name, one.statistic, one.dof, one.p_value) for one in estimate.tests if one.dof]
    score_tests = estimate.score_tests
    share = 1 - SCORE_TEST_SHARE if any(one.dof for one in score_tests.scores) else 1.0
    tests = tuple(
        HypothesisTest(name, chi2, dof, p, min(1.0, len(real) * p / share))
        for name, chi2, dof, p in real
    )
    significant = [
        s
        for s in score_tests.scores
        if s.chi2 > _LEAST_CHI2 and familywise_p_value(score_tests, s) < SIGNIFICANCE_LEVEL
    ]
    return Assessment(
        tests,
        find_best_cause(estimate, count, significant, possible),
        find_outlier_row(estimate),
        bool(significant),
    )


def grade_estimate(
    estimate: Estimate,
    sensor: Sensor,
    assessment: Assessment,
    findings: Sequence[Finding],
    far: Sequence[str],
) -> Verdict:
    """Return the grade and its reasons by the rule of this module, without the other lines.

    Parameters
    ----------
    estimate : Estimate
        An estimate without a trial axis.
    sensor : Sensor
    assessment : Assessment
    findings : sequence of Finding
        Findings of all checks.
    far : sequence of str
        A sentence for each scale factor that is far from nominal (`is_far_from_nominal`).
    """
    best, suspect = assessment.best, assessment.suspect
    largest_birge_ratio = float(estimate.largest_birge_ratio)
    bad: list[str] = []
    if not np.all(estimate.converged):
        bad.append("the fit did not converge")
    bad += [*far, *finding_reasons(findings, "refused")]
    measured = bool(np.isfinite(estimate.noise_dof))
    if assessment.rejects and largest_birge_ratio > (
        _MAX_SCATTER_OF_RESTS if measured else _MAX_SCATTER
    ):
        times = two_digits(largest_birge_ratio)
        bad.append(f"the residuals are {times} times as large as noise and bench allow")
    bad += _large_means(assessment)
    if best is not None and best.shift > _MAX_SHIFT:
        words = coefficient_words(sensor, best.shifted_coefficient).partition(" (")[0]
        cause = "a wrong prior" if best.name.startswith(PRIOR_OF) else _SHIFTED_BY[best.kind]
        full, brief = (
            f"{cause} shifts {shifted} by {two_digits(best.shift)} U"
            for shifted in (f"the {words}", best.shifted_coefficient)
        )
        bad.append(full if len(full) <= _MOST_REASON else brief)
    strongest = sorted(assessment.rejecting_tests, key=lambda test: test.p_value)
    mild = [_test_reason(test.name) for test in strongest]
    if assessment.scores_reject and suspect is None:
        mild.append(NO_SINGLE_CAUSE)
    elif suspect is not None:
        named = row_words(suspect.place) if suspect.kind == "row" else suspect.name
        if suspect.kind == "coefficient":
            named = coefficient_words(sensor, suspect.name, suspect.components)
        if suspect.name.startswith(PRIOR_OF):
            mild.append(f"the data contradict the {suspect.name}")
        else:
            mild.append(f"the residuals point to {named}")
    mild += finding_reasons(findings, "warning")
    if not assessment.tests and not estimate.score_tests.scores:
        mild.append("this estimator does not test how well the data agree with the model")
    grade: Grade = "unreliable" if bad else "reservations" if mild else "consistent"
    noise = tuple(
        NoiseFactor(one.what, one.channel, one.factor) for one in findings if one.factor is not None
    )
    warned = dict.fromkeys(one.what for one in findings if one.severity != "note")
    return Verdict(
        grade,
        tuple(dict.fromkeys((*bad, *mild))),
        tests=assessment.tests,
        suspect=suspect,
        best=assessment.best,
        scatter=largest_birge_ratio,
        noise=noise,
        warned=tuple(warned),
    )


def _large_means(assessment: Assessment) -> Iterator[str]:
    """Yield a reason for each kind of means that scatter more than twice as much as stated.

    A systematic error can be small compared with the noise of thousands of single residuals, but
    their means show it.
    """
    for test in assessment.rejecting_tests:
        times = (test.statistic / test.dof) ** 0.5
        if test.dof >= _SEVERAL and test.name.startswith("mean ") and times > _MAX_SCATTER:
            yield f"the {test.name} are {two_digits(times)} times too large"


def row_words(name: str) -> str:
    """Describe readings of one row, or a field at one rest, as a cause of large residuals."""
    return f"a different {name}" if name.startswith("field at ") else f"wrong readings in {name}"


def _test_reason(name: str) -> str:
    """Return the reason that the verdict states if this test rejects the model."""
    if name.startswith(CHANGE_PREFIX):
        return f"the readings {name}"
    residuals, _, group = name.partition(": ")
    group, detailed, _ = group.partition(", ")
    if residuals != "residuals":
        full, brief = f"the test “{name}” rejects the model", f"a test rejects the model: {name}"
    else:
        brief = f"the residuals are too large: {group}".removesuffix(": ")
        words = group if detailed else f"residuals of the {group}"
        full = f"the {words} are too large" if group else brief
    return full if len(full) <= _MOST_REASON else brief  # shortening must not remove the verb


def finding_reasons(findings: Sequence[Finding], severity: str) -> Iterator[str]:
    """Yield the first message of each kind of finding with this severity, shortened."""
    kinds: dict[str, list[str]] = {}
    for one in findings:
        if one.severity == severity:
            kinds.setdefault(one.what, []).append(one.message)
    for first, *others in kinds.values():
        yield fit(first, _MOST_REASON) + (f" (and {len(others)} more)" if others else "")


def two_digits(size: float) -> str:
    """Return a size as text, with two significant digits and without a power of ten."""
    return format_value_and_uncertainty(0.0, size)[1]


def is_far_from_nominal(scale: float) -> bool:
    """Return whether a scale factor, nominally 1, is implausible."""
    return not _SCALE_LIMITS[0] < scale < _SCALE_LIMITS[1]
