"""What a journal holds of sections."""

import sqlite3
from contextlib import closing

from inercal.host.journal import Journal


def sections_done(journal: Journal) -> tuple[tuple[str, float, float], ...]:
    """Return label, begin and end of every section that was done, s of the table's clock."""
    made: list[tuple[str, float, float]] = []
    begun = 0.0
    with closing(sqlite3.connect(journal.path)) as db:
        for label, what, time in db.execute("SELECT label, what, time FROM section ORDER BY id"):
            if what == "begun":
                begun = time
            elif what == "done":
                made.append((label, begun, time))
    return tuple(made)
