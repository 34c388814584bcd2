"""A verdict as JSON, in calibration files and for `--json`: sizes in SI."""

from typing import Any

import numpy as np

from inercal.calibration.grade import GRADE_WORDS, HypothesisTest, SuspectedCause, Verdict


def as_object(verdict: Verdict) -> dict[str, Any]:
    """Return the verdict as JSON; sizes in SI."""
    one = verdict.suspect
    suspect = None if one is None else {
        "name": one.name,
        "kind": one.kind,
        "components": [
            {"name": name, "value": _number(size), "std": _number(sd), "unit": unit}
            for name, size, sd, unit in zip(
                one.components, one.sizes, one.sds, one.units, strict=True
            )
        ],
        "chi2": one.chi2,
        "dof": one.dof,
        "p_value": one.adjusted,
        "largest_shift": {"coefficient": one.shifted_coefficient, "in_U": one.shift},
        "not_told_from": list(one.indistinguishable),
    }  # fmt: skip
    return {
        "grade": verdict.grade,
        "word": verdict.word,
        "reasons": list(verdict.reasons),
        "tests": [
            {
                "name": test.name,
                "chi2": test.statistic,
                "dof": test.dof,
                "p_value": test.p_value,
                "p_among_all": test.adjusted,
            }
            for test in verdict.tests
        ],
        "suspect": suspect,
    }


def from_object(content: dict[str, Any], lines: tuple[str, ...]) -> Verdict:
    """Return the verdict of a calibration file; `lines` are its notes."""
    one = content["suspect"]
    suspect = one and SuspectedCause(
        one["name"],
        one["kind"],
        tuple(c["name"] for c in one["components"]),
        tuple(c["unit"] for c in one["components"]),
        tuple(np.nan if c["value"] is None else c["value"] for c in one["components"]),
        tuple(np.nan if c["std"] is None else c["std"] for c in one["components"]),
        one["chi2"],
        one["dof"],
        one["p_value"],
        np.nan,
        0,
        one["largest_shift"]["in_U"],
        one["largest_shift"]["coefficient"],
        tuple(one["not_told_from"]),
    )
    grade = content["grade"]
    if grade not in GRADE_WORDS:
        raise ValueError(f"verdict {grade!r} is not one of {', '.join(GRADE_WORDS)}")
    tests = tuple(
        HypothesisTest(t["name"], t["chi2"], t["dof"], t["p_value"], t["p_among_all"])
        for t in content["tests"]
    )
    return Verdict(grade, tuple(content["reasons"]), lines, tests, suspect)


def _number(value: float) -> float | None:
    return value if np.isfinite(value) else None
