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
    print(f"{'work':<60} {'ours':>10} {'peer':>10} {'ratio':>7}  peer")
    for name in names or known:
        for row in importlib.import_module(f"benchmarks.{name}").rows():
            times = f"{row.ours:>8.3g} s {row.peer:>8.3g} s {row.peer / row.ours:>6.1f}×"
            print(f"{row.name:<60} {times}  {row.peer_name}", flush=True)


main(sys.argv[1:])
