"""Decide whether a column names sections of a recording, or is something else.

Columns of text also contain frame ids, device names, status words, dates and checksums. A label has
few values, each in one or several stretches. It names faces, axes or turns, or it changes where the
sensor is moved: most readings within a stretch are then alike.
"""

import re

import numpy as np

from inercal.basics.arrays import Array
from inercal.recordings.data.face_names import planned_name
from inercal.recordings.io.column_table import Table

_FEWEST, _MOST = 2, 1000  # values
_STRETCH = 20  # samples in a typical stretch
_RESTS = 4  # values whose stretches are at rest
_STILL = 0.05  # scatter of a stretch at rest, relative to the range of the recording
_DATE = re.compile(r"\d{1,4}([-/.]\d{1,2}[-/.]\d{1,4}\b.*|:\d{2}\b.*)")
_ABSENT = ("", "nan", "none")


def names_sections(table: Table, name: str, force: Array | None) -> bool:
    """Return whether a column of a recording names its sections.

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
    values = [one for one in np.unique(column).tolist() if one.strip().lower() not in _ABSENT]
    if any(planned_name(one) for one in values):
        return True
    dates = sum(_DATE.fullmatch(one) is not None for one in values)
    return 2 * dates <= len(values) and _few_stretches(column, force)


def names_rows(table: Table, name: str) -> bool:
    """Return whether a column of a table of means names its rows: each differently, or by faces."""
    values = [str(one).strip() for one in table.columns[name].tolist()]
    return len(set(values)) == len(values) or all(map(planned_name, values))


def _few_stretches(column: np.ndarray, force: Array | None) -> bool:
    edges = np.flatnonzero(column[1:] != column[:-1]) + 1
    spans = np.column_stack([np.append(0, edges), np.append(edges, column.size)])
    count = len(np.unique(column))
    if not _FEWEST <= count <= _MOST or _STRETCH * len(spans) > column.size:
        return False
    if force is None:
        return True
    reach = np.ptp(np.quantile(force, (0.001, 0.999), axis=0), axis=0).max()
    still = {
        str(column[a])
        for a, b in spans.tolist()
        if b - a > 2 and force[a:b].std(axis=0).max() <= _STILL * reach
    }
    return len(still) >= _RESTS
