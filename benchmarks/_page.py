"""The page of speeds: the machine, and a table of what was measured on it."""

from collections.abc import Iterable, Mapping, Sequence

from benchmarks import ROOT, Row, Skipped

PAGE = ROOT / "docs" / "reference" / "speed.md"
_HEADS = ("work", "ours", "wall", "processor", "peer", "ratio", "to reach", "reached")
_INTRODUCTION = """# Speed

`make bench` writes this page, and all rows are measured in one run on one machine. The column
`ours` is compared with the `peer`, which is a limit or another program that does the same work and
gives the same answer. The ratio is the value of the peer divided by ours, so a larger ratio is
better. Wall time and processor time belong to our work and include all its processes; they are only
given if both were measured. Every measurement runs in a process that is prepared in the same way as
the processes of the program.
"""


def speed_page(machine: Mapping[str, str], rows: Sequence[Row | Skipped]) -> str:
    """Return the page in Markdown.

    Parameters
    ----------
    machine : mapping of str to str
        What the machine is and runs.
    rows : sequence of Row or Skipped
    """
    about = _table(("machine", ""), machine.items())
    aligned = (":--", "--:", "--:", "--:", ":--", "--:", "--:", ":--")
    measured = _table(_HEADS, map(_cells, rows), aligned)
    return f"{_INTRODUCTION}\n{about}\n{measured}\n{_summary(rows)}\n"


def _cells(row: Row | Skipped) -> tuple[str, ...]:
    if isinstance(row, Skipped):
        return (row.name, *[""] * (len(_HEADS) - 2), f"not measured: {row.reason}")
    wall, processor = (f"{one:.3g} s" for one in row.times) if row.times else ("", "")
    return (
        row.name,
        f"{row.ours:.3g} {row.unit}".strip(),
        wall,
        processor,
        f"{row.peer_name}: {row.peer:.3g} {row.unit}".strip(),
        f"{row.ratio:.3g}",
        f"{row.to_reach:.3g}",
        "yes" if row.reached else "**missed**",
    )


def _summary(rows: Sequence[Row | Skipped]) -> str:
    measured = [row for row in rows if isinstance(row, Row)]
    reached = sum(row.reached for row in measured)
    skipped = len(rows) - len(measured)
    return (
        f"{reached} of {len(measured)} figures reach their target; "
        f"{skipped} rows were not measured."
    )


def _table(
    heads: Sequence[str], lines: Iterable[Sequence[str]], aligned: Sequence[str] = ()
) -> str:
    rules = aligned or ["---"] * len(heads)
    return "".join(f"| {' | '.join(cells)} |\n" for cells in (heads, rules, *lines))
