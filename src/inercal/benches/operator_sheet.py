"""Describe the worksheet for a bench's operator: rows to carry out, and a table to fill in."""

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
        Heading that the terminal prints.
    align_right : bool
        Whether the terminal aligns its cells to the right.
    page : str or None
        Heading on the printed page; None means `text`. The page omits a column with an empty
        heading, because a box or the heading of the group shows its content.
    label : bool
        Whether its cells are the row headings on the page.
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


ROW = Heading("row", align_right=True)
DURATION = Heading("for", align_right=True)


@dataclass(frozen=True)
class SheetRow:
    """One row of a sheet.

    Parameters
    ----------
    label : str
        Label of the step.
    cells : tuple of str
        Printed text of each cell, one per heading.
    seconds : float
        Duration of the step, s.
    group : str
        Group of the row, such as a mounting or a pass. Rows of one group are printed together.
    given : tuple of str
        Stated values for the first columns of the table that the operator fills in.
    facts : mapping of str to Any
        Values for the JSON output, in addition to label and seconds.
    idle : frozenset of int
        Indices of the boxes that are not filled in for this row; the page shades them.
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
        Its column in the table that the operator fills in; empty if the table has none.
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
        Title of the sheet, such as "12 positions, 600 s of holding in all".
    headings : tuple of Heading
    rows : tuple of SheetRow
    notes : tuple of str
        Instructions for all rows.
    columns : tuple of str, int or None
        Columns of the table that the operator fills in, as [data] names them; None is omitted.
    boxes : tuple of EntryField
        Boxes on the printed page; without boxes no page is printed.
    facts : tuple of str
        Facts about the plan and the bench for the head of the page; without them the page shows
        the title there.
    stated : str
        Description of the bench's stated errors, which determine the expected uncertainties.
    sums : bool
        Whether to list also sums of coefficients that are known far better than their terms.
    units : mapping of str to str
        Units of columns that the operator fills in, other than the sensor's, if no box has them.
    table_error : InputError or None
        Reason why there is no table to fill in; None if there is one.
    seconds_between : float
        Duration of the motion between the rows if it is counted, s.
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
    seconds_between: float = 0.0

    @property
    def entry_units(self) -> dict[str, str]:
        """Units of the columns that the operator fills in, if the sheet states them."""
        return {box.column: box.unit for box in self.boxes if box.column} | dict(self.units)

    def entry_columns(self, row: SheetRow) -> tuple[str, ...]:
        """Return the columns that the operator fills in for a row, in the order of the table."""
        idle = {self.boxes[k].column for k in row.idle}
        columns = [str(column) for column in self.columns if column is not None]
        return tuple(name for name in columns[len(row.given) :] if name not in idle)

    @property
    def seconds(self) -> float:
        """Total duration of all rows and of the motion between them, s."""
        return sum(row.seconds for row in self.rows) + self.seconds_between
