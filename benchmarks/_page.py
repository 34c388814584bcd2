"""The page of speeds: the machine, and a table of what was measured on it."""

from collections.abc import Iterable, Mapping, Sequence

from benchmarks import ROOT, Row, Skipped

PAGE = ROOT / "docs" / "reference" / "speed.md"
_HEADS = ("work", "ours", "wall", "processor", "peer", "ratio", "to reach", "reached")
_INTRODUCTION = """# Speed

`make bench` writes this page: all rows are measured in one run on one machine. `ours` is compared
with the `peer`, another program for the same work and the same answer, or a limit. The ratio is the
peer's size over ours: more is better. Wall and processor time are of our work, of all its
processes, where both were measured. All run in processes that are prepared as the program's.
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
    return f"{reached} of {len(measured)} figures are reached; {skipped} were not measured."


def _table(
    heads: Sequence[str], lines: Iterable[Sequence[str]], aligned: Sequence[str] = ()
) -> str:
    rules = aligned or ["---"] * len(heads)
    return "".join(f"| {' | '.join(cells)} |\n" for cells in (heads, rules, *lines))
