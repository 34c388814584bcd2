"""Count what inercal says of violations of known visibility, and write the tables.

`python -m tests.evidence` works out all cells with both the base cases; `--methods` and `--cells`
choose some of them, `--devices` fewer devices, and then the tables are printed and not written.
"""

import argparse
import sys
from multiprocessing import Pool, cpu_count

from tests.evidence import store, tables_of
from tests.evidence.cells import (
    BASE_DEVICES,
    CASES,
    DEVICES,
    Cell,
    Count,
    bases_of,
    cells_of,
    count,
    split,
)


def main(arguments: list[str]) -> None:
    """Work out the cells and write or print them."""
    parser = argparse.ArgumentParser(prog="python -m tests.evidence", description=__doc__)
    parser.add_argument("--methods", nargs="*", default=list(CASES), choices=list(CASES))
    parser.add_argument("--cells", default="", help="text that a violation's name holds")
    parser.add_argument("--devices", type=int, default=DEVICES)
    parser.add_argument("--base", type=int, default=BASE_DEVICES, help="devices of each base seed")
    parser.add_argument("--processes", type=int, default=cpu_count())
    chosen = parser.parse_args(arguments)
    cells = [
        cell
        for name in chosen.methods
        for cell in (
            *(bases_of(name, chosen.base) if chosen.base and not chosen.cells else ()),
            *cells_of(name, devices=chosen.devices),
        )
        if chosen.cells in cell.violation
    ]
    counted = work(cells, chosen.processes)
    whole = (
        chosen.methods == list(CASES)
        and not chosen.cells
        and (chosen.devices, chosen.base) == (DEVICES, BASE_DEVICES)
    )
    if whole:
        store.write(counted)
    print(tables_of.text(counted))
    if chosen.methods == list(CASES) and not chosen.cells:
        print(tables_of.summary(counted))


def work(cells: list[Cell], processes: int) -> dict[Cell, Count]:
    """Return the counts of cells, worked out side by side."""
    parts = [part for cell in cells for part in split(cell)]
    counted = {cell: Count() for cell in cells}
    with Pool(processes) as pool:
        done = pool.imap(count, parts)
        for k, ((cell, _), one) in enumerate(zip(parts, done, strict=True), start=1):
            counted[cell] = counted[cell] + one
            if sys.stderr.isatty():
                print(f"\r{k} of {len(parts)}", end="", file=sys.stderr, flush=True)
    return counted


if __name__ == "__main__":
    main(sys.argv[1:])
