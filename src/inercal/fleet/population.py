"""Collect the calibrated sensors of a line as arrays, for the statistics."""

import json
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from math import nan
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from inercal.basics.arrays import Array
from inercal.basics.errors import InputError
from inercal.calibration.specification import Specification
from inercal.estimation.uncertainty.conformity import RESULTS, DecisionRule
from inercal.fleet import results
from inercal.fleet.latest import OUTDATED, latest_results
from inercal.fleet.line import Line
from inercal.fleet.status import STATUS_COLUMNS, LineStatus, shared_with, table_status
from inercal.physics.sensors.coefficient_tables import ErrorTerm

Indices = NDArray[np.intp]
Mask = NDArray[np.bool_]
_COLUMNS = (
    *STATUS_COLUMNS, "lot", "station", "measured", "value", "chi2", "dof",
)  # fmt: skip
_DAY = 86_400.0  # s
_WAITING = "without a result yet"


@dataclass(frozen=True)
class Grouping:
    """Assignment of each sensor to a group.

    Parameters
    ----------
    names : tuple of str
        Names of the groups, in the order of their first sensors.
    places : (n,) array of int
        Index of each sensor's group.
    """

    names: tuple[str, ...]
    places: Indices

    @property
    def several(self) -> bool:
        """Return whether there is more than one group."""
        return len(self.names) > 1


@dataclass(frozen=True)
class Population:
    """The calibrated sensors of a line, in the order of its table.

    Parameters
    ----------
    ids : tuple of str
    names : tuple of str
        Names of the p coefficients.
    terms : tuple of ErrorTerm
        Error term of each coefficient, with its unit.
    value, std : (n, p) arrays
        Values and standard uncertainties in SI units.
    lots, stations : Grouping
    days : (n,) array
        Time of the measurement, days since 1970; NaN if no time is stated.
    chi2, dof : (n,) arrays
        χ² of the residuals, and its degrees of freedom.
    specification : Specification or None
        Specification in the template; None if the limits differ from sensor to sensor.
    judged : (DecisionRule, mapping of str to int) or None
        If the limits differ from sensor to sensor: the decision rule of the first sensor, and the
        number of sensors by result.
    left_out : mapping of str to int
        Number of sensors that are not included in the arrays, by reason.
    outdated : int
        Number of results that a new calibration might change.
    status : LineStatus
        Status of all sensors of the line.
    """

    ids: tuple[str, ...]
    names: tuple[str, ...]
    terms: tuple[ErrorTerm, ...]
    value: Array
    std: Array
    lots: Grouping
    stations: Grouping
    days: Array
    chi2: Array
    dof: Array
    specification: Specification | None
    judged: tuple[DecisionRule, dict[str, int]] | None
    left_out: dict[str, int]
    outdated: int
    status: LineStatus

    @property
    def unjudged(self) -> int:
        """Number of sensors that were calibrated or failed, but are not in the arrays."""
        return sum(count for reason, count in self.left_out.items() if reason != _WAITING)


def read_population(line: Line, folder: Path) -> Population:
    """Read the results of a line.

    Parameters
    ----------
    line : Line
    folder : Path
        Folder with the parts.

    Raises
    ------
    InputError
        There are no results, or no sensor has a calibration.
    """
    table = latest_results(line, folder, _COLUMNS)
    line_status = table_status(line, table)
    place = {row.id: k for k, row in enumerate(line.rows)}
    known = [place.get(name, -1) for name in table["id"].to_pylist()]
    status, sets = table["status"].to_pylist(), table["coefficients"].to_pylist()
    shared = shared_with(line_status.same_recording)
    done = [
        k >= 0 and one == results.DONE and grade != "unreliable" and name not in shared
        for k, one, grade, name in zip(
            known, status, table["grade"].to_pylist(), table["id"].to_pylist(), strict=True
        )
    ]
    counted = Counter(one for one, good in zip(sets, done, strict=True) if good)
    if not counted:
        raise InputError(
            f"{folder} contains no calibrated sensor; calibrate the line first", file=folder
        )
    usual = counted.most_common(1)[0][0]
    chosen = np.array([good and one == usual for good, one in zip(done, sets, strict=True)])
    rows = np.flatnonzero(chosen)
    rows = rows[np.argsort(np.array(known)[rows], kind="stable")]
    table = table.take(rows)
    names = tuple(usual.split())
    run = line.run(line.rows[0])
    # The template may have changed since the calibration, and may now estimate other coefficients.
    sensor = run.sensor.with_coefficients(*names)
    specification, judged = run.specification, None
    if specification is not None and _limits_differ(line):
        reached: list[str | None] = table["conformity"].to_pylist()
        judged = specification.rule, {result: reached.count(result) for result in RESULTS}
        specification = None
    return Population(
        tuple(table["id"].to_pylist()),
        names,
        tuple(sensor.coefficient(name) for name in names),
        results.matrix(table["value"], len(names)),
        results.matrix(table["std"], len(names)),
        _grouping(table["lot"].to_pylist()),
        _grouping(table["station"].to_pylist()),
        np.array([_days(text) for text in table["measured"].to_pylist()]),
        _numbers(table["chi2"]),
        _numbers(table["dof"]),
        specification,
        judged,
        _left_out(len(line.rows), known, status, done, len(rows)),
        sum(map(bool, table[OUTDATED].to_pylist())),
        line_status,
    )


def _left_out(
    sensors: int, known: Sequence[int], status: Sequence[str], done: Sequence[bool], kept: int
) -> dict[str, int]:
    ours = [one for k, one in zip(known, status, strict=True) if k >= 0]
    calibrated = sum(one == results.DONE for one in ours)
    counts = {
        _WAITING: sensors - len(ours),
        "failed or lost": len(ours) - calibrated,
        "not to be relied on": calibrated - sum(done),
        "with other coefficients": sum(done) - kept,
    }
    return {reason: count for reason, count in counts.items() if count}


def _limits_differ(line: Line) -> bool:
    """Return whether the table of sensors contains values for [specification]."""
    stated = json.dumps(line.template.get("specification", {}))
    columns = line.rows[0].columns
    return any(f"{{{name}" in stated for name in line.placeholders) or any(
        name.startswith("specification.") for name in columns
    )


def _numbers(column: Any) -> Array:
    return np.asarray(column.to_numpy(), dtype=float)


def _grouping(texts: Sequence[str | None]) -> Grouping:
    places: dict[str, int] = {}
    found = [places.setdefault(text or "", len(places)) for text in texts]
    return Grouping(tuple(places), np.array(found, dtype=np.intp))


def _days(text: str | None) -> float:
    try:
        time = datetime.fromisoformat((text or "").strip())
    except ValueError:
        return nan
    return (time if time.tzinfo else time.replace(tzinfo=UTC)).timestamp() / _DAY
