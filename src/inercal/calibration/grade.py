"""The rule of the verdict: how far a result can be relied on, for every method alike.

The tests of an estimate are χ² of its residuals (or of each group of them; F where their noise was
found from the recording), the method's further tests, and the score tests of what was left out.
Their overall level is 1 %: .8 % for the scores and .2 % for the tests, or all of it for the tests
where nothing is scored. The grade follows::

    consistent                 no test rejects the model, and no check warns
    usable with reservations   a test rejects the model, or a check warns, or nothing was tested
    not to be relied on        the fit did not converge, a scale factor is far from nominal, a check
                               refused, or a test rejects the model and either the scatter is more
                               than twice what was stated, or the suspect that was found shifts a
                               coefficient by more than its U

The suspect is the candidate with the smallest p-value, if it explains the residuals better than a
scatter of all rows does: what remains agrees with what was stated, or is small beside it (F test).
Candidates whose explained residual lies within 30° of the suspect's cannot be told from it. Among
those that explain as much (χ² within 4) the first is named that can be mended: a coefficient that
the method can estimate, then the bench, a change over the run, a row, and last other coefficients.
"""
# SciPy has no stubs.
# pyright: reportMissingTypeStubs=false

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.special import chdtrc, fdtrc, gammaln

from inercal.estimate import Estimate, Score
from inercal.estimate.scores import ALIKE, LEVEL, SHARE, Kind, Scored, tail
from inercal.recording import Finding

Grade = Literal["consistent", "reservations", "unreliable"]
WORDS: dict[Grade, str] = {
    "consistent": "consistent",
    "reservations": "usable with reservations",
    "unreliable": "not to be relied on",
}
TONES: dict[Grade, str] = {"consistent": "good", "reservations": "care", "unreliable": "bad"}
COVERAGE = 2.0  # U = k u; about 95 % for the degrees of freedom met here
_SCATTER = 2.0  # times what was stated
_SHIFT = 1.0  # U
_FAR = (0.65, 1.5)  # of the nominal scale factor; crude sensors are within a quarter
_ORDER: tuple[Kind, ...] = ("bench", "time", "row", "coefficient")
_AS_GOOD = 4.0  # of χ²: two standard deviations of one direction
_TINY = 1e-280  # below, a probability is taken from its asymptote


@dataclass(frozen=True)
class Assessed:
    """One test: its χ² with degrees of freedom, and its p-value alone and among all of its kind."""

    name: str
    statistic: float
    dof: int
    p_value: float
    adjusted: float

    @property
    def rejects(self) -> bool:
        """Whether the model is rejected by this test at the overall level."""
        return self.adjusted < LEVEL


@dataclass(frozen=True)
class Suspect:
    """What explains the residuals best of all that was left out or taken as known.

    Parameters
    ----------
    name, kind, components, units
        Of the candidate (`inercal.estimate.Candidate`).
    sizes, sds : tuple of float
        What its components would come out at, and their standard deviations, SI.
    chi2, dof, adjusted
        By how much χ² would fall, and its p-value among all candidates.
    left, left_dof : float and int
        χ² that remains, and its degrees of freedom.
    shift : float
        The largest shift that it causes in a coefficient, in units of that coefficient's U.
    shifted : str
        That coefficient.
    alike : tuple of str
        Candidates that explain the same residuals: no test tells them from it.
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
    left: float
    left_dof: int
    shift: float
    shifted: str
    alike: tuple[str, ...]

    @property
    def remains(self) -> float:
        """Probability of as large a χ² as remains, if what remains agrees."""
        return float(chdtrc(self.left_dof, self.left)) if self.left_dof > 0 else 1.0


@dataclass(frozen=True)
class Row:
    """The row of the data that agrees least with the others, and its p-value among all rows.

    `alike` are the rows that no test tells from it.
    """

    name: str
    chi2: float
    dof: int
    adjusted: float
    alike: tuple[str, ...]


@dataclass(frozen=True)
class Assessment:
    """What the tests of an estimate say."""

    tests: tuple[Assessed, ...]
    suspect: Suspect | None
    row: Row | None
    scores_reject: bool

    @property
    def rejected(self) -> tuple[Assessed, ...]:
        """The tests that reject the model."""
        return tuple(test for test in self.tests if test.rejects)

    @property
    def rejects(self) -> bool:
        """Whether any test rejects the model."""
        return bool(self.rejected) or self.scores_reject


@dataclass(frozen=True)
class Verdict:
    """How far a result can be relied on, and why. Iterating gives its lines.

    Parameters
    ----------
    grade : "consistent", "reservations" or "unreliable"
    reasons : tuple of str
        Why it is not consistent, in few words each.
    lines : tuple of str
        The whole verdict in words; the first line is the summary.
    tests : tuple of Assessed
    suspect : Suspect or None
    """

    grade: Grade
    reasons: tuple[str, ...] = ()
    lines: tuple[str, ...] = ()
    tests: tuple[Assessed, ...] = ()
    suspect: Suspect | None = None

    @property
    def word(self) -> str:
        """The grade in words, the same in terminal, report, register, page and JSON."""
        return WORDS[self.grade]

    @property
    def tone(self) -> str:
        """The name of the grade's colour: "good", "care" or "bad"."""
        return TONES[self.grade]

    def __iter__(self) -> Iterator[str]:
        return iter(self.lines)

    def __len__(self) -> int:
        return len(self.lines)

    def __getitem__(self, k: int) -> str:
        return self.lines[k]


def assess(estimate: Estimate, count: int, possible: Collection[str] = ()) -> Assessment:
    """Return the tests of an estimate, judged together.

    Parameters
    ----------
    estimate : Estimate
        Without a trial axis.
    count : int
        How many of its first parameters are coefficients.
    possible : collection of str, optional
        Full names of the coefficients that the method can estimate.
    """
    named = [(f"residuals: {group.name}", group.chi2, group.dof) for group in estimate.groups]
    if not named and estimate.dof:
        named = [("residuals", float(estimate.chi2), estimate.dof)]
    nu = estimate.noise_dof
    real = [(name, chi2, dof, tail(chi2, dof, nu)) for name, chi2, dof in named if dof > 0]
    # What a method tests besides is χ² whatever is behind the noise.
    real += [(one.name, one.statistic, one.dof, one.p_value) for one in estimate.tests if one.dof]
    scored = estimate.scored
    share = 1 - SHARE if any(one.dof for one in scored.scores) else 1.0
    tests = tuple(
        Assessed(name, chi2, dof, p, min(1.0, len(real) * p / share)) for name, chi2, dof, p in real
    )
    significant = [s for s in scored.scores if among_all(scored, s) < LEVEL]
    return Assessment(
        tests, _suspect(estimate, count, significant, possible), _row(estimate), bool(significant)
    )


def among_all(scored: Scored, score: Score) -> float:
    """Return the p-value of a score among all tests of its estimate."""
    return min(1.0, scored.adjusted(score) / SHARE)


def verdict_of(
    estimate: Estimate,
    assessment: Assessment,
    findings: Sequence[Finding],
    far: Sequence[str],
    lines: tuple[str, ...],
) -> Verdict:
    """Return the verdict by the rule of this module.

    Parameters
    ----------
    estimate : Estimate
        Without a trial axis.
    assessment : Assessment
    findings : sequence of Finding
        Of all checks.
    far : sequence of str
        Coefficients whose scale factor is far from nominal (`is_far`).
    lines : tuple of str
        What is said in words.
    """
    suspect, doubt = assessment.suspect, float(estimate.doubt)
    bad: list[str] = []
    if not np.all(estimate.converged):
        bad.append("the fit did not converge")
    bad += [f"{name} is far from nominal" for name in far]
    bad += [f"a check refused: {one.what}" for one in findings if one.severity == "refused"]
    if assessment.rejects and doubt > _SCATTER:
        bad.append(f"the residuals scatter {doubt:.2g} times as much as stated")
    if suspect is not None and suspect.shift > _SHIFT:
        bad.append(f"{suspect.name} shifts {suspect.shifted} by {suspect.shift:.2g} U")
    mild = [f"test rejects the model: {test.name}" for test in assessment.rejected]
    if assessment.scores_reject and suspect is None:
        mild.append("score tests reject the model")
    elif suspect is not None:
        mild.append(f"suspect: {suspect.name}")
    mild += [f"a check warns: {one.what}" for one in findings if one.severity == "warning"]
    if not assessment.tests and not estimate.scored.scores:
        mild.append("nothing was tested")
    grade: Grade = "unreliable" if bad else "reservations" if mild else "consistent"
    return Verdict(grade, (*bad, *mild), lines, assessment.tests, suspect)


def is_far(scale: float) -> bool:
    """Return whether a scale factor, 1 being nominal, is so far off that something is wrong."""
    return not _FAR[0] < scale < _FAR[1]


def _suspect(
    estimate: Estimate, count: int, significant: Sequence[Score], possible: Collection[str]
) -> Suspect | None:
    scored = estimate.scored
    convincing = [score for score in significant if _explains(estimate, score)]
    if not convincing:
        return None
    logs = {score.name: _log_p(score) for score in convincing}
    least = min(logs.values())

    def rank(score: Score) -> tuple[bool, int]:
        return not set(score.components) <= set(possible), _ORDER.index(score.kind)

    # Candidates that are one direction of the data have one p-value, but for rounding.
    best = min(
        (score for score in convincing if logs[score.name] <= least + 1e-6 * abs(least)),
        key=lambda score: (rank(score), -len(score.components)),
    )
    as_good = [
        score
        for score in convincing
        if score.chi2 > best.chi2 - _AS_GOOD
        and best.cosine(score) >= ALIKE
        and not set(score.components) & set(best.components)
    ]
    first = min((best, *as_good), key=lambda score: (rank(score), score is not best, -score.chi2))
    related = {one for one in scored.scores if set(one.components) & set(first.components)}
    alike = [
        one.name
        for one in sorted(scored.scores, key=lambda one: -first.cosine(one))
        if one not in related and one.dof and first.cosine(one) >= ALIKE
    ]
    expanded = COVERAGE * estimate.std[:count]
    shift = np.abs(first.shift[:count]) / np.where(expanded > 0, expanded, np.inf)
    most = int(np.argmax(shift))
    return Suspect(
        first.name,
        first.kind,
        first.components,
        first.units,
        tuple(first.size.tolist()),
        tuple(first.sd.tolist()),
        first.chi2,
        first.dof,
        among_all(scored, first),
        max(scored.chi2 - first.chi2, 0.0),
        max(scored.dof - first.dof, 0),
        float(shift[most]),
        estimate.names[most],
        tuple(alike),
    )


def _explains(estimate: Estimate, score: Score) -> bool:
    """Return whether a candidate explains the residuals better than a scatter of all rows does."""
    scored = estimate.scored
    left, dof = max(scored.chi2 - score.chi2, 0.0), scored.dof - score.dof
    if dof <= 0 or float(chdtrc(dof, left)) > LEVEL:
        return True
    ratio = (score.chi2 / score.dof) / (left / dof)
    return scored.adjusted(score, float(fdtrc(score.dof, dof, ratio))) < LEVEL


def _row(estimate: Estimate) -> Row | None:
    rows = [score for score in estimate.scored.scores if score.kind == "row" and score.dof]
    if not rows:
        return None
    worst = min(rows, key=_log_p)
    alike = (one for one in rows if one is not worst and worst.cosine(one) >= ALIKE)
    p_value = min(1.0, len(rows) * worst.p_value)
    return Row(worst.name, worst.chi2, worst.dof, p_value, tuple(one.name for one in alike))


def _log_p(score: Score) -> float:
    """Return the logarithm of a p-value, also where it is too small for a float."""
    if (p := score.p_value) > _TINY:
        return float(np.log(p))
    half = score.dof / 2
    return float((half - 1) * np.log(score.chi2 / 2) - score.chi2 / 2 - gammaln(half))
