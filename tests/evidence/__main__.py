"""Count what inercal says of violations of known visibility, and write the tables.

`python -m tests.evidence` works out all cells and the base cases, method by method, and writes each
in the place of what is stored. `--methods` chooses some methods, and `--base-only` the base cases:
cells that are not worked out stay as they are stored. `--missing` works out the cells that are not
stored yet, and writes them beside the others. With `--cells`, `--at`, or fewer devices, the
tables are printed and not written.
"""

import argparse
import sys
from multiprocessing import Pool, cpu_count

from tests.evidence import stored_counts, violation_table
from tests.evidence.violation_cells import (
    BASE_DEVICES,
    CASES,
    DEVICES,
    Cell,
    Count,
    base_cells,
    case_cells,
    count_answers,
    split_cell,
)


def main(arguments: list[str]) -> None:
    """Work out the cells and write or print them."""
    parser = argparse.ArgumentParser(prog="python -m tests.evidence", description=__doc__)
    parser.add_argument("--methods", nargs="*", default=list(CASES), choices=list(CASES))
    parser.add_argument("--cells", default="", help="text that a violation's name holds")
    parser.add_argument("--at", default="", help='"5 u", "η = 6" or "as it is"')
    parser.add_argument("--devices", type=int, default=DEVICES)
    parser.add_argument("--base", type=int, default=BASE_DEVICES, help="devices of each base seed")
    parser.add_argument("--base-only", action="store_true", help="no violations")
    parser.add_argument("--missing", action="store_true", help="only cells that are not stored")
    parser.add_argument("--processes", type=int, default=cpu_count())
    chosen = parser.parse_args(arguments)
    if chosen.base_only and (chosen.cells or chosen.at or not chosen.base):
        parser.error("--base-only takes neither --cells nor --at, and --base above 0")
    cells = [
        cell
        for name in chosen.methods
        for cell in (
            *(
                base_cells(name, chosen.base)
                if chosen.base and not (chosen.cells or chosen.at)
                else ()
            ),
            *(() if chosen.base_only else case_cells(name, devices=chosen.devices)),
        )
        if chosen.cells in cell.violation and chosen.at in cell.at
    ]
    if chosen.missing:
        stored = {(c.case, c.violation, c.at) for c, _ in stored_counts.read_counts()}
        cells = [c for c in cells if (c.case, c.violation, c.at) not in stored]
    whole = not (chosen.cells or chosen.at) and (chosen.devices, chosen.base) == (
        DEVICES,
        BASE_DEVICES,
    )
    counted: dict[Cell, Count] = {}
    for name in chosen.methods:
        of_method = count_cells([cell for cell in cells if cell.case == name], chosen.processes)
        if whole and of_method:
            write = stored_counts.add_counts if chosen.missing else stored_counts.write_counts
            write(of_method)
        print(violation_table.table_text(of_method), flush=True)
        counted |= of_method
    if not (chosen.cells or chosen.at):
        if not chosen.base_only:
            print(violation_table.demand_summary(counted))
        print(violation_table.base_table(counted))


def count_cells(cells: list[Cell], processes: int) -> dict[Cell, Count]:
    """Return the counts of cells, worked out side by side."""
    parts = [part for cell in cells for part in split_cell(cell)]
    counted = {cell: Count() for cell in cells}
    with Pool(processes) as pool:
        done = pool.imap(count_answers, parts)
        for k, ((cell, _), one) in enumerate(zip(parts, done, strict=True), start=1):
            counted[cell] = counted[cell] + one
            if sys.stderr.isatty():
                print(f"\r{k} of {len(parts)}", end="", file=sys.stderr, flush=True)
    return counted


if __name__ == "__main__":
    main(sys.argv[1:])
