"""Report the progress of a line: sensors by status and grade, and why results are missing."""

from collections import Counter
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import comb
from os.path import relpath
from pathlib import Path
from typing import Any

import numpy as np

from inercal.basics.units import format_count, format_number
from inercal.calibration.grade import GRADE_WORDS
from inercal.estimation.uncertainty.conformity import RESULTS
from inercal.estimation.uncertainty.robust import robust_scale
from inercal.fleet import results
from inercal.fleet.inputs import is_address
from inercal.fleet.latest import OUTDATED, latest_results
from inercal.fleet.line import RECORDING, Line
from inercal.recordings.io.file_patterns import is_pattern

_NAMES = 1000  # largest number of sensors listed for a reason
_LINES = 10  # largest number of printed lines of a kind
_RECORDING = "\0"  # stands for the recording in a reason that sensors share
_NAMED, _SOME = 6, 3  # largest number of names in a line, and how many of more names are listed
_LEAST_ALIKE = 5  # smallest number of sensors whose U is compared
_BY_CHANCE = 0.05  # largest probability that sensors chosen at random share a value
_LARGE, _SCATTER = 3.0, 5.0  # an unusual U: times the median, robust standard deviations of log U
STATUS_COLUMNS = (
    "error", "grade", "conformity", "beyond", "verdict", "coefficients", "std", "readings",
)  # fmt: skip
"""Columns that `table_status` needs in addition to those that decide which result is valid."""

_USED = ("id", "status", "error", "grade", "conformity", "beyond", "recording", "readings")


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
        no limits. Unreliable results and those of `same_recording` are not counted.
    outdated : mapping of str to str
        Reasons why a new calibration might give a different result, by sensor id.
    unreliable : mapping of str to str
        The main reason why a result is not to be relied on, by sensor id.
    same_recording : sequence of (sequence of str)
        Ids of sensors that were calibrated from the same columns of identical recordings.
    reservations : mapping of str to str
        The main reason why a result is usable with reservations only, by sensor id.
    failing : mapping of str to str
        The result of [specification] of each sensor that fails it, by sensor id.
    beyond : mapping of str to str
        Names of the coefficients that are beyond their limits, separated by commas, by the id of
        each sensor in `failing`.
    large_u : mapping of str to (str, float)
        The coefficient whose U is unusually large and the ratio of this U to the median of the
        line, by sensor id.
    common : sequence of str
        Sentences on values of columns that may explain the sensors that need attention.
    unlisted : sequence of str
        Files beside the recordings that are not in the table.
    """

    counts: Mapping[str, int]
    reasons: Sequence[tuple[str, Sequence[str]]]
    conformity: Mapping[str, int]
    outdated: Mapping[str, str]
    unreliable: Mapping[str, str]
    same_recording: Sequence[Sequence[str]]
    reservations: Mapping[str, str]
    failing: Mapping[str, str]
    beyond: Mapping[str, str]
    large_u: Mapping[str, tuple[str, float]]
    common: Sequence[str] = ()
    unlisted: Sequence[str] = ()

    def as_object(self) -> dict[str, Any]:
        """Return the status as a JSON object."""
        listed = [{"reason": reason, "sensors": list(names)} for reason, names in self.reasons]
        return {
            "counts": dict(self.counts),
            "conformity": dict(self.conformity),
            "outdated": len(self.outdated),
            "reasons": listed,
            "unreliable": dict(self.unreliable),
            "same_recording": [list(names) for names in self.same_recording],
            **self.named_sensors(),
        }

    def named_sensors(self) -> dict[str, Any]:
        """Return the sensors with usable results that need attention, as JSON objects by kind.

        Also return what these sensors have in common, and recordings without a sensor.
        """
        large = {k: {"coefficient": of, "ratio": r} for k, (of, r) in self.large_u.items()}
        return {
            "reservations": dict(self.reservations), "failing": dict(self.failing),
            "beyond": {name: of.split(", ") for name, of in self.beyond.items()},
            "large_u": large,
            "common": list(self.common), "unlisted": list(self.unlisted),
        }  # fmt: skip

    def attention_lines(self) -> list[str]:
        """Return lines that name the sensors that need attention, and repeated recordings."""
        bad = [f"{name} is not to be relied on: {why}" for name, why in self.unreliable.items()]
        alike = [
            f"{_some(names)} were calibrated from the same readings; check the column {RECORDING}"
            for names in self.same_recording
        ]
        failed = [f"{_some(names)}: {reason}" for reason, names in self.reasons]
        kept = [
            f"{_some(names)}: usable with reservations: {why}"
            for why, names in _by_value(self.reservations).items()
        ]
        failing = {
            name: f"{result} by [specification]: {self.beyond[name]}"
            for name, result in self.failing.items()
        }
        beyond = [f"{_some(names)}: {text}" for text, names in _by_value(failing).items()]
        large = [
            f"{name}: U of {of} is {format_number(ratio, 2)} times the median of the line"
            for name, (of, ratio) in self.large_u.items()
        ]
        return [
            *_first(failed, "reason for a missing result", "reasons for missing results"),
            *_first(bad, "sensor is not to be relied on", "sensors are not to be relied on"),
            *_first(
                beyond, "combination of limits is not met", "combinations of limits are not met"
            ),
            *_first(kept, "reason for reservations", "reasons for reservations"),
            *_first(large, "sensor has a large U", "sensors have a large U"),
            *_first(
                alike, "recording is used more than once", "recordings are used more than once"
            ),
            *self.common,
            *([f"not in the table of sensors: {_some(self.unlisted)}"] if self.unlisted else []),
        ]


def _some(names: Sequence[str]) -> str:
    """Return the first names of a list, and the number of the others."""
    if len(names) > _NAMED:
        return f"{', '.join(names[:_SOME])} and {len(names) - _SOME} more"
    return " and ".join(filter(None, (", ".join(names[:-1]), names[-1])))


def _by_value(found: Mapping[str, str]) -> dict[str, list[str]]:
    names: dict[str, list[str]] = {}
    for name, value in found.items():
        names.setdefault(value, []).append(name)
    return names


def _first(lines: Sequence[str], one: str, several: str) -> list[str]:
    more = len(lines) - _LINES
    others = format_count(more, f"more {one}", f"more {several}")
    return [*lines[:_LINES], *[f"{others}; inercal fleet status --json lists all"] * (more > 0)]


def line_status(line: Line, out: Path | None = None) -> LineStatus:
    """Return the status of a line.

    Parameters
    ----------
    line : Line
    out : Path, optional
        Folder with the results; by default `fleet` in the line's folder.
    """
    folder = line.folder / results.FOLDER if out is None else out
    return table_status(line, latest_results(line, folder, STATUS_COLUMNS))


def table_status(line: Line, table: results.Table) -> LineStatus:
    """Return the status of a line from its valid results (`latest_results`)."""
    pc: Any = results.arrow("pyarrow.compute")
    # Verdicts are long texts, so only those of the doubtful results are converted.
    doubtful = table.filter(pc.field("grade") != "consistent")
    why: dict[str, dict[str, str]] = {grade: {} for grade in GRADE_WORDS}
    for row in doubtful.select(["id", "grade", "verdict"]).to_pylist():
        first = row["verdict"].partition("\n")[0].partition(": ")[2]
        why[row["grade"]][row["id"]] = first.removesuffix(".")
    rows = table.select([*_USED, OUTDATED]).to_pylist()
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
    recordings = {row["id"]: row["recording"] for row in rows}
    ranked = [
        (
            exact[names[0]]
            if len(names) == 1
            else reason.replace(_RECORDING, _some([recordings[name] for name in names])),
            names,
        )
        for reason, names in sorted(reasons.items(), key=lambda item: -len(item[1]))
    ]
    same = same_recordings(line, rows)
    shared = shared_with(same)
    usable = {
        row["id"]: row["conformity"]
        for row in rows
        if row["status"] == results.DONE and row["grade"] != "unreliable" and row["conformity"]
        and row["id"] not in shared
    }  # fmt: skip
    judged = Counter(usable.values())
    conformity = {result: judged[result] for result in RESULTS if judged[result]}
    shown = {what: n for what, n in counts.items() if n}
    failing = {name: result for name, result in usable.items() if result.endswith("fail")}
    named = {row["id"]: ", ".join((row["beyond"] or "").split()) for row in rows}
    kinds = {
        "have no result": exact, "are not to be relied on": why["unreliable"],
        "fail [specification]": failing,
    }  # fmt: skip
    return LineStatus(
        shown, ranked, conformity, outdated, why["unreliable"], same,
        why["reservations"], failing, {name: named[name] for name in failing}, _large_u(table),
        tuple(one for kind, of in kinds.items() for one in _common_values(line, kind, of)),
        _unlisted_files(line),
    )  # fmt: skip


def _common_values(line: Line, kind: str, named: Collection[str]) -> Iterator[str]:
    """Yield the values that all named sensors share, where chance makes this improbable."""
    count, of = len(named), len(line.rows)
    for column in line.columns if count > 1 else ():
        values = {row.id: row.columns.get(column, "").partition("T")[0] for row in line.rows}
        shared = {values.get(name, "") for name in named}
        among = sum(value in shared for value in values.values())
        by_chance = comb(among, count) / comb(of, count)
        if len(shared) == 1 and shared != {""} and by_chance < _BY_CHANCE:
            same = f"{column} {shared.pop()}; so do {among} of all {of} sensors"
            yield f"all {count} sensors that {kind} have {same}"


def _unlisted_files(line: Line) -> tuple[str, ...]:
    """Return the files in the folders of the recordings, and like them, that have no row."""
    paths = {line.folder / row.recording for row in line.rows if not is_address(row.recording)}
    # The folder of the line also contains other tables, and a pattern stands for several files.
    beside = {(one.parent, one.suffix) for one in paths if one.parent != line.folder}
    if any(map(is_pattern, paths)):
        return ()
    found = (one for folder, suffix in beside for one in folder.glob(f"*{suffix}"))
    return tuple(sorted(relpath(one, line.folder) for one in found if one not in paths))


def _large_u(table: results.Table) -> dict[str, tuple[str, float]]:
    """Return the sensors whose U is unusually large, compared with that of similar sensors."""
    pc: Any = results.arrow("pyarrow.compute")
    done = table.filter((pc.field("status") == results.DONE) & (pc.field("grade") != "unreliable"))
    found: dict[str, tuple[str, float]] = {}
    for names in pc.unique(done["coefficients"]).to_pylist():
        alike = done.filter(pc.field("coefficients") == names)
        if len(alike) < _LEAST_ALIKE:
            continue
        std = results.matrix(alike["std"], len(names.split()))
        known = np.flatnonzero((std > 0).all(axis=0))
        log = np.log(std[:, known])
        log -= np.median(log, axis=0)
        excess = log / np.maximum(np.log(_LARGE), _SCATTER * robust_scale(log))
        for row in np.flatnonzero(excess.max(axis=1, initial=0.0) > 1).tolist():
            k = int(np.argmax(excess[row]))
            name = names.split()[known[k]]
            found[alike["id"][row].as_py()] = (name, float(np.exp(log[row, k])))
    return found


def same_recordings(line: Line, rows: Sequence[Mapping[str, Any]]) -> list[list[str]]:
    """Return the sensors that share readings; sensors that share a hash share the list of names."""
    alike: dict[str, list[str]] = {}
    done = {row["id"]: row["readings"] or () for row in rows if row["status"] == results.DONE}
    for name in (one.id for one in line.rows if one.id in done):
        names = next((alike[key] for key in done[name] if key in alike), list[str]())
        names.append(name)
        alike |= {key: alike.get(key, names) for key in done[name]}
    return [names for names in {id(one): one for one in alike.values()}.values() if len(names) > 1]


def shared_with(groups: Iterable[Sequence[str]]) -> dict[str, str]:
    """Return the other sensors with the same readings, separated by commas, by sensor id."""
    return {
        name: ", ".join(one for one in names if one != name) for names in groups for name in names
    }


def _common_reason(row: Mapping[str, Any]) -> str:
    """Return the reason without the sensor's name, which allows equal reasons to be combined."""
    text = str(row["error"]).replace(row["recording"], _RECORDING)
    return text.replace(row["id"], "…")
