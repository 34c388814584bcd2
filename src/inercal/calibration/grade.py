"""The rule of the verdict: how far a result can be relied on, the same for all methods.

The tests of an estimate are χ² of its residuals (or of each group of residuals; F where their noise
was estimated from the recording), the further tests of the method, and the score tests of what the
model omits. Their overall level is 1 %: .8 % for the scores and .2 % for the tests, or 1 % for the
tests where nothing is scored. The grade is::

    consistent                 no test rejects the model, and no check warns
    usable with reservations   a test rejects the model, or a check warns, or nothing was tested
    not to be relied on        the fit did not converge, a scale factor is far from nominal, a check
                               refused, or a test rejects the model and either the scatter is more
                               than twice the stated scatter, or the best of the causes tested
                               shifts a coefficient by more than its U

The best of the causes tested is the candidate with the smallest p-value, if it explains the
residuals better than a scatter of all rows does: the remaining residuals agree with the stated
noise, or are small compared with the explained part (F test). It must leave a degree of freedom,
and a coefficient must be plausible: not beyond its largest plausible size by more than 6 standard
deviations. Where what is estimated takes up all but a thousandth of its effect, it must not depart
from what is stated of it by more than 6 standard deviations. It is the suspect where what it leaves
unexplained is not significant; otherwise no single cause explains the residuals. Candidates whose
explained residual lies within 30° of the suspect's cannot be distinguished from it. Of those that
explain as much (χ² within 4; except rows, in no more directions) the first is named in the order of
possible remedies: a coefficient that the method can estimate, the bench, a change over the run, a
row, other coefficients; and of two statements the one that departs less from what is stated of it,
in its standard deviations.

A check of the stated noise warns where uncertainties follow from a noise that was stated too large:
by it alone a result is usable with reservations, because its uncertainties are too large.
"""
# SciPy has no stubs.
# pyright: reportMissingTypeStubs=false

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
import scipy

from inercal.estimate import Estimate, ScoreTest
from inercal.estimate.scores import (
    PARALLEL_COSINE,
    SCORE_TEST_SHARE,
    SIGNIFICANCE_LEVEL,
    Kind,
    ScoreTestSet,
    chi2_tail_probability,
    remaining_p_value,
)
from inercal.recording import Finding, RoundedChannel
from inercal.run_file_advice import Advice, Change
from inercal.uncertainty.coverage import COVERAGE

Grade = Literal["consistent", "reservations", "unreliable"]
GRADE_WORDS: dict[Grade, str] = {
    "consistent": "consistent",
    "reservations": "usable with reservations",
    "unreliable": "not to be relied on",
}
GRADE_TONES: dict[Grade, str] = {"consistent": "good", "reservations": "care", "unreliable": "bad"}
_MAX_SCATTER = 2.0  # times the stated scatter
_MAX_SHIFT = 1.0  # U
_SCALE_LIMITS = (0.65, 1.5)  # times nominal; even low-grade sensors are within a quarter of it
_KIND_ORDER: tuple[Kind, ...] = ("bench", "time", "row", "coefficient")
_EQUIVALENT_CHI2 = 4.0  # of χ²: two standard deviations of one direction
_MIN_P_VALUE = 1e-280  # a smaller probability is computed from its asymptote


@dataclass(frozen=True)
class HypothesisTest:
    """A test: its χ², degrees of freedom, and p-value, single and among all of its kind."""

    name: str
    statistic: float
    dof: int
    p_value: float
    adjusted: float

    @property
    def rejects(self) -> bool:
        """Whether the model is rejected by this test at the overall level."""
        return self.adjusted < SIGNIFICANCE_LEVEL


@dataclass(frozen=True)
class SuspectedCause:
    """The candidate, omitted from the model or assumed known, that explains the residuals best.

    Parameters
    ----------
    name, kind, components, units
        As of the candidate (`inercal.estimate.Candidate`).
    sizes, sds : tuple of float
        Estimates of its components, and their standard deviations, SI.
    chi2, dof, adjusted
        Decrease of χ², degrees of freedom, and p-value among all candidates.
    remaining_chi2, remaining_dof : float and int
        Remaining χ², and its degrees of freedom.
    remaining_p_value : float
        Probability of a χ² as large as the remaining one if this cause were the only one.
    changes : tuple of Change
        Of the candidate: keys of the run file that let the method estimate it.
    least_sizes : tuple of float
        The smallest sizes of the components that explain as much, SI.
    shift : float
        The largest shift that it causes in a coefficient, in units of that coefficient's U.
    shifted_coefficient : str
        The coefficient with this shift.
    indistinguishable : tuple of str
        Candidates that explain the same residuals, which no test distinguishes from it.
    """

    name: str
    kind: Kind
    components: tuple[str, ...]
    units: tuple[str, ...]
    sizes: tuple[float, ...]
    sds: tuple[float, ...]
    chi2: float
    dof: int
    adjusted: float
    remaining_chi2: float
    remaining_dof: int
    shift: float
    shifted_coefficient: str
    indistinguishable: tuple[str, ...]
    remaining_p_value: float = 1.0
    changes: tuple[Change, ...] = ()
    least_sizes: tuple[float, ...] = ()


@dataclass(frozen=True)
class OutlierRow:
    """The row of the data that agrees least with the others, and its p-value among all rows.

    `indistinguishable` are the rows that no test distinguishes from it.
    """

    name: str
    chi2: float
    dof: int
    adjusted: float
    indistinguishable: tuple[str, ...]


@dataclass(frozen=True)
class Assessment:
    """Results of the tests of an estimate.

    `best` is the best of the causes tested; it is the suspect where it leaves nothing significant.
    """

    tests: tuple[HypothesisTest, ...]
    best: SuspectedCause | None
    row: OutlierRow | None
    scores_reject: bool

    @property
    def suspect(self) -> SuspectedCause | None:
        """The single cause that explains the residuals, if there is one."""
        best = self.best
        return best if best and best.remaining_p_value >= SIGNIFICANCE_LEVEL else None

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
        Its finding: "noise", or "residuals" of noise and bench together.
    channel : str or None
        The axis that shows it best; None of all.
    factor : float
        The stated standard deviation over that found.
    """

    what: str
    channel: str | None
    factor: float


@dataclass(frozen=True)
class Verdict:
    """How far a result can be relied on, and the reasons. Iterating gives its lines.

    Parameters
    ----------
    grade : "consistent", "reservations" or "unreliable"
    reasons : tuple of str
        The reasons against "consistent", in few words each.
    lines : tuple of str
        The complete verdict in words; the first line is the summary.
    tests : tuple of HypothesisTest
    suspect : SuspectedCause or None
        The single cause that explains the residuals; None where there is no such cause.
    best : SuspectedCause or None
        The best of the causes tested, with what it leaves unexplained.
    advice : tuple of Advice
        What to change in the run file, or to do; what changes keys was tried.
    scatter : float
        Scatter of the residuals over the stated scatter where uncertainties were enlarged by it;
        otherwise 1.
    noise : tuple of NoiseFactor
        Noise that was stated too large or too small.
    rounding : tuple of RoundedChannel
        Channels whose steps limit what rests show.
    """

    grade: Grade
    reasons: tuple[str, ...] = ()
    lines: tuple[str, ...] = ()
    tests: tuple[HypothesisTest, ...] = ()
    suspect: SuspectedCause | None = None
    best: SuspectedCause | None = None
    advice: tuple[Advice, ...] = ()
    scatter: float = 1.0
    noise: tuple[NoiseFactor, ...] = ()
    rounding: tuple[RoundedChannel, ...] = ()

    @property
    def word(self) -> str:
        """The grade in words, the same in terminal, report, register, page and JSON."""
        return GRADE_WORDS[self.grade]

    @property
    def tone(self) -> str:
        """The name of the grade's colour: "good", "care" or "bad"."""
        return GRADE_TONES[self.grade]

    def __str__(self) -> str:
        """Return the word, and a line for each statement."""
        return "\n· ".join(("\n".join((self.word, *self.lines[:1])), *self.lines[1:]))

    def __iter__(self) -> Iterator[str]:
        return iter(self.lines)

    def __len__(self) -> int:
        return len(self.lines)

    def __getitem__(self, k: int) -> str:
        return self.lines[k]


def assess(estimate: Estimate, count: int, possible: Collection[str] = ()) -> Assessment:
    """Return the tests of an estimate, with p-values for all of them together.

    Parameters
    ----------
    estimate : Estimate
        Without a trial axis.
    count : int
        Number of coefficients, which are its first parameters.
    possible : collection of str, optional
        Full names of the coefficients that the method can estimate.
    """
    named = [(f"residuals: {group.name}", group.chi2, group.dof) for group in estimate.groups]
    if not named and estimate.dof:
        named = [("residuals", float(estimate.chi2), estimate.dof)]
    nu = estimate.noise_dof
    real = [
        (name, chi2, dof, chi2_tail_probability(chi2, dof, nu))
        for name, chi2, dof in named
        if dof > 0
    ]
    # The further tests of a method are χ² tests however the noise was estimated.
    real += [(one.name, one.statistic, one.dof, one.p_value) for one in estimate.tests if one.dof]
    score_tests = estimate.score_tests
    share = 1 - SCORE_TEST_SHARE if any(one.dof for one in score_tests.scores) else 1.0
    tests = tuple(
        HypothesisTest(name, chi2, dof, p, min(1.0, len(real) * p / share))
        for name, chi2, dof, p in real
    )
    significant = [
        s for s in score_tests.scores if familywise_p_value(score_tests, s) < SIGNIFICANCE_LEVEL
    ]
    return Assessment(
        tests,
        _best_cause(estimate, count, significant, possible),
        _outlier_row(estimate),
        bool(significant),
    )


def familywise_p_value(score_tests: ScoreTestSet, score: ScoreTest) -> float:
    """Return the p-value of a score among all tests of its estimate."""
    return min(1.0, score_tests.adjusted(score) / SCORE_TEST_SHARE)


def grade_estimate(
    estimate: Estimate,
    assessment: Assessment,
    findings: Sequence[Finding],
    far: Sequence[str],
    lines: tuple[str, ...],
    advice: Sequence[Advice] = (),
) -> Verdict:
    """Return the verdict by the rule of this module.

    Parameters
    ----------
    estimate : Estimate
        Without a trial axis.
    assessment : Assessment
    findings : sequence of Finding
        Findings of all checks.
    far : sequence of str
        Coefficients whose scale factor is far from nominal (`is_far_from_nominal`).
    lines : tuple of str
        The verdict in words.
    advice : sequence of Advice
    """
    best, suspect = assessment.best, assessment.suspect
    largest_birge_ratio = float(estimate.largest_birge_ratio)
    bad: list[str] = []
    if not np.all(estimate.converged):
        bad.append("the fit did not converge")
    bad += [f"{name} is far from nominal" for name in far]
    refused = dict.fromkeys(one.what for one in findings if one.severity == "refused")
    bad += [f"a check refused: {what}" for what in refused]
    if assessment.rejects and largest_birge_ratio > _MAX_SCATTER:
        bad.append(f"the residuals scatter {largest_birge_ratio:.2g} times as much as stated")
    if best is not None and best.shift > _MAX_SHIFT:
        named = best.name if suspect is not None else "the best of the causes tested"
        bad.append(f"{named} shifts {best.shifted_coefficient} by {best.shift:.2g} U")
    mild = [f"test rejects the model: {test.name}" for test in assessment.rejecting_tests]
    if assessment.scores_reject and suspect is None:
        mild.append("score tests reject the model")
    elif suspect is not None:
        mild.append(f"suspect: {suspect.name}")
    warned = dict.fromkeys(one.what for one in findings if one.severity == "warning")
    mild += [f"a check warns: {what}" for what in warned]
    if not assessment.tests and not estimate.score_tests.scores:
        mild.append("nothing was tested")
    grade: Grade = "unreliable" if bad else "reservations" if mild else "consistent"
    noise = tuple(
        NoiseFactor(one.what, one.channel, one.factor) for one in findings if one.factor is not None
    )
    return Verdict(
        grade,
        (*bad, *mild),
        lines,
        assessment.tests,
        suspect,
        assessment.best,
        tuple(advice),
        largest_birge_ratio,
        noise,
    )


def is_far_from_nominal(scale: float) -> bool:
    """Return whether a scale factor, 1 being nominal, is implausibly far from nominal."""
    return not _SCALE_LIMITS[0] < scale < _SCALE_LIMITS[1]


def _best_cause(
    estimate: Estimate, count: int, significant: Sequence[ScoreTest], possible: Collection[str]
) -> SuspectedCause | None:
    score_tests = estimate.score_tests
    convincing = [score for score in significant if _explains_residuals(estimate, score)]
    if not convincing:
        return None
    logs = {score.name: _log_p(score) for score in convincing}
    least = min(logs.values())

    def rank(score: ScoreTest) -> tuple[bool, int, float]:
        # Of two statements that would explain the same, the one that departs less is the likelier.
        free = set(score.components) <= set(possible)
        return not free, _KIND_ORDER.index(score.kind), score.departure

    # Candidates in the same direction of the data have equal p-values except for rounding.
    best = min(
        (score for score in convincing if logs[score.name] <= least + 1e-6 * abs(least)),
        key=lambda score: (rank(score), -len(score.components)),
    )
    as_good = [
        score
        for score in convincing
        if score.chi2 > best.chi2 - _EQUIVALENT_CHI2
        # A cause of more directions would explain more; the readings of a row may be anything.
        and (score.kind == "row" or score.dof <= best.dof)
        and best.cosine(score) >= PARALLEL_COSINE
        and not set(score.components) & set(best.components)
    ]
    first = min((best, *as_good), key=lambda score: (rank(score), score is not best, -score.chi2))
    related = {one for one in score_tests.scores if set(one.components) & set(first.components)}
    alike = [
        one.name
        for one in sorted(score_tests.scores, key=lambda one: -first.cosine(one))
        if one not in related
        and one.dof
        and not (one.is_implausible or one.contradicts_statement)
        and first.cosine(one) >= PARALLEL_COSINE
    ]
    expanded = COVERAGE * estimate.std[:count]
    shift = np.abs(first.shift[:count]) / np.where(expanded > 0, expanded, np.inf)
    most = int(np.argmax(shift))
    return SuspectedCause(
        first.name,
        first.kind,
        first.components,
        first.units,
        tuple(first.size.tolist()),
        tuple(first.sd.tolist()),
        first.chi2,
        first.dof,
        familywise_p_value(score_tests, first),
        max(score_tests.chi2 - first.chi2, 0.0),
        max(score_tests.dof - first.dof, 0),
        float(shift[most]),
        estimate.names[most],
        tuple(alike),
        _remaining_p_value(score_tests, first),
        first.changes,
        () if first.least_size is None else tuple(first.least_size.tolist()),
    )


def _remaining_p_value(score_tests: ScoreTestSet, score: ScoreTest) -> float:
    left = max(score_tests.chi2 - score.chi2, 0.0)
    return remaining_p_value(left, score_tests.dof - score.dof, score.chi2, score_tests.noise_dof)


def _explains_residuals(estimate: Estimate, score: ScoreTest) -> bool:
    """Return whether a candidate explains the residuals better than a scatter of all rows.

    One that leaves no degree of freedom, that is implausibly large, or that
    contradicts its own statement explains nothing.
    """
    score_tests = estimate.score_tests
    left, dof = max(score_tests.chi2 - score.chi2, 0.0), score_tests.dof - score.dof
    if dof <= 0 or score.is_implausible or score.contradicts_statement:
        return False
    if _remaining_p_value(score_tests, score) >= SIGNIFICANCE_LEVEL:
        return True
    ratio = (score.chi2 / score.dof) / (left / dof)
    return (
        score_tests.adjusted(score, float(scipy.special.fdtrc(score.dof, dof, ratio)))
        < SIGNIFICANCE_LEVEL
    )


def _outlier_row(estimate: Estimate) -> OutlierRow | None:
    rows = [score for score in estimate.score_tests.scores if score.kind == "row" and score.dof]
    if not rows:
        return None
    worst = min(rows, key=_log_p)
    alike = (one for one in rows if one is not worst and worst.cosine(one) >= PARALLEL_COSINE)
    p_value = min(1.0, len(rows) * worst.p_value)
    return OutlierRow(worst.name, worst.chi2, worst.dof, p_value, tuple(one.name for one in alike))


def _log_p(score: ScoreTest) -> float:
    """Return the logarithm of a p-value, also where it is too small for a float."""
    if (p := score.p_value) > _MIN_P_VALUE:
        return float(np.log(p))
    half = score.dof / 2
    return float((half - 1) * np.log(score.chi2 / 2) - score.chi2 / 2 - scipy.special.gammaln(half))
