"""The report of a self-check as text, for print and archive."""

from collections.abc import Mapping

from inercal.pipeline.self_check import TOLERANCE, CaseResult, SelfCheck

_HEADS = ("method", "coefficients", "difference", "probability", "verdict", "time", "result")


def report_text(check: SelfCheck) -> str:
    """Return the report: date, versions, machine, a line of each method, reasons of failures."""
    rows = [_HEADS, *(_cells(one) for one in check.results)]
    widths = [max(len(row[k]) for row in rows) for k in range(len(_HEADS))]
    table = [
        "  ".join(c.ljust(w) for c, w in zip(row, widths, strict=True)).rstrip() for row in rows
    ]
    failed = [f"{one.method}: {one.reason}" for one in check.results if one.reason]
    passed = len(check.results) - len(failed)
    return "\n".join(
        [
            "Self-check of inercal: known answers",
            "",
            f"begun         {check.begun}",
            f"versions      {_words(check.versions)}",
            f"machine       {_words(check.machine)}",
            f"answers with  {_words(check.stored_with)}",
            f"tolerance     {TOLERANCE} u from the stored answers, of values and of u",
            "",
            *table,
            "",
            *failed,
            f"{passed} of {len(check.results)} methods passed",
            "",
        ]
    )


def _cells(one: CaseResult) -> tuple[str, ...]:
    probability = "" if one.probability is None else f"{one.probability:.3f}"
    difference = "" if one.coefficients == 0 else f"{one.deviation:.1e} u"
    verdict, count = one.grade, str(one.coefficients)
    result = "passed" if one.passed else "FAILED"
    return one.method, count, difference, probability, verdict, f"{one.seconds:.1f} s", result


def _words(facts: Mapping[str, str]) -> str:
    return ", ".join(f"{name} {value}" for name, value in facts.items())
