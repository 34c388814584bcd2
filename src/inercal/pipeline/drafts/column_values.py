"""Recognise the columns of a recording by their values, if their names do not help.

Accelerometers at rest measure gravity: their readings differ from attitude to attitude and lie on a
sphere. Gyros at rest read the same in all attitudes, and between two attitudes their rotation
agrees with that of gravity.

Rows without a finite number are ignored here; later they are refused with the name of their column.
"""

from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from inercal.basics.arrays import Array
from inercal.basics.errors import InputError
from inercal.basics.units import format_count
from inercal.pipeline.drafts import readouts
from inercal.pipeline.drafts.column_names import time_unit
from inercal.pipeline.drafts.quiet_sections import find_quiet_sections, rest_means
from inercal.recordings import Indices
from inercal.recordings.io.column_table import Table
from inercal.recordings.io.mean_tables import number_column
from inercal.recordings.io.row_checks import is_usable
from inercal.recordings.io.time_stamps import SLOWEST_HZ, is_iso_time, times_from_iso
from inercal.recordings.segments.gravity_turns import name_columns

FEWEST_SAMPLES = 500
"""Fewest rows of a recording; a table with fewer rows contains means."""

_AXES = 3
_NAMES = ("ax", "ay", "az", "gx", "gy", "gz")
_MOVED = 20.0  # least range of a gyro between rests, in units of its scatter at rest
_PROPORTIONAL = 0.999  # correlation
_MOST_NUMBERED = 200  # rows of a table of means whose rows are numbered
_EVEN_STEPS = 0.5  # largest 90 % deviation of a clock's steps, as a fraction of the median step
_LARGEST_G = 2.0  # reading of gravity in g
_WINDOWS = (50, 20)  # samples in a window of a rest, for fast and slow sampling
_FEWEST_RESTS = 4
_MANY_RESTS = 12
_MOST_MISFIT = 0.1  # of the radius: bias and scale errors of a plain MEMS sensor
_AS_GOOD = 4.0  # times the least misfit, because accelerometers come before magnetometers
_GOOD = 0.03  # of the radius: scale errors and misalignments
_SPREAD = 0.25  # fraction of the range in motion


def grows(table: Table, name: str) -> bool:
    """Return whether a column may be a clock: dates, or numbers that never go back by much."""
    column = table.columns[name]
    if column.dtype.kind == "U":
        changes = column[1:] != column[:-1]  # most dates in whole seconds repeat
        return changes.size > 0 and is_iso_time(str(column[0])) and bool(np.median(changes) > 0)
    steps = np.diff(column.astype(np.float64))
    return steps.size > 0 and bool(np.median(steps) > 0)


def columns_of_numbers(table: Table) -> set[str]:
    """Return the columns that contain a finite number in each row."""
    return {name for name, bad in _bad_rows(table, table.names) if not bad.any()}


def never_falls(table: Table, name: str) -> bool:
    """Return whether a column of numbers never decreases, like times and counters."""
    steps = np.diff(table.columns[name].astype(np.float64))
    return steps.size > 0 and bool(np.all(steps >= 0)) and bool(np.any(steps > 0))


def has_even_steps(table: Table, name: str | None) -> bool:
    """Return whether a column of times has equal steps, like samples at a constant rate."""
    if name is None:
        return False
    column = table.columns[name]
    dated = column.dtype.kind == "U"
    try:
        stamps = times_from_iso(column.tolist(), name, table)[0] if dated else column
    except InputError:
        return False
    steps = np.diff(stamps.astype(np.float64))
    if steps.size < 2 * _AXES:
        return False
    typical = float(np.median(steps))
    if dated and typical > 1 / SLOWEST_HZ:
        return False  # dates of means, not of samples
    return typical > 0 and float(np.quantile(np.abs(steps / typical - 1), 0.9)) < _EVEN_STEPS


def counts(table: Table, name: str) -> bool:
    """Return whether a column counts samples, so that a column of times tells more."""
    column = table.columns[name]
    if column.dtype.kind == "U" or time_unit(name):
        return False
    return column.size > 1 and bool(np.median(np.diff(column.astype(np.float64))) == 1)


def counts_rows(table: Table, name: str) -> bool:
    """Return whether a column of a short table is 1, 2, 3, … and so only numbers its rows."""
    column = table.columns[name]
    if column.dtype.kind == "U" or not 1 < column.size <= _MOST_NUMBERED:
        return False
    return column[0] in (0, 1) and bool(np.all(np.diff(column.astype(np.float64)) == 1))


def follows_rate(table: Table, names: Sequence[str], rate: str) -> bool:
    """Return whether the norm of three columns is proportional to a rate, as that of gyros is."""
    norm = np.linalg.norm(table.stack(names), axis=-1)
    speed = np.abs(table.numbers(rate))
    usable = np.isfinite(norm) & np.isfinite(speed)
    norm, speed = norm[usable], speed[usable]
    if norm.size < _AXES or not np.ptp(norm) or not np.ptp(speed):
        return False
    return float(np.corrcoef(norm, speed)[0, 1]) > _PROPORTIONAL


def clock_by_values(table: Table, names: Sequence[str]) -> str | None:
    """Return the column of a recording that increases in equal steps, if there is one.

    Dates come first, because a column of numbers may be a counter.
    """
    dates = [n for n in table.names if table.columns[n].dtype.kind == "U" and grows(table, n)]
    found = [n for n in names if never_falls(table, n)]
    return next((n for n in (*dates, *found) if has_even_steps(table, n)), None)


def accelerometers_by_values(table: Table, names: Sequence[str]) -> tuple[str, ...] | None:
    """Return the three neighbouring columns whose readings at rest lie on a sphere.

    A magnetometer's also do, but motion moves only the accelerometers' readings off their sphere.
    """
    found: list[tuple[float, tuple[str, ...], float]] = []
    for triple in _neighbours(table, names):
        data = table.stack(triple)
        means = rest_means(_quiet(data), data, None).force
        if len(means) < _FEWEST_RESTS or np.ptp(means, axis=0).max() <= _SPREAD * _reach(data):
            continue
        misfit = readouts.norm_misfit(means)
        if misfit < _MOST_MISFIT:
            found.append((misfit, triple, readouts.off_sphere(means, data) - misfit))
    best = min((misfit for misfit, _, _ in found), default=0.0)
    found = [one for one in found if one[0] <= max(_AS_GOOD * best, _GOOD)]
    found = [one for one in found if _reads_gravity(table.stack(one[1]))] or found
    moved = max((off for _, _, off in found), default=0.0)
    return next((triple for _, triple, off in found if _AS_GOOD * off >= moved), None)


def _reads_gravity(data: Array) -> bool:
    """Return whether the typical norm of readings is that of gravity in a usual unit."""
    return readouts.gravity_unit(float(np.nanmedian(np.linalg.norm(data, axis=1)))) is not None


def gyros_by_values(
    table: Table, names: Sequence[str], accelerometers: Sequence[str], *, need_turns: bool
) -> tuple[str, ...] | None:
    """Return three neighbouring columns whose rotation between rests agrees with gravity.

    If no turns show this and `need_turns` is false, return the columns that respond most to motion
    among those that read the same in all attitudes.
    """
    force = table.stack(accelerometers)
    found: list[tuple[float, tuple[str, ...]]] = []
    moved: list[tuple[float, tuple[str, ...]]] = []
    for triple in _neighbours(table, names):
        data = table.stack(triple)
        spans = _quiet(np.hstack([force, data]))
        if len(spans) < 2:
            continue
        rests = rest_means(spans, force, data)
        assert rests.rate is not None
        reach = _reach(data)
        if not reach or np.ptp(rests.rate, axis=0).max() > _SPREAD * reach:
            continue
        moved.append((_motion(data, spans), triple))
        size, _, misfit = readouts.gyro_scale(rests, data, 0.0)
        if size is not None:
            found.append((misfit, triple))
    if found or need_turns:
        return min(found)[1] if found else None
    return max(moved)[1] if moved else None


def reason_without_gyros(table: Table, names: Sequence[str], accelerometers: Sequence[str]) -> str:
    """Return why columns that look like gyros are not used; empty if there are no such columns."""
    force = table.stack(accelerometers)
    triples = _neighbours(table, names)
    if not triples and len(names) == _AXES - 1 and _moves_alike(table, names, force):
        return f"{' and '.join(names)} look like gyros, but a third is missing"
    for triple in triples:
        if not _moves_alike(table, triple, force):
            continue
        data = table.stack(triple)
        spans = _quiet(np.hstack([force, data]))
        turns = readouts.turns_of_readings(rest_means(spans, force, data), data, 0.0)
        if turns is None:
            continue
        columns: dict[str, str] = dict(zip(_NAMES, (*accelerometers, *triple), strict=True))
        changes = [name_columns(one, columns) for one in readouts.axis_changes(turns)]
        first, last = triple[0], triple[-1]
        text = (
            f"{first} to {last} look like gyros, but disagree with gravity in "
            f"{format_count(len(turns.angles), 'turn')} between rests"
        )
        return text + f"; they agree if {', or if '.join(changes)}" * bool(changes)
    return ""


def _moves_alike(table: Table, names: Sequence[str], force: Array) -> bool:
    """Return whether columns read the same at all rests and all of them change in between."""
    data = table.stack(names)
    spans = _quiet(np.hstack([force, data]))
    reach = _reach(data)
    if len(spans) < _FEWEST_RESTS or not reach:
        return False
    means = rest_means(spans, data, None).force
    return bool(np.ptp(means, axis=0).max() <= _SPREAD * reach) and _motion(data, spans) > _MOVED


def aligned_triads(
    table: Table, names: Sequence[str], reasons: dict[str, str]
) -> dict[str, tuple[str, ...]]:
    """Tell the triads among the first six columns apart by whether their rest readings differ."""
    triples = [tuple(names[k : k + 3]) for k in range(0, len(names) - len(names) % 3, 3)][:2]
    found = [(columns, _varies_between_rests(table, columns)) for columns in triples]
    if not any(varies for _, varies in found):
        return _still_triads(table, triples, reasons)
    triads: dict[str, tuple[str, ...]] = {}
    for kind, wanted in (("accelerometer", True), ("gyro", False)):
        match = [columns for columns, varies in found if varies == wanted]
        if match:
            triads[kind], reasons[kind] = match[0], value_reason(kind)
    return triads


def _still_triads(
    table: Table, triples: Sequence[tuple[str, ...]], reasons: dict[str, str]
) -> dict[str, tuple[str, ...]]:
    """Tell the triads of a sensor that did not move apart by gravity; {} if they may be others."""
    norms = [float(np.linalg.norm(np.median(table.stack(one), axis=0))) for one in triples]
    gravity = [readouts.gravity_unit(norm) is not None for norm in norms]
    # Counts have no size of their own, and a triad that reads 1 may be gyros biased by 1 °/s.
    if len(triples) == 1:
        clear = norms[0] > _LARGEST_G if gravity[0] else norms[0] < readouts.FEWEST_COUNTS
    else:
        clear = gravity.count(True) == 1
    if not clear:
        return {}
    triads = {
        "accelerometer" if g else "gyro": one for g, one in zip(gravity, triples, strict=True)
    }
    reasons |= dict.fromkeys(triads, "only accelerometers read gravity while the sensor rests")
    return triads


def value_reason(kind: str) -> str:
    """Return the reason by which a triad is recognised."""
    what = (
        "change with the attitude" if kind == "accelerometer" else "are the same in all attitudes"
    )
    return f"their readings at rest {what}"


def _quiet(data: Array) -> Indices:
    """Return the quiet sections of readings whose rate is not known."""
    found = (find_quiet_sections(data, window) for window in _WINDOWS)
    return max(found, key=lambda spans: min(len(spans), _MANY_RESTS))


def _neighbours(table: Table, names: Sequence[str]) -> list[tuple[str, ...]]:
    """Return all triples of columns that are side by side in the file."""
    place = {name: k for k, name in enumerate(table.names)}
    triples = (tuple(names[k : k + _AXES]) for k in range(len(names) - _AXES + 1))
    return [one for one in triples if place[one[-1]] - place[one[0]] == _AXES - 1]


def _reach(data: Array) -> float:
    """Return the largest range of any column, without outliers."""
    return float(np.ptp(np.quantile(data, (0.001, 0.999), axis=0), axis=0).max())


def _motion(data: Array, spans: Indices) -> float:
    """Return the smallest ratio of range to scatter at rest among the columns."""
    still = np.median([data[a:b].std(axis=0) for a, b in spans], axis=0)
    reach = np.ptp(np.quantile(data, (0.001, 0.999), axis=0), axis=0)
    return float(np.min(reach / np.maximum(still, 1e-12 + 1e-3 * reach)))


def _varies_between_rests(table: Table, columns: Sequence[str]) -> bool:
    """Return whether readings differ far more between quiet blocks than within a block."""
    data = table.stack(columns)
    data = data[np.isfinite(data).all(axis=1)]
    block = max(20, len(data) // 1000)
    blocks = data[: len(data) // block * block].reshape(-1, block, len(columns))
    if len(blocks) < _FEWEST_RESTS:
        return True
    scatter = blocks.std(axis=1).sum(axis=-1)
    quiet = blocks[scatter <= np.quantile(scatter, 0.3)].mean(axis=1)
    spread = np.ptp(np.quantile(quiet, (0.05, 0.95), axis=0), axis=0).max()
    return bool(spread > _SPREAD * _reach(data))


_MOSTLY = 0.5  # fraction of rows; a column with another rate, or an empty one, has fewer numbers


def without_unusable(table: Table) -> Table:
    """Return the table with NaN for all numbers that are infinite, or too large to be squared."""
    found = {name: bad for name, bad in _bad_rows(table, table.names) if bad.any()}
    usable = {name: np.where(bad, np.nan, table.numbers(name)) for name, bad in found.items()}
    return replace(table, columns={**table.columns, **usable}, block=None) if usable else table


def finite_rows(table: Table, names: Iterable[str] | None = None) -> Table:
    """Return a recording's table with only the rows that contain numbers.

    Parameters
    ----------
    table : Table
    names : iterable of str, optional
        Columns that must contain numbers; by default, the columns that do so in most rows.
    """
    if table.rows < FEWEST_SAMPLES:
        return table
    if names is None:
        chosen = [n for n, bad in _bad_rows(table, table.names) if bad.mean() < _MOSTLY]
    else:
        chosen = list(names)
    keep = np.ones(table.rows, np.bool_)
    for _, bad in _bad_rows(table, chosen):
        keep &= ~bad
    if keep.all():
        return table
    kept = {name: column[keep] for name, column in table.columns.items()}
    return replace(table, columns=kept, block=None)


def require_finite_rows(log: Path, table: Table, names: Sequence[str]) -> None:
    """Refuse a table if its sensor or time columns have rows without numbers.

    Raises
    ------
    InputError
        If there are such rows; the message names the first row and its column in the file.
    """
    if names and table.columns[names[0]].size < FEWEST_SAMPLES:
        for name in names:
            number_column(log, table, name, "write the mean")
        return
    found = list(_bad_rows(table, names))
    if not found:
        return
    rows = np.any([bad for _, bad in found], axis=0)
    count = int(rows.sum())
    if not count:
        return
    first = int(np.argmax(rows))
    name = next(name for name, bad in found if bad[first])
    raise InputError(
        f"{format_count(count, 'row')} with a number that is missing, not finite or too large; "
        f"the first is {name} at {table.place(first)}: remove them, or state --set "
        "data.nonfinite=drop",
        key="data.nonfinite",
        names=(name,),
        line=table.line(first),
    ).located(log)


def _bad_rows(table: Table, names: Iterable[str]) -> Iterable[tuple[str, NDArray[np.bool_]]]:
    for name in names:
        column = table.columns[name]
        if column.dtype.kind != "U":
            yield name, ~is_usable(column.astype(np.float64))
