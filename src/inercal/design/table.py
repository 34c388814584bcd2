"""The table to be filled at the bench: what is set stands in it, what is read is empty."""

import csv
from collections.abc import Sequence
from io import StringIO

from inercal.errors import InputError
from inercal.runfile import Run


def empty_table(run: Run, header: Sequence[str | int | None], rows: Sequence[Sequence[str]]) -> str:
    """Return the table, CSV.

    Filled, it is the [data] file of a run with kind = "means".

    Parameters
    ----------
    run : Run
    header : sequence of str, int or None
        Columns as [data] names them; None is left out.
    rows : sequence of sequence of str
        What is set, of the first columns.

    Raises
    ------
    InputError
        A column that is given by its number.
    """
    named = [column for column in header if column is not None]
    for column in named:
        if isinstance(column, int):
            raise InputError(
                f"{run.path}: [data] gives column {column} by its number; a worksheet needs "
                "the names of its columns"
            )
    text = StringIO()
    lines = csv.writer(text, lineterminator="\n")
    lines.writerow(named)
    lines.writerows([*row, *[""] * (len(named) - len(row))] for row in rows)
    return text.getvalue()
