"""Monte Carlo counts: worked out from the command line, stored with the page beside them."""

import argparse
import json
from collections.abc import Callable, Sequence
from functools import partial
from multiprocessing import Pool
from pathlib import Path
from typing import Any

from tests.evidence.stored_counts import current_commit, describe_machine

_RUN = "\nCommit "


def store_runs(
    description: str | None,
    work_out: Callable[..., dict[str, Any]],
    page: Callable[[dict[str, Any]], str],
    files: tuple[Path, Path],
    runs: int,
    option: str = "--runs",
    methods: Sequence[str] = (),
) -> None:
    """Work out counts; store those of the full number of runs, and print the page of fewer.

    Parameters
    ----------
    description : str or None
        Of the command.
    work_out : callable
        From a number of runs and a pool of processes to the counts. If there are `methods`, its
        keyword argument `only` names those to work out.
    page : callable
        From the counts to the text of their page.
    files : tuple of 2 Path
        Of the counts and of the page.
    runs : int
        The full number.
    option : str
        Name of the option that takes another number.
    methods : sequence of str
        The choices of the option ``--only``; the counts of the other methods stay as stored.
    """
    parser = argparse.ArgumentParser(description=description)
    parser.add_argument(option, dest="runs", type=int, default=runs)
    parser.add_argument("--processes", type=int, default=2)
    if methods:
        parser.add_argument("--only", nargs="+", choices=methods, default=methods)
    chosen = parser.parse_args()
    if methods:
        work_out = partial(work_out, only=chosen.only)
    with Pool(chosen.processes) as pool:
        found = work_out(chosen.runs, pool)
    if chosen.runs != runs:
        print(page(found))
        return
    data, text = files
    data.write_text(json.dumps(found, ensure_ascii=False, indent=1) + "\n", encoding="utf-8")
    write_page(text, page(found))


def write_page(path: Path, text: str) -> None:
    """Write a page, with the commit and the machine in its last line."""
    run = f"{_RUN}{current_commit()}; {describe_machine()}.\n"
    path.write_text(text + run, encoding="utf-8")


def page_text(path: Path) -> str:
    """Return a page without the line of its run."""
    return path.read_text(encoding="utf-8").partition(_RUN)[0]
