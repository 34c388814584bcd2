"""Rows without a finite number: left out while columns are recognised, then refused by name."""

from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from inercal.basics.errors import InputError
from inercal.pipeline.drafts.column_values import FEWEST_SAMPLES
from inercal.recordings.io.column_table import Table
from inercal.recordings.io.mean_tables import number_column
from inercal.recordings.io.row_checks import is_usable

_MOSTLY = 0.5  # of the rows: a column of another rate, or of nothing, has fewer numbers


def finite_rows(table: Table, names: Iterable[str] | None = None) -> Table:
    """Return a recording's table with the rows alone that hold numbers.

    Parameters
    ----------
    table : Table
    names : iterable of str, optional
        Columns that must hold numbers; without, those of numbers that do so in most rows.
    """
    count = next(iter(table.columns.values())).size
    if count < FEWEST_SAMPLES:
        return table
    if names is None:
        chosen = [n for n, bad in _bad_rows(table, table.names) if bad.mean() < _MOSTLY]
    else:
        chosen = list(names)
    keep = np.ones(count, np.bool_)
    for _, bad in _bad_rows(table, chosen):
        keep &= ~bad
    if keep.all():
        return table
    kept = {name: column[keep] for name, column in table.columns.items()}
    return replace(table, columns=kept, block=None)


def require_finite_rows(log: Path, table: Table, names: Sequence[str]) -> None:
    """Refuse a table whose columns of a sensor, or of time, hold rows without numbers.

    Raises
    ------
    InputError
        It names the first row and the file's own column.
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
        f"{log}: {count} row{'s' * (count > 1)} with a number that is missing, not finite or too "
        f"large, the first {name} at "
        f"{table.place(first)}: remove them, or state --set data.nonfinite=drop",
        file=log,
        key="data.nonfinite",
        names=(name,),
        line=table.line(first),
    )


def _bad_rows(table: Table, names: Iterable[str]) -> Iterable[tuple[str, NDArray[np.bool_]]]:
    for name in names:
        column = table.columns[name]
        if column.dtype.kind != "U":
            yield name, ~is_usable(column.astype(np.float64))
