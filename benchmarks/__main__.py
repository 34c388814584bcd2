"""Run every benchmark, or those named, and print the table."""

import importlib
import pkgutil
import sys

import benchmarks


def main(names: list[str]) -> None:
    """Print one line for each piece of work."""
    known = [module.name for module in pkgutil.iter_modules(benchmarks.__path__)]
    known.remove("__main__")
    for name in names:
        if name not in known:
            raise SystemExit(f"no benchmark '{name}'; there are {', '.join(known)}")
    print(f"{'work':<64} {'ours':>11} {'peer':>11} {'ratio':>7}  peer")
    for name in names or known:
        for row in importlib.import_module(f"benchmarks.{name}").rows():
            if isinstance(row, benchmarks.Skipped):
                print(f"{row.name:<64} skipped: {row.reason}", flush=True)
                continue
            sizes = (f"{size:>8.3g} {row.unit:<2}" for size in (row.ours, row.peer))
            ratio = f"{row.peer / row.ours:>6.3g}×"
            print(f"{row.name:<64} {' '.join(sizes)} {ratio}  {row.peer_name}", flush=True)


main(sys.argv[1:])
