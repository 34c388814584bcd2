"""The worksheet of a bench's operator, as data: rows to carry out, and a table to be filled."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from inercal.basics.errors import InputError


@dataclass(frozen=True)
class Heading:
    """A column of a sheet.

    Parameters
    ----------
    text : str
        As the terminal prints it.
    align_right : bool
        Whether the terminal aligns its cells to the right.
    page : str or None
        On the printed page; None is `text`. A column with an empty heading is omitted there: a box
        or the heading of the group has its content.
    label : bool
        Whether its cells are the headings of the rows of the page.
    wraps : bool
        Whether its cells are sentences, which the page wraps.
    """

    text: str
    align_right: bool = False
    page: str | None = None
    label: bool = False
    wraps: bool = False

    @property
    def on_page(self) -> str:
        """Heading on the printed page."""
        return self.text if self.page is None else self.page


@dataclass(frozen=True)
class SheetRow:
    """One row of a sheet.

    Parameters
    ----------
    label : str
        Of the step.
    cells : tuple of str
        As printed, one per heading.
    seconds : float
        Duration.
    group : str
        Rows of one group are printed together: a mounting, a pass.
    given : tuple of str
        Stated values, in the first columns of the table to be filled.
    facts : mapping of str to Any
        For JSON, in addition to label and seconds.
    idle : frozenset of int
        Places, from 0, of the boxes that are not filled in here; the page shades them.
    """

    label: str
    cells: tuple[str, ...]
    seconds: float
    group: str = ""
    given: tuple[str, ...] = ()
    facts: Mapping[str, Any] = field(default_factory=dict[str, Any])
    idle: frozenset[int] = frozenset()


@dataclass(frozen=True)
class EntryField:
    """A box of the printed page that the operator fills in.

    Parameters
    ----------
    name, unit : str
    column : str
        Of the table to be filled; empty where the table has none.
    """

    name: str
    unit: str
    column: str = ""


@dataclass(frozen=True)
class Sheet:
    """A plan on a bench, row by row.

    Parameters
    ----------
    title : str
        "12 positions, 600 s of holding in all".
    headings : tuple of Heading
    rows : tuple of SheetRow
    notes : tuple of str
        Instructions for all rows.
    columns : tuple of str, int or None
        Of the table to be filled, as [data] names them; None is omitted.
    boxes : tuple of EntryField
        Of the printed page; without boxes there is none.
    facts : tuple of str
        Of plan and bench, for the head of the page; without facts the title is printed there.
    stated : str
        The bench's stated errors, in words: the expected uncertainties follow from them.
    sums : bool
        Whether sums of coefficients, which are known far better than their terms, are listed too.
    units : mapping of str to str
        Units of columns that the operator fills in besides the sensor's, where no box has them.
    table_error : InputError or None
        Why there is no table to be filled; None where there is one.
    """

    title: str
    headings: tuple[Heading, ...]
    rows: tuple[SheetRow, ...]
    notes: tuple[str, ...]
    columns: tuple[str | int | None, ...]
    boxes: tuple[EntryField, ...] = ()
    facts: tuple[str, ...] = ()
    stated: str = "the bench"
    sums: bool = False
    units: Mapping[str, str] = field(default_factory=dict[str, str])
    table_error: InputError | None = None

    @property
    def entry_units(self) -> dict[str, str]:
        """Units of the columns that the operator fills in, as far as the sheet states them."""
        return {box.column: box.unit for box in self.boxes if box.column} | dict(self.units)

    def entry_columns(self, row: SheetRow) -> tuple[str, ...]:
        """Return the columns that the operator fills in for a row, in the order of the table."""
        idle = {self.boxes[k].column for k in row.idle}
        columns = [str(column) for column in self.columns if column is not None]
        return tuple(name for name in columns[len(row.given) :] if name not in idle)

    @property
    def seconds(self) -> float:
        """Of all rows."""
        return sum(row.seconds for row in self.rows)
