"""Run every benchmark, or those named, and print the table; with `--page` write it too."""

import importlib
import pkgutil
import sys
from collections.abc import Iterator

import benchmarks
from benchmarks import Row, Skipped
from benchmarks._machine import machine
from benchmarks._page import PAGE, speed_page
from inercal.basics.process_settings import prepare_process

_WIDTHS = {"work": -64, "ours": 11, "peer": 11, "ratio": 7, "to reach": 8, "wall": 8, "cpu": 8}
_HEAD = (
    " ".join(f"{one:<{-n}}" if n < 0 else f"{one:>{n}}" for one, n in _WIDTHS.items()) + "  peer"
)


def main(arguments: list[str]) -> None:
    """Print one line for each piece of work."""
    names = [name for name in arguments if name != "--page"]
    known = [one.name for one in pkgutil.iter_modules(benchmarks.__path__) if one.name[0] != "_"]
    for name in names:
        if name not in known:
            raise SystemExit(f"no benchmark '{name}'; there are {', '.join(known)}")
    for what, value in machine().items():
        print(f"{what}: {value}")
    print(_HEAD)
    rows: list[Row | Skipped] = []
    for row in _rows(names or known):
        print(_line(row), flush=True)
        rows.append(row)
    if len(names) < len(arguments):
        PAGE.write_text(speed_page(machine(), rows), encoding="utf-8")
        print(f"wrote {PAGE}")


def _rows(names: list[str]) -> Iterator[Row | Skipped]:
    for name in names:
        yield from importlib.import_module(f"benchmarks.{name}").rows()


def _line(row: Row | Skipped) -> str:
    if isinstance(row, Skipped):
        return f"{row.name:<64} skipped: {row.reason}"
    sizes = " ".join(f"{size:>8.3g} {row.unit:<2}" for size in (row.ours, row.peer))
    times = " ".join(f"{one:>6.3g} s" for one in row.times) if row.times else " " * 17
    missed = "" if row.reached else ", missed"
    return (
        f"{row.name:<64} {sizes} {row.ratio:>6.3g}× {row.to_reach:>7.3g}× {times}  "
        f"{row.peer_name}{missed}"
    )


prepare_process()
main(sys.argv[1:])
