"""The section of a report on the tests: each with its p-value, and the candidates they suspect."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from inercal.calibration.grade import among_all
from inercal.calibration.verdict import COVERAGE, chance, in_words
from inercal.estimate import Score
from inercal.pipeline import Outcome

_LISTED = 10  # candidates
_KINDS = {
    "coefficient": "coefficient, not estimated",
    "bench": "bench, beyond its statement",
    "row": "readings of one row",
    "time": "change over the run",
}


class TestRow(NamedTuple):
    """One test: texts."""

    name: str
    chi2: str
    dof: str
    p: str
    among: str
    rejects: bool

    __test__ = False  # no test of pytest's


class CandidateRow(NamedTuple):
    """One candidate of the score tests: texts."""

    name: str
    kind: str
    size: str
    fall: str
    dof: str
    among: str
    shift: str
    suspect: bool


def tests(outcome: Outcome) -> list[TestRow]:
    """Return the tests of the verdict."""
    return [
        TestRow(
            one.name,
            f"{one.statistic:.1f}",
            str(one.dof),
            _p(one.p_value),
            _p(one.adjusted),
            one.rejects,
        )
        for one in outcome.verdict.tests
    ]


def candidates(outcome: Outcome) -> list[CandidateRow]:
    """Return the candidates with the smallest p-values, the smallest first."""
    scored, suspect = outcome.estimate.scored, outcome.verdict.suspect
    seen = [one for one in scored.scores if one.dof]
    first = sorted(seen, key=lambda one: (one.p_value, -one.chi2))[:_LISTED]
    return [
        CandidateRow(
            one.name,
            _KINDS[one.kind],
            _sizes(outcome, one),
            f"{one.chi2:.1f}",
            str(one.dof),
            _p(among_all(scored, one)),
            _shift(outcome, one),
            suspect is not None and one.name == suspect.name,
        )
        for one in first
    ]


def counted(outcome: Outcome) -> int:
    """Return how many candidates were scored."""
    return sum(one.dof > 0 for one in outcome.estimate.scored.scores)


def _p(p: float) -> str:
    return f"{p:.2f}" if p >= 0.01 else chance(p).removeprefix("= ")


def _sizes(outcome: Outcome, one: Score) -> str:
    if one.kind == "row":
        return ""
    parts: Sequence[str] = [
        in_words(outcome.calibration.sensor, one.kind, name, float(size), float(sd), unit)
        for name, size, sd, unit in zip(one.components, one.size, one.sd, one.units, strict=True)
        if np.isfinite(size)
    ]
    return "; ".join(parts)


def _shift(outcome: Outcome, one: Score) -> str:
    """Return the largest shift in U, and the coefficient that it shifts."""
    names = outcome.calibration.sensor.coefficients
    expanded = COVERAGE * outcome.estimate.std[: len(names)]
    shift = np.abs(one.shift[: len(names)]) / np.where(expanded > 0, expanded, np.inf)
    most = int(np.argmax(shift))
    return f"{shift[most]:.2g} ({names[most]})" if shift[most] > 0 else "0"
