"""Line numbers of the rows of a text file; lines without a sample may lie between two rows."""

from bisect import bisect_right

LineBreaks = tuple[tuple[int, int], ...]
"""Rows that do not follow the line of the row before, with their lines; row 0 included."""


def line_of_row(row: int, first_line: int, breaks: LineBreaks) -> int | None:
    """Return the line of a row, given that of row 0, or the rows that follow a gap in the lines.

    >>> [line_of_row(k, 0, ((0, 2), (3, 9))) for k in range(5)]
    [2, 3, 4, 9, 10]
    """
    if first_line:
        return first_line + row
    if not breaks:
        return None
    start, line = breaks[bisect_right(breaks, row, key=lambda one: one[0]) - 1]
    return line + row - start
