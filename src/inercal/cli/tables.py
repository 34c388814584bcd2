"""Tables for the terminal: a cell that is too wide goes on in its next line and is never cut."""

from collections.abc import Iterable
from typing import Any

from rich.table import Column, Table
from rich.text import Text

from inercal.basics.keys import CoefficientName

_MAX_CELL = 200  # characters


def number_column(heading: str) -> Column:
    """Return a column of numbers, aligned to the right."""
    return Column(heading, justify="right", overflow="fold")


def make_table(*heads: str | Column, title: str | None = None, **options: Any) -> Table:
    """Return a table whose columns of text keep every character."""
    columns = (Column(one, overflow="fold") if isinstance(one, str) else one for one in heads)
    return Table(*columns, title=title, **options)


def number_columns(heads: Iterable[str]) -> Iterable[Column]:
    """Return columns of numbers."""
    return map(number_column, heads)


def add_row(table: Table, *cells: str) -> None:
    """Add a row of texts that may come from files; those that end in " *" stand out."""
    cells = tuple(cell if len(cell) <= _MAX_CELL else f"{cell[:_MAX_CELL]}…" for cell in cells)
    table.add_row(*(Text(cell, style="bold red" if cell.endswith(" *") else "") for cell in cells))


def begin_section(table: Table, name: str, previous: str) -> str:
    """Begin a section of the table where another axis begins; return the axis of a coefficient."""
    axis = CoefficientName(name).axis
    if previous and axis != previous:
        table.add_section()
    return axis
