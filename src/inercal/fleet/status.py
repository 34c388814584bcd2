"""Report the progress of a line: sensors by status and grade, and why results are missing."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from inercal.calibration.grade import GRADE_WORDS
from inercal.estimation.uncertainty.conformity import RESULTS
from inercal.fleet import results
from inercal.fleet.latest import OUTDATED, latest_results
from inercal.fleet.line import Line

_NAMES = 1000  # largest number of sensors listed for a reason


@dataclass(frozen=True)
class LineStatus:
    """The status of the sensors of a line.

    Parameters
    ----------
    counts : mapping of str to int
        Number of sensors by status.
    reasons : sequence of (str, sequence of str)
        Reasons why sensors have no result, with the sensors' ids; the most common reason comes
        first.
    conformity : mapping of str to int
        Number of sensors for each result of [specification], from pass to fail; empty if there are
        no limits. Unreliable results are not counted.
    outdated : mapping of str to str
        Reasons why a new calibration might give a different result, by sensor id.
    """

    counts: Mapping[str, int]
    reasons: Sequence[tuple[str, Sequence[str]]]
    conformity: Mapping[str, int]
    outdated: Mapping[str, str]

    def as_object(self) -> dict[str, Any]:
        """Return the status as a JSON object."""
        listed = [{"reason": reason, "sensors": list(names)} for reason, names in self.reasons]
        return {
            "counts": dict(self.counts),
            "conformity": dict(self.conformity),
            "outdated": len(self.outdated),
            "reasons": listed,
        }


def line_status(line: Line, out: Path | None = None) -> LineStatus:
    """Return the status of a line.

    Parameters
    ----------
    line : Line
    out : Path, optional
        Folder with the results; by default `fleet` in the line's folder.
    """
    folder = line.folder / results.FOLDER if out is None else out
    columns = ("error", "grade", "conformity")
    rows = latest_results(line, folder, columns).to_pylist()
    counts: Counter[str] = Counter()
    reasons: dict[str, list[str]] = {}
    exact: dict[str, str] = {}
    for row in rows:
        if row["status"] == results.DONE:
            counts[GRADE_WORDS[row["grade"]]] += 1
            continue
        counts[row["status"]] += 1
        exact[row["id"]] = row["error"]
        names = reasons.setdefault(_common_reason(row), [])
        if len(names) < _NAMES:
            names.append(row["id"])
    counts["without a result yet"] = len(line.rows) - len(rows)
    outdated = {row["id"]: row[OUTDATED] for row in rows if row[OUTDATED]}
    ranked = [
        (exact[names[0]] if len(names) == 1 else reason, names)
        for reason, names in sorted(reasons.items(), key=lambda item: -len(item[1]))
    ]
    judged = Counter(
        row["conformity"]
        for row in rows
        if row["status"] == results.DONE and row["grade"] != "unreliable"
    )
    conformity = {result: judged[result] for result in RESULTS if judged[result]}
    shown = {what: n for what, n in counts.items() if n}
    return LineStatus(shown, ranked, conformity, outdated)


def _common_reason(row: Mapping[str, Any]) -> str:
    """Return the reason without the sensor's name, which allows equal reasons to be combined."""
    text = str(row["error"]).replace(row["recording"], "…")
    return text.replace(row["id"], "…")
