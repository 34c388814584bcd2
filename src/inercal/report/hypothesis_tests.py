"""The section of a report on the tests: each with its p-value, and the candidates they suspect."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from inercal.calibration.best_cause import familywise_p_value
from inercal.calibration.suspect_text import format_component, p_value_text
from inercal.estimation import ScoreTest
from inercal.estimation.uncertainty.coverage import COVERAGE
from inercal.pipeline import Outcome

_MAX_LISTED = 10  # candidates
_KIND_TEXTS = {
    "coefficient": "coefficient, not estimated",
    "bench": "bench, beyond its statement",
    "row": "readings of one row",
    "time": "change over the run",
}


class HypothesisTestRow(NamedTuple):
    """One test: texts."""

    name: str
    chi2: str
    dof: str
    p: str
    familywise_p: str
    rejects: bool

    __test__ = False  # no test of pytest's


class CandidateRow(NamedTuple):
    """One candidate of the score tests: texts."""

    name: str
    kind: str
    size: str
    chi2_decrease: str
    dof: str
    familywise_p: str
    shift: str
    suspect: bool


def hypothesis_test_rows(outcome: Outcome) -> list[HypothesisTestRow]:
    """Return the tests of the verdict."""
    return [
        HypothesisTestRow(
            one.name,
            f"{one.statistic:.1f}",
            str(one.dof),
            _p_value_text(one.p_value),
            _p_value_text(one.adjusted),
            one.rejects,
        )
        for one in outcome.verdict.tests
    ]


def candidate_rows(outcome: Outcome) -> list[CandidateRow]:
    """Return the candidates with the smallest p-values, the smallest first."""
    score_tests, suspect = outcome.estimate.score_tests, outcome.verdict.suspect
    seen = [one for one in score_tests.scores if one.dof]
    first = sorted(seen, key=lambda one: (one.p_value, -one.chi2))[:_MAX_LISTED]
    return [
        CandidateRow(
            one.name,
            _KIND_TEXTS[one.kind],
            _size_text(outcome, one),
            f"{one.chi2:.1f}",
            str(one.dof),
            _p_value_text(familywise_p_value(score_tests, one)),
            _shift_text(outcome, one),
            suspect is not None and one.name == suspect.name,
        )
        for one in first
    ]


def candidate_count(outcome: Outcome) -> int:
    """Return how many candidates were scored."""
    return sum(one.dof > 0 for one in outcome.estimate.score_tests.scores)


def _p_value_text(p: float) -> str:
    return f"{p:.2f}" if p >= 0.01 else p_value_text(p).removeprefix("= ")


def _size_text(outcome: Outcome, one: ScoreTest) -> str:
    if one.kind == "row":
        return ""
    parts: Sequence[str] = [
        format_component(outcome.calibration.sensor, one.kind, name, float(size), float(sd), unit)
        for name, size, sd, unit in zip(one.components, one.size, one.sd, one.units, strict=True)
        if np.isfinite(size)
    ]
    return "; ".join(parts)


def _shift_text(outcome: Outcome, one: ScoreTest) -> str:
    """Return the largest shift in U, and the coefficient that it shifts."""
    names = outcome.calibration.sensor.coefficients
    expanded = COVERAGE * outcome.estimate.std[: len(names)]
    shift = np.abs(one.shift[: len(names)]) / np.where(expanded > 0, expanded, np.inf)
    most = int(np.argmax(shift))
    return f"{shift[most]:.2g} ({names[most]})" if shift[most] > 0 else "0"
