"""Find the tested cause that explains the residuals best, and the row that fits worst.

The best cause is the candidate with the smallest p-value. It must explain the residuals better than
a scatter of all rows would: the remaining residuals are consistent with the stated noise, or they
are small compared with the explained part (F test). At least one degree of freedom must remain. If
the candidate is a coefficient, it may exceed its largest plausible size by at most 6 standard
deviations; a stated quantity may be wrong by about half of its value, and an angle by 180°. If the
estimated parameters absorb all but a thousandth of the candidate's effect, the candidate may differ
from its stated value by at most 6 standard deviations, unless every other stated quantity that
explains as much would differ by more.

A candidate cannot be distinguished from the best candidate if the angle between the residuals that
the two explain is less than 30°. Several candidates may explain the residuals equally well: their
χ² differs by at most 4, and (except for rows) they have no more directions. The one with the most
useful remedy is then chosen, in this order: a coefficient that the method can estimate, the bench,
a change during the run, a row, other coefficients. Between two stated quantities, the quantity that
differs from its stated value by fewer standard deviations is chosen.

A run file may treat random errors of the bench as zero, such as changes of the gyros' biases from
setting to setting. Such errors replace a coefficient or a drift whose effect they include, unless
their other directions would be exceptionally small (F test). This is the safe choice: if the errors
are then stated, U includes the effect.

An advisor says what to do about such a cause.
"""
# SciPy has no stubs.
# pyright: reportMissingTypeStubs=false

from collections.abc import Collection, Sequence
from dataclasses import dataclass, field
from typing import Protocol, cast

import numpy as np
import scipy

from inercal.basics.run_file_advice import Advice, Change
from inercal.estimation import Estimate, ScoreTest
from inercal.estimation.scores import (
    BIAS_STEP,
    CERTIFICATE,
    HYSTERESIS,
    LINEARISATION,
    PARALLEL_COSINE,
    SCORE_TEST_SHARE,
    SIGNIFICANCE_LEVEL,
    CandidateKind,
    ScoreTestSet,
    chi2_tail_probability,
    sufficiency_p_value,
)
from inercal.estimation.uncertainty import COVERAGE

_MOST_ROWS = 2  # largest number of other rows that are named
CHANGE_PREFIX = "change "  # start of the name of a candidate for a change within one row


_KIND_ORDER: tuple[CandidateKind, ...] = ("bench", "time", "row", "coefficient")
_EQUIVALENT_CHI2 = 4.0  # difference of χ²: two standard deviations of one direction
_INCREDIBLE = 30.0  # standard deviations of a stated value
_LEAST_CHANCE = 0.01  # that random errors are as uneven
_FEWEST_MORE = 3  # further directions; fewer do not show whether errors are random
_MIN_P_VALUE = 1e-280  # smaller probabilities are computed from an asymptotic formula


@dataclass(frozen=True)
class SuspectedCause:
    """The candidate, an unmodelled effect or a stated value, that best explains the residuals.

    Parameters
    ----------
    name, kind, components, units
        The values of the candidate (`inercal.estimation.Candidate`).
    sizes, sds : tuple of float
        Estimated sizes of its components and their standard deviations, SI; NaN if unknown.
    chi2, dof, adjusted
        Decrease of χ², its degrees of freedom, and the p-value adjusted for the number of
        candidates.
    remaining_chi2, remaining_dof : float and int
        Remaining χ², and its degrees of freedom.
    remaining_p_value : float
        Probability of a χ² at least as large as the remaining χ² if there is no other cause.
    changes : tuple of Change
        Run-file keys that make the method estimate the candidate.
    least_sizes : tuple of float
        Smallest sizes of the components that explain as much, SI.
    other_rows : tuple of str
        If the cause is a row: the other rows in `indistinguishable`. A file does not state them.
    is_sufficient : bool
        Whether noise explains the rest, or the error with which the effect is computed
        (`inercal.estimation.Candidate`). A file does not state it.
    shift : float
        Largest shift of a coefficient due to the cause, divided by the U of this coefficient.
    shifted_coefficient : str
        The coefficient with the largest shift.
    indistinguishable : tuple of str
        Candidates that no test can distinguish from this cause, because they explain the same
        residuals.
    """

    name: str
    kind: CandidateKind
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
    other_rows: tuple[str, ...] = field(default=(), compare=False)
    is_sufficient: bool = field(default=True, compare=False)

    @property
    def place(self) -> str:
        """The name, with the rows that cannot be distinguished from it: "x_a or x_p"."""
        if len(self.other_rows) > _MOST_ROWS:
            return f"{self.name} or one of {len(self.other_rows)} other rows"
        return " or ".join((self.name, *self.other_rows))


@dataclass(frozen=True)
class OutlierRow:
    """The row that agrees least with the others, and its p-value, adjusted for the number of rows.

    `indistinguishable` lists the rows that no test can distinguish from this row.
    """

    name: str
    chi2: float
    dof: int
    adjusted: float
    indistinguishable: tuple[str, ...]


def familywise_p_value(
    score_tests: ScoreTestSet, score: ScoreTest, p_value: float | None = None
) -> float:
    """Adjust the p-value of a score, or the given `p_value`, for the number of tests."""
    return min(1.0, score_tests.adjusted(score, p_value) / SCORE_TEST_SHARE)


def find_best_cause(
    estimate: Estimate, count: int, significant: Sequence[ScoreTest], possible: Collection[str]
) -> SuspectedCause | None:
    """Return the best of the tested causes; None if none explains the residuals.

    Parameters
    ----------
    estimate : Estimate
        An estimate without a trial axis.
    count : int
        Number of coefficients, which are the first parameters of the estimate.
    significant : sequence of ScoreTest
        The score tests that reject the model.
    possible : collection of str
        Full names of the coefficients that the method can estimate.
    """
    score_tests = estimate.score_tests
    explaining = [score for score in significant if _explains_residuals(estimate, score)]
    convincing = [score for score in explaining if not score.contradicts_statement]
    if not convincing:
        return None
    logs = {score.name: _log_p(score) for score in convincing}
    least = min(logs.values())

    def rank(score: ScoreTest) -> tuple[bool, int, float]:
        # If two stated values explain the same, the value that departs less is more likely to be
        # wrong.
        free = set(score.components) <= set(possible)
        return not free, _KIND_ORDER.index(score.kind), score.departure

    # Candidates with the same effect on the data have equal p-values, except for rounding.
    best = min(
        (score for score in convincing if logs[score.name] <= least + 1e-6 * abs(least)),
        key=lambda score: (rank(score), -len(score.components)),
    )
    as_good = [
        score
        for score in convincing
        if score.chi2 > best.chi2 - max(_EQUIVALENT_CHI2, _uncertain_chi2(score))
        # A cause with more directions would always explain more. If the cause is a row, its
        # readings may have any values.
        and (score.kind == "row" or score.dof <= best.dof)
        and best.cosine(score) >= PARALLEL_COSINE
        and not set(score.components) & set(best.components)
    ]
    first = min((best, *as_good), key=lambda score: (rank(score), score is not best, -score.chi2))
    # A statement that the data contradict is the cause rather than one that departs even more.
    first = min(
        (
            score
            for score in explaining
            if score.kind == first.kind == "bench"
            and 0 < score.departure < first.departure
            and score.dof <= first.dof
            and _is_equivalent(score_tests, score, first)
        ),
        key=lambda score: score.departure,
        default=first,
    )
    scatter = [score for score in convincing if _may_include(score, first)]
    first = min(scatter, key=lambda score: logs[score.name], default=first)
    related = {one for one in score_tests.scores if set(one.components) & set(first.components)}
    alike = [
        one
        for one in sorted(score_tests.scores, key=lambda one: -first.cosine(one))
        if one not in related
        and one.dof
        and not (one.is_implausible or one.contradicts_statement)
        and (first.cosine(one) >= PARALLEL_COSINE or (one in convincing and _is_loop(first, one)))
    ]
    expanded = COVERAGE * estimate.std[:count]
    shift = np.abs(first.shift[:count]) / np.where(expanded > 0, expanded, np.inf)
    most = int(np.argmax(shift))
    known = 1.0 if first.effect_error <= LINEARISATION else np.nan
    return SuspectedCause(
        first.name,
        first.kind,
        first.components,
        first.units,
        tuple((known * first.size).tolist()),
        tuple((known * first.sd).tolist()),
        first.chi2,
        first.dof,
        familywise_p_value(score_tests, first),
        max(score_tests.chi2 - first.chi2, 0.0),
        max(score_tests.dof - first.dof, 0),
        float(shift[most]),
        estimate.names[most],
        tuple(one.name for one in alike),
        chi2_tail_probability(
            max(score_tests.chi2 - first.chi2, 0.0),
            score_tests.dof - first.dof,
            score_tests.noise_dof,
        ),
        first.changes,
        () if first.least_size is None else tuple(first.least_size.tolist()),
        tuple(one.name for one in alike if first.kind == one.kind == "row"),
        _is_sufficient(score_tests, first),
    )


def _uncertain_chi2(score: ScoreTest) -> float:
    """Return the χ² that a candidate may leave because its effect is not known accurately."""
    return (score.effect_error**2 - LINEARISATION**2) * score.chi2


def _is_equivalent(score_tests: ScoreTestSet, score: ScoreTest, other: ScoreTest) -> bool:
    """Return whether a candidate explains as much as another, or enough if that is incredible."""
    enough = other.departure > _INCREDIBLE and _is_sufficient(score_tests, score)
    return other.cosine(score) >= PARALLEL_COSINE and (
        enough or score.chi2 > other.chi2 - _EQUIVALENT_CHI2
    )


def _is_loop(one: ScoreTest, other: ScoreTest) -> bool:
    """Return whether one of two causes is a hysteresis, and both explain the residuals as well.

    A hysteresis and a creep of the base are at 30.5°, just beyond what counts as parallel.
    """
    names = (one.name, other.name)
    return any(name.startswith(HYSTERESIS) for name in names) and (
        abs(one.chi2 - other.chi2) < _EQUIVALENT_CHI2
    )


def _may_include(score: ScoreTest, cause: ScoreTest) -> bool:
    """Return whether unstated random errors of the bench may be what looks like another cause."""
    further = score.dof - cause.dof
    if score.kind != "bench" or cause.kind not in ("coefficient", "time") or further < _FEWEST_MORE:
        return False
    if score.stated_sds is None or score.stated_sds.any() or cause.cosine(score) < PARALLEL_COSINE:
        return False
    ratio = (max(score.chi2 - cause.chi2, 0.0) / further) / (cause.chi2 / cause.dof)
    return float(scipy.special.fdtr(further, cause.dof, ratio)) > _LEAST_CHANCE


def _is_sufficient(score_tests: ScoreTestSet, score: ScoreTest) -> bool:
    left, dof = max(score_tests.chi2 - score.chi2, 0.0), score_tests.dof - score.dof
    p_value = sufficiency_p_value(left, dof, score.chi2, score_tests.noise_dof, score.effect_error)
    return p_value >= SIGNIFICANCE_LEVEL


def _explains_residuals(estimate: Estimate, score: ScoreTest) -> bool:
    """Return whether a candidate explains the residuals better than a scatter of all rows would.

    A candidate explains nothing if no degree of freedom remains or if it is implausibly large.
    """
    score_tests = estimate.score_tests
    left, dof = max(score_tests.chi2 - score.chi2, 0.0), score_tests.dof - score.dof
    if dof <= 0 or score.is_implausible:
        return False
    if not left or _is_sufficient(score_tests, score):
        return True
    ratio = (score.chi2 / score.dof) / (left / dof)
    return (
        score_tests.adjusted(score, float(scipy.special.fdtrc(score.dof, dof, ratio)))
        < SIGNIFICANCE_LEVEL
    )


def find_outlier_row(estimate: Estimate) -> OutlierRow | None:
    """Return the row that agrees least with the others, or None if no row was tested."""
    rows = [score for score in estimate.score_tests.scores if score.kind == "row" and score.dof]
    if not rows:
        return None
    worst = min(rows, key=_log_p)
    alike = (one for one in rows if one is not worst and worst.cosine(one) >= PARALLEL_COSINE)
    p_value = min(1.0, len(rows) * worst.p_value)
    return OutlierRow(worst.name, worst.chi2, worst.dof, p_value, tuple(one.name for one in alike))


def _log_p(score: ScoreTest) -> float:
    """Return the logarithm of a p-value, even if the p-value is too small for a float."""
    if (p := score.p_value) > _MIN_P_VALUE:
        return float(np.log(p))
    half = score.dof / 2
    return float((half - 1) * np.log(score.chi2 / 2) - score.chi2 / 2 - scipy.special.gammaln(half))


class Advisor(Protocol):
    """An advisor that tries its advice before it gives it, so that the changed run file works."""

    def on_cause(self, cause: SuspectedCause) -> Advice:
        """Return keys that make the model include a cause, or else an action at the bench."""
        ...

    def on_coefficients(self, names: Sequence[str]) -> Advice | None:
        """Return the key that makes the method estimate undetectable coefficients, if it can."""
        ...

    def on_changes(self, advice: Advice) -> Advice | None:
        """Complete the keys in the advice of a method; None if the advice cannot be followed."""
        ...

    def accepts_uncertainty(self, name: str) -> bool | None:
        """Return whether the run file can state an uncertainty of a bench parameter.

        False if the key has no effect in this run, and None if there is no such key.
        """
        ...


class PlainAdvisor:
    """An advisor without a run, which cannot try its advice.

    Parameters
    ----------
    possible : collection of str
        Full names of the coefficients that the method can estimate.
    row_word : str
        Word for a row of the data, used in sentences.
    """

    def __init__(self, possible: Collection[str], row_word: str) -> None:
        self._possible, self._row_word = possible, row_word

    def on_cause(self, cause: SuspectedCause) -> Advice:
        """Return the key that makes the method estimate the coefficient, or an action."""
        if is_estimable(cause, self._possible):
            return Advice(cause.name, (also((cause.name,)),), chi2=cause.remaining_chi2)
        return Advice(cause.name, action=action_on(cause, self._row_word))

    def on_coefficients(self, names: Sequence[str]) -> Advice | None:
        """Return the key that makes the method estimate these coefficients."""
        return Advice(", ".join(names), (also(names),)) if names else None

    def on_changes(self, advice: Advice) -> Advice | None:
        """Return the advice unchanged."""
        return advice

    def accepts_uncertainty(self, name: str) -> bool | None:
        """Return True, because there is no run that could refuse the key."""
        return True


def is_estimable(cause: SuspectedCause, possible: Collection[str]) -> bool:
    """Return whether a cause consists of coefficients that the method can estimate."""
    return cause.kind == "coefficient" and set(cause.components) <= set(possible)


def also(words: str | Sequence[str]) -> Change:
    """Return the [method] key `also`, which adds coefficients by their words, or "auto"."""
    return Change("method", "also", words if isinstance(words, str) else tuple(words))


STATED_WITH_A_SIGN = ("latitude", "autocollimator scale")
"""Bench parameters about which `action_on` says to check their sign."""


def action_on(cause: SuspectedCause, row_word: str) -> str:
    """Describe what to do at the bench about a cause that no run-file key can include."""
    if cause.kind == "coefficient":
        return "use a method that estimates this coefficient; U does not include its effect"
    if cause.name == "latitude":
        return "check the latitude and its sign, and the names and signs of the gyros' columns"
    if cause.name in ("autocollimator scale", "level scale"):
        instrument = cause.name.partition(" ")[0]
        return f"check the sign and the unit of the {instrument} readings in [data]"
    if cause.name.startswith(CERTIFICATE):
        return "check the sign and the first face of the deviations in [bench] polygon"
    if cause.kind == "bench" and cause.changes:
        return f"check whether the run file should state {changes_text(cause.changes)}"
    if cause.name.startswith(BIAS_STEP):
        return "check whether the sensor was touched or switched off there; if so, split the run"
    if cause.name.startswith(HYSTERESIS) and cause.name.endswith("temperature"):
        return "change the temperature more slowly; the conditions of the fit state half the loop"
    if cause.name.startswith(HYSTERESIS):
        return "turn slowly and without overshoot, and repeat the test; U does not include it"
    if cause.kind == "bench":
        return "measure it again, or state it with its true uncertainty"
    if cause.units[:1] == ("T",):
        again = f"this {row_word}" if cause.kind == "row" else "the recording"
        return f"keep iron, magnets and currents away, and repeat {again}"
    if cause.kind == "row":
        return f"look at the readings of “{cause.place}”, and repeat this {row_word}"
    if cause.name.startswith(CHANGE_PREFIX):
        return f"check whether the sensor was touched; repeat this {row_word} or remove it"
    return "let the sensor settle before the run, or repeat the first positions at the end"


def changes_text(changes: Sequence[Change]) -> str:
    """Return changes as text for a run file: '[method] also = ["k2"]'."""
    return " and ".join(f"[{one.section}] {_key(one)} = {_toml(one.value)}" for one in changes)


def _key(change: Change) -> str:
    """Return a key of a run file, in quotation marks if it is the name of a coefficient."""
    return f'"{change.key}"' if "." in change.key else change.key


def _toml(value: object) -> str:
    if isinstance(value, str):
        return f'"{value}"'
    if isinstance(value, list | tuple):
        return f"[{', '.join(_toml(one) for one in cast(Sequence[object], value))}]"
    return str(value).lower() if isinstance(value, bool) else str(value)
