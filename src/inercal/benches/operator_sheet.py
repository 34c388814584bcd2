"""What the operator of a bench does, as data: rows to carry out, and a table to be filled."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any


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
        On the printed page; None is `text`. An empty one is left out there: a box or the heading of
        the group says the same.
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
        As they are printed, one a heading.
    seconds : float
        How long it lasts.
    group : str
        Rows of one group stand together: a mounting, a pass.
    given : tuple of str
        What is set, in the first columns of the table to be filled.
    facts : mapping of str to Any
        For JSON, beside label and seconds.
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
    """What is filled in by hand on the printed page: its name and unit."""

    name: str
    unit: str


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
        What holds for all rows, in words.
    columns : tuple of str, int or None
        Of the table to be filled, as [data] names them; None is left out.
    boxes : tuple of EntryField
        Of the printed page; without boxes there is none.
    facts : tuple of str
        Of plan and bench, for the head of the page; without facts the title stands there.
    stated : str
        What the run file states of the bench, in words: uncertainties to expect follow from it.
    sums : bool
        Whether sums of coefficients, which are known far better than their terms, are listed too.
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

    @property
    def seconds(self) -> float:
        """Of all rows."""
        return sum(row.seconds for row in self.rows)
