"""Find the roles of a recording's columns from statements, names or values."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from json import dumps
from pathlib import Path
from typing import Any

import numpy as np

from inercal.basics.arrays import Array
from inercal.basics.errors import InputError
from inercal.pipeline.drafts.column_names import (
    column_unit,
    has_axes,
    in_axis_order,
    is_other_quantity,
    named_triads,
    plain_name,
    role_of_name,
    time_unit,
)
from inercal.pipeline.drafts.column_values import (
    FEWEST_SAMPLES,
    accelerometers_by_values,
    aligned_triads,
    clock_by_values,
    columns_of_numbers,
    counts,
    counts_rows,
    follows_rate,
    grows,
    gyros_by_values,
    has_even_steps,
    never_falls,
    reason_without_gyros,
    value_reason,
)
from inercal.recordings.data.rest_marks import planned_name
from inercal.recordings.io.column_table import Table, shorten

NO_GYROS = "no gyros"
"""Key for the reason why columns that look like gyros are not used."""

NO_LABEL = "no label"
"""Key for the reason why a column of text, or one that is named like labels, is ignored."""

NO_MARKS = "no marks"
"""Key for the reason why a file of marks beside the log is not used."""

STATED = "as stated"
"""Reason for a column that the user states."""

NO_SENSOR = "no sensor"
"""Key for the files of other sensors, such as magnetometers, which are not used."""

BY_HAND = (
    "write the run file by hand, as the page “Calibrate one axis, or a cluster of axes” of the "
    "documentation shows"
)
"""Advice for columns for which no run file can be drafted."""

_TABLE = ("outer", "middle", "inner")
_ATTITUDE = ("psi", "theta")
_TRIADS = ("accelerometer", "gyro")
_LOGS = ("ulog", "dataflash", "rosbag")  # formats that contain samples in SI units
_FEWEST_POSES = 6  # rows of a table of means whose columns have other names
_MOVED_BY_BENCH = {"angle", "arm_rate", "mounting", "hold"}
_SI = {"accelerometer": "m/s²", "gyro": "rad/s"}
_FEWEST_LABELS, _MOST_LABELS = 2, 1000
_LABEL_STRETCH = 20  # samples in a typical stretch
_LABELS_AT_REST = 4  # labels whose stretches are at rest
_COMBINED = 0.1  # scatter of a column that the triad does not explain, relative to its own
_STILL = 0.05  # scatter of a stretch at rest, relative to the range of the recording
_DATE = re.compile(r"\d{1,4}([-/.]\d{1,2}[-/.]\d{1,4}(\b|T).*|:\d{2}\b.*)")
_ABSENT = ("", "nan", "none")


@dataclass(frozen=True)
class ColumnRoles:
    """The roles of the columns of a recording.

    Parameters
    ----------
    triads : mapping of "accelerometer" or "gyro" to tuple of str
        Columns of each triad, by axis.
    single : mapping of str to str
        Column for each role: "time", "label", "temperature", "arm_rate", "angle", ….
    table, attitude : tuple of str
        Columns with a turntable's angles, outermost first, and with ψ and θ on a centrifuge.
    table_file : str
        Path of the file with a turntable's angles, if they are in a separate file.
    reasons : mapping of str to str
        How each role was recognised.
    units : mapping of str to str
        Unit stated in the column's name, for each role.
    means : bool
        Whether the rows are means instead of samples.
    marks : str
        The key `marks`: "labels" if each of several files is a section, "found" for other files
        with the same columns, or the path of a file of marks; empty if it is not needed.
    parts : tuple of (start, stop)
        Samples of each of these files, or of each mark.
    rates : tuple of float
        Rate of a table in each of these files, rad/s, if their names state it; 0 for a rest.
    """

    triads: Mapping[str, tuple[str, ...]]
    single: Mapping[str, str]
    table: tuple[str, ...] = ()
    attitude: tuple[str, ...] = ()
    table_file: str = ""
    reasons: Mapping[str, str] = field(default_factory=dict[str, str])
    units: Mapping[str, str] = field(default_factory=dict[str, str])
    means: bool = False
    marks: str = ""
    parts: tuple[tuple[int, int], ...] = ()
    rates: tuple[float, ...] = ()

    def because(self, reasons: Mapping[str, str], **changes: Any) -> "ColumnRoles":
        """Return the roles with further reasons and other changes."""
        return replace(self, reasons={**self.reasons, **reasons}, **changes)


def recognise_columns(
    table: Table,
    reader: str = "text",
    stated: Mapping[str, tuple[str, ...]] | None = None,
    *,
    incomplete: bool = False,
) -> ColumnRoles:
    """Return the roles of a table's columns.

    Parameters
    ----------
    table : Table
    reader : str
        Name of the reader; some formats state units and contain only samples.
    stated : mapping of str to tuple of str, optional
        Columns that the user states, by role.
    incomplete : bool
        Whether one or two axes of a kind are enough.
    """
    stated = stated or {}
    taken = {name for columns in stated.values() for name in columns}
    names = [name for name in table.names if name not in taken]
    numbers = [name for name in names if table.columns[name].dtype.kind != "U"]
    texts = [name for name in names if table.columns[name].dtype.kind == "U"]
    reasons, units = dict[str, str](), dict[str, str]()
    named = named_triads(numbers, reasons, units, incomplete) if table.header else {}
    triads = {kind: named[kind] for kind in _TRIADS if kind in named and kind not in stated}
    used = {name for columns in triads.values() for name in columns}
    single: dict[str, str] = {}
    if table.header:
        single = _named_columns([n for n in names if n not in used], table, reasons)
    triads |= {kind: stated[kind] for kind in _TRIADS if kind in stated}
    single |= {role: columns[0] for role, columns in stated.items() if role not in _TRIADS}
    reasons |= dict.fromkeys(stated, STATED)
    by_lower = {plain_name(name): name for name in table.names}
    angles = tuple(by_lower[name] for name in _TABLE if name in by_lower)
    attitude = tuple(by_lower[name] for name in _ATTITUDE if name in by_lower)
    free = [n for n in numbers if n not in {*used, *single.values(), *angles, *attitude}]
    if not table.header:
        first, known = free[0] if free else None, set(triads)
        if "time" not in single and first and grows(table, first) and has_even_steps(table, first):
            single["time"], reasons["time"] = free.pop(0), "it increases in equal steps"
        _judge_unknown(table, free, triads, single, reasons)
        if "accelerometer" not in triads and not known:
            triads |= aligned_triads(table, free, reasons)
    elif reader not in _LOGS and not single.keys() & {"angle", "arm_rate", "mounting"}:
        _judge_unknown(table, free, triads, single, reasons)
    if "time" in single and (unit := time_unit(single["time"])) and table.header:
        units["time"] = unit
    if reader in _LOGS:
        units = {kind: unit for kind, unit in _SI.items() if kind in triads}
    left = [name for name in free if role_of_name(name) is None and not is_other_quantity(name)]
    left = [name for name in left if not counts_rows(table, name)]
    if "accelerometer" not in triads and left and single.keys() & {"angle", "arm_rate"}:
        axes = left[:3] if has_axes(left[:3]) else left[:2]
        rate = single.get("arm_rate")
        turning = len(axes) == len("xyz") and rate is not None and follows_rate(table, axes, rate)
        kind = "gyro" if turning and "gyro" not in triads else "accelerometer"
        triads[kind], reasons[kind] = in_axis_order(axes), "the remaining columns"
    means = reader not in _LOGS and table.rows < FEWEST_SAMPLES
    clock = single.get("time")
    means = means and (not has_even_steps(table, clock) or counts_rows(table, str(clock)))
    if means and clock in texts:
        del single["time"]  # the date of a mean has no role
    by_hand = means and "accelerometer" not in triads and not single.keys() & _MOVED_BY_BENCH
    if by_hand and len(left) == len("xyz") and table.rows >= _FEWEST_POSES:
        triads["accelerometer"] = in_axis_order(left)
        reasons["accelerometer"] = "the three remaining columns"
    for kind, columns in triads.items():
        if table.header and columns and (unit := column_unit(columns[0])) is not None:
            units.setdefault(kind, unit)
    if "label" not in stated:
        by_name = [single.pop("label")] if "label" in single else []
        others = [name for name in texts if name not in {*by_name, *single.values()}]
        _judge_labels(table, (*by_name, *others), triads, single, reasons, means=means)
    return ColumnRoles(
        {kind: triads[kind] for kind in _TRIADS if kind in triads},
        single,
        angles,
        attitude if len(attitude) == len(_ATTITUDE) else (),
        reasons=reasons,
        units=units,
        means=means,
    )


def _judge_labels(
    table: Table,
    names: Sequence[str],
    triads: Mapping[str, tuple[str, ...]],
    single: dict[str, str],
    reasons: dict[str, str],
    *,
    means: bool,
) -> None:
    """Add the first column that names rows or sections, and say which others are ignored."""
    force = None
    moved = single.keys() & _MOVED_BY_BENCH
    if triads.get("accelerometer") and not moved:
        force = table.stack(triads["accelerometer"])
    for name in sorted(names, key=lambda one: not any(map(planned_name, _texts(table, one)))):
        text = table.columns[name].dtype.kind == "U"
        if moved or (_names_rows(table, name) if means else _names_sections(table, name, force)):
            single["label"] = name
            reasons["label"] = "its values name the sections" if text else "by its name"
            break
    ignored = [name for name in names if name != single.get("label")]
    if ignored:
        what = "rows" if means else "sections"
        reasons[NO_LABEL] = f"ignored, because the values name no {what}: {', '.join(ignored)}"


def _named_columns(names: Sequence[str], table: Table, reasons: dict[str, str]) -> dict[str, str]:
    """Return the column of each further role, recognised by name; a clock must also increase."""
    single: dict[str, str] = {}
    for name in sorted(names, key=lambda one: role_of_name(one) == "time" and counts(table, one)):
        role = role_of_name(name)
        if role is None or role in single or (role == "time" and not grows(table, name)):
            continue
        single[role], reasons[role] = name, "by its name"
    return single


def _judge_unknown(
    table: Table,
    free: list[str],
    triads: dict[str, tuple[str, ...]],
    single: dict[str, str],
    reasons: dict[str, str],
) -> None:
    """Add the clock and the triads that cannot be recognised by name."""
    if table.rows < FEWEST_SAMPLES:
        return
    if "time" not in single and (clock := clock_by_values(table, free)) is not None:
        single["time"], reasons["time"] = clock, "it increases in equal steps"
    whole = columns_of_numbers(table)
    free = [n for n in free if n in whole and n != single.get("time")]
    free = [n for n in free if not is_other_quantity(n) and not never_falls(table, n)]
    if "accelerometer" not in triads:
        found = accelerometers_by_values(table, free)
        if found is None:
            return
        triads["accelerometer"] = in_axis_order(found)
        reasons["accelerometer"] = value_reason("accelerometer")
        free = [name for name in free if name not in found]
    accelerometers = triads["accelerometer"]
    if "gyro" not in triads and len(accelerometers) == len("xyz") and whole >= {*accelerometers}:
        found = gyros_by_values(table, free, accelerometers, need_turns=table.header)
        if found is not None:
            triads["gyro"], reasons["gyro"] = in_axis_order(found), value_reason("gyro")
        elif why := reason_without_gyros(table, free, accelerometers):
            reasons[NO_GYROS] = why


def without_sections(roles: ColumnRoles) -> ColumnRoles:
    """Return the roles without the labels or the file of marks, whose sections suit no method."""
    single = dict(roles.single)
    name = single.pop("label", Path(roles.marks).name)
    why = f"ignored, because no method suits its sections: {name}"
    return roles.because({NO_LABEL: why}, single=single, marks="", parts=())


_MOST_LISTED = 12


class UnknownAccelerometers(InputError):
    """An error because no accelerometer columns were recognised; the user may state them.

    `columns` lists the columns of numbers in the order of the file.
    """

    columns: tuple[str, ...] = ()


def without_accelerometers(
    log: Path, table: Table, roles: ColumnRoles, others: Sequence[str] = ()
) -> InputError:
    """Return the error for a recording of gyros without a triad, with the forms that are drafted.

    `others` are columns that are too few for a triad.
    """
    gyros = ", ".join(map(shorten, roles.triads.get("gyro", ()))) or "none"
    few = f"; other columns, too few for a triad: {', '.join(others)}" if others else ""
    return InputError(
        f"no three accelerometers are known (gyros: {gyros}{few}); for gyros alone on a rate "
        "table, init needs a file for each section, with names such as log_x_+50.csv and "
        "log_x_rest.csv, or a table of means with an axis, a rate and the gyros; or write the run "
        "file by hand, as the page “Calibrate gyros by constant rates, and accelerometers by "
        "poses” of the documentation shows",
        key="data.accelerometer",
        names=table.names[:_MOST_LISTED],
    ).located(log)


def unknown_accelerometers(log: Path, table: Table, roles: ColumnRoles) -> UnknownAccelerometers:
    """Return the error for a recording, with its columns and how to state those of a triad."""
    taken = set(roles.single.values())
    numbers = tuple(n for n in table.names if n not in taken and table.columns[n].dtype.kind != "U")
    if len(numbers) < len("xyz"):
        raise InputError(
            "init drafts run files for recordings with three accelerometers, for tables of means "
            "from a rate table, with an axis, a rate and the readings of one gyro or more, and "
            "for tables from a dividing head, with an angle and a reading. This file has the "
            f"columns {', '.join(map(shorten, table.names[:_MOST_LISTED]))}; {BY_HAND}",
            names=table.names,
        ).located(log)
    used = {*roles.single.values(), *(c for triad in roles.triads.values() for c in triad)}
    free = [name for name in numbers if name not in used]
    if "gyro" in roles.triads and len(free) < len("xyz"):
        raise without_accelerometers(log, table, roles, free)
    example = free if len(free) >= 3 else list(numbers)
    threes = [example[k : k + 3] for k in range(len(example) - 2)]
    likely = next((three for three in threes if has_axes(three)), example[:3])
    given = [int(n) if n.isdecimal() else n for n in likely]
    only = " only the gyros were recognised;" if "gyro" in roles.triads else ""
    listed = ", ".join(map(shorten, table.names[:_MOST_LISTED]))
    error = UnknownAccelerometers(
        f"{log}: neither names nor values show which columns are the accelerometers;{only} the "
        f"columns are {listed}{', …' * (len(table.names) > _MOST_LISTED)}. State the columns for "
        f"x, y and z, as in --set data.accelerometer='{dumps(given, ensure_ascii=False)}'",
        file=log,
        names=table.names[:_MOST_LISTED],
    )
    error.columns = numbers
    return error


def require_no_cluster(log: Path, table: Table, roles: ColumnRoles) -> None:
    """Refuse a triad, recognised without axes in its names, that belongs to a larger cluster.

    A further column belongs to it if its name differs only in the last character, and its readings
    are a combination of those of the triad.

    Raises
    ------
    InputError
    """
    for kind, triad in roles.triads.items():
        stem = {name[:-1] for name in triad}
        if roles.reasons[kind] == STATED or len(stem) > 1 or has_axes(triad) or not table.header:
            continue
        design = np.column_stack([table.stack(triad), np.ones(table.rows)])
        for name in (one for one in table.names if one[:-1] in stem and one not in triad):
            read = table.numbers(name)
            left = read - design @ np.linalg.lstsq(design, read)[0]
            if left.std() < _COMBINED * read.std():
                raise InputError(
                    f"{', '.join(triad)} and {name} look like one cluster of axes in other "
                    f"directions than x, y and z; {BY_HAND}, or state the columns of a triad, as "
                    f"in --set data.{kind}='{dumps(list(triad), ensure_ascii=False)}'",
                    key=f"data.{kind}",
                    names=(*triad, name),
                ).located(log)


def _names_sections(table: Table, name: str, force: Array | None) -> bool:
    """Return whether a column of a recording names its sections.

    Columns of text also contain frame ids, device names, status words, dates and checksums. A label
    has few values, each in one or several stretches. It names faces, axes or turns, or it changes
    where the sensor is moved: most readings within a stretch are then alike.

    Parameters
    ----------
    table : Table
    name : str
    force : (n, k) array or None
        Readings of the accelerometers, if they are known.
    """
    column = table.columns[name]
    if column.dtype.kind != "U":
        return _few_stretches(np.nan_to_num(column.astype(np.float64)), force)
    values = _texts(table, name)
    if any(map(planned_name, values)):
        return True
    return not _are_dates(values) and _few_stretches(column, force)


def _texts(table: Table, name: str) -> list[str]:
    """Return the different values of a column of text, without those that stand for no value."""
    column = table.columns[name]
    values: list[str] = np.unique(column).tolist() if column.dtype.kind == "U" else []
    return [one for one in values if one.strip().lower() not in _ABSENT]


def _are_dates(values: Sequence[str]) -> bool:
    return 2 * sum(_DATE.fullmatch(one) is not None for one in values) > len(values)


def _names_rows(table: Table, name: str) -> bool:
    """Return whether a column of a table of means names its rows: each differently, or by faces."""
    values = [str(one).strip() for one in table.columns[name].tolist()]
    differ = len(set(values)) == len(values) and not _are_dates(values)
    return differ or all(map(planned_name, values))


def _few_stretches(column: np.ndarray, force: Array | None) -> bool:
    edges = np.flatnonzero(column[1:] != column[:-1]) + 1
    spans = np.column_stack([np.append(0, edges), np.append(edges, column.size)])
    count = len(np.unique(column))
    if not _FEWEST_LABELS <= count <= _MOST_LABELS or _LABEL_STRETCH * len(spans) > column.size:
        return False
    if force is None:
        return True
    reach = np.ptp(np.quantile(force, (0.001, 0.999), axis=0), axis=0).max()
    still = {
        str(column[a])
        for a, b in spans.tolist()
        if b - a > 2 and force[a:b].std(axis=0).max() <= _STILL * reach
    }
    return len(still) >= _LABELS_AT_REST
