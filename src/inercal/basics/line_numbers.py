"""Line numbers of the rows in a text file that may also contain lines without samples."""

from bisect import bisect_right

LineBreaks = tuple[tuple[int, int], ...]
"""Row and line number of row 0 and of each row that follows lines without samples."""


def line_of_row(row: int, first_line: int, breaks: LineBreaks) -> int | None:
    """Return a row's line number, from the line of row 0 or from the last row after a gap.

    >>> [line_of_row(k, 0, ((0, 2), (3, 9))) for k in range(5)]
    [2, 3, 4, 9, 10]
    """
    if first_line:
        return first_line + row
    if not breaks:
        return None
    start, line = breaks[bisect_right(breaks, row, key=lambda one: one[0]) - 1]
    return line + row - start
