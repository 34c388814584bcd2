"""A verdict as JSON, in calibration files and for `--json`: sizes in SI."""

from typing import Any

import numpy as np

from inercal.basics.errors import InputError
from inercal.basics.run_file_advice import Advice, Change
from inercal.calibration.best_cause import SuspectedCause
from inercal.calibration.grade import GRADE_WORDS, HypothesisTest, NoiseFactor, Verdict
from inercal.recordings import RoundedChannel


def as_object(verdict: Verdict) -> dict[str, Any]:
    """Return the verdict as JSON; sizes in SI."""
    return {
        "grade": verdict.grade,
        "word": verdict.word,
        "reasons": list(verdict.reasons),
        "tests": [
            {
                "name": test.name,
                "chi2": _number(test.statistic),
                "dof": test.dof,
                "p_value": _number(test.p_value),
                "p_among_all": _number(test.adjusted),
            }
            for test in verdict.tests
        ],
        "suspect": _cause_as_object(verdict.suspect),
        "best_cause": _cause_as_object(verdict.best),
        "advice": [
            {
                "reason": one.reason,
                "changes": [
                    {"section": c.section, "key": c.key, "value": c.value} for c in one.changes
                ],
                "action": one.action,
                "chi2": one.chi2,
            }
            for one in verdict.advice
        ],
        "scatter": _number(verdict.scatter),
        "noise": [
            {"what": one.what, "channel": one.channel, "factor": _number(one.factor)}
            for one in verdict.noise
        ],
    } | _rounding_object(verdict)


def _rounding_object(verdict: Verdict) -> dict[str, Any]:
    """Return the rounded channels; nothing where there are none."""
    channels = [one._asdict() for one in verdict.rounding]
    return {"rounding": channels} if channels else {}


def _cause_as_object(one: SuspectedCause | None) -> dict[str, Any] | None:
    return None if one is None else {
        "name": one.name,
        "kind": one.kind,
        "components": [
            {"name": name, "value": _number(size), "std": _number(sd), "unit": unit}
            for name, size, sd, unit in zip(
                one.components, one.sizes, one.sds, one.units, strict=True
            )
        ],
        "chi2": _number(one.chi2),
        "dof": one.dof,
        "p_value": _number(one.adjusted),
        "remaining": {
            "chi2": _number(one.remaining_chi2),
            "dof": one.remaining_dof,
            "p_value": _number(one.remaining_p_value),
        },
        "largest_shift": {"coefficient": one.shifted_coefficient, "in_U": _number(one.shift)},
        "not_told_from": list(one.indistinguishable),
    }  # fmt: skip


def from_object(content: dict[str, Any], lines: tuple[str, ...]) -> Verdict:
    """Return the verdict of a calibration file; `lines` are its notes."""
    grade = content["grade"]
    if grade not in GRADE_WORDS:
        raise InputError(f"verdict {grade!r} is not one of {', '.join(GRADE_WORDS)}")
    tests = tuple(
        HypothesisTest(
            t["name"], _float(t["chi2"]), t["dof"], _float(t["p_value"]), _float(t["p_among_all"])
        )
        for t in content["tests"]
    )
    suspect = _cause_from_object(content["suspect"])
    # Files of earlier versions state no best cause, no advice, no scatter and no noise factors.
    best = _cause_from_object(content["best_cause"]) if "best_cause" in content else suspect
    advice = tuple(
        Advice(
            one["reason"],
            tuple(Change(c["section"], c["key"], c["value"]) for c in one["changes"]),
            one["action"],
            one["chi2"],
        )
        for one in content.get("advice", [])
    )
    scatter = _float(content.get("scatter"))
    noise = tuple(
        NoiseFactor(one["what"], one["channel"], _float(one["factor"]))
        for one in content.get("noise", ())
    )
    rounding = tuple(RoundedChannel(**channel) for channel in content.get("rounding") or ())
    return Verdict(
        grade,
        tuple(content["reasons"]),
        lines,
        tests,
        suspect,
        best,
        advice,
        scatter,
        noise,
        rounding,
    )


def _cause_from_object(one: dict[str, Any] | None) -> SuspectedCause | None:
    if one is None:
        return None
    left = one.get("remaining", {"chi2": None, "dof": 0, "p_value": 1.0})
    return SuspectedCause(
        one["name"],
        one["kind"],
        tuple(c["name"] for c in one["components"]),
        tuple(c["unit"] for c in one["components"]),
        tuple(_float(c["value"]) for c in one["components"]),
        tuple(_float(c["std"]) for c in one["components"]),
        _float(one["chi2"]),
        one["dof"],
        _float(one["p_value"]),
        _float(left["chi2"]),
        left["dof"],
        _float(one["largest_shift"]["in_U"]),
        one["largest_shift"]["coefficient"],
        tuple(one["not_told_from"]),
        _float(left["p_value"]),
    )


def _number(value: float) -> float | None:
    return value if np.isfinite(value) else None


def _float(value: float | None) -> float:
    return np.nan if value is None else float(value)
