"""Console output for the verbs: tables, lines, verdicts, JSON and progress.

A table cell that is too wide continues on the next line. A cell with more than 200 characters,
which can only come from a file, is truncated.
"""

import json
import sys
from collections.abc import Callable, Generator, Iterable, Mapping, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import typer

from inercal.basics.errors import InercalError, InputError

if TYPE_CHECKING:
    from pathlib import Path

    from rich.table import Table
    from rich.text import Text

    from inercal.calibration.grade import Verdict
    from inercal.laboratory.store import Register
    from inercal.methods.ship_multi_angle.norm_equations import Generation
    from inercal.pipeline import Outcome
    from inercal.runfile import Run


_COLOURS = {"good": "green", "care": "yellow", "bad": "red"}
_MAX_CELL, _MAX_LINE = 200, 2000  # characters


@contextmanager
def progress_status(what: str) -> Generator[Callable[[str], None]]:
    """Show a progress line in a terminal on standard error; yield the function that updates it."""
    if not sys.stderr.isatty():  # rich would start a thread that prints nothing
        yield lambda text: None
        return
    from rich.text import Text

    from inercal.cli.terminal import terminal

    # Text objects, because rich interprets markup in plain strings, and names come from files.
    with terminal(stderr=True).status(Text(what)) as status:
        yield lambda text: status.update(Text(text))


@contextmanager
def draw_refusal(run: "Run", page: "Path | None") -> Generator[None]:
    """Write a page with rests and thresholds if a recording is refused; the error names the page.

    Parameters
    ----------
    run : Run
    page : Path or None
        The page to write, or None for no page.
    """
    try:
        yield
    except InercalError as error:
        if page is not None and _write_refusal_page(run, str(error), page):
            error.args = (f"{error} (see rests and thresholds in {page})", *error.args[1:])
        raise


def _write_refusal_page(run: "Run", message: str, page: "Path") -> bool:
    """Write the page about a refusal, and return whether it was written."""
    from inercal.basics.atomic_files import write_text
    from inercal.pipeline.outcome import inspect_refused_recording
    from inercal.report import report_packages

    if (inspected := inspect_refused_recording(run)) is None:
        return False
    try:
        with report_packages():
            from inercal.report.recording_pages import refusal_page
        write_text(page, refusal_page(inspected, run.sensor, message))
    except InputError:
        return False  # the original error is printed anyway
    return True


def generation_text(generation: "Generation") -> str:
    """Describe the progress of a search in one line."""
    return (
        f"generation {generation.number}, sum of squares {generation.cost:.3g} g⁴, largest norm "
        f"error {100 * generation.worst:.2g} %"
    )


def report_line(words: str) -> None:
    """Print a message from the program to its user, on standard error."""
    print(f"inercal: {words}", file=sys.stderr, flush=True)


def print_written_files(files: "Iterable[Path | str]") -> None:
    """Print the names of the files that were written."""
    for path in files:
        print(f"wrote {path}")


def open_register(address: str | None, by: str | None = None, *, create: bool = True) -> "Register":
    """Open a register for the person `by`; with `create`, create it if it does not exist."""
    from inercal.laboratory.store import Register

    return Register(address, by, create=create)


def make_table(*heads: str, title: str | None = None, **options: Any) -> "Table":
    """Return an empty table in which long cells wrap instead of being cut.

    A ">" before a heading aligns its column to the right, as for numbers.
    """
    from rich.table import Column, Table

    columns = (
        Column(head.removeprefix(">"), justify="right" if head[:1] == ">" else "left",
               overflow="fold")
        for head in heads
    )  # fmt: skip
    return Table(*columns, title=title, **options)


def print_table(
    heads: Iterable[str],
    rows: Iterable["Sequence[str | Text]"],
    *,
    title: str | None = None,
    section: Callable[[str], str] | None = None,
) -> None:
    """Print a table of texts that may come from files; texts that end in " *" are highlighted.

    Parameters
    ----------
    heads : iterable of str
        Column headings. ">" before a heading aligns its column to the right, as for numbers.
    rows : iterable of sequence of str or Text
        Cells of each row. An empty row begins a new section.
    title : str, optional
    section : callable, optional
        Function of the first cell; a new section begins whenever its value changes.
    """
    from rich.text import Text

    from inercal.cli.terminal import terminal

    table, previous = make_table(*heads, title=title), ""
    for row in rows:
        own = section(str(row[0])) if section and row else ""
        if not row or (previous and own != previous):
            table.add_section()
        previous = own
        if row:
            table.add_row(*(x if isinstance(x, Text) else _cell(x) for x in row))
    terminal().print(table)


def _cell(text: str) -> "Text":
    from rich.text import Text

    shown = text if len(text) <= _MAX_CELL else f"{text[:_MAX_CELL]}…"
    return Text(shown, style="bold red" if text.endswith(" *") else "")


def axis_of(name: str) -> str:
    """Return the axis of a coefficient, by which tables are divided into sections."""
    from inercal.basics.keys import CoefficientName

    return CoefficientName(name).axis


def number_heads(heads: Iterable[str], numbers: Iterable[str]) -> list[str]:
    """Mark headings as numeric if they begin with one of the given words."""
    return [f">{head}" if head.startswith(tuple(numbers)) else head for head in heads]


def print_line(text: str, style: str = "", *, whole: bool = False) -> None:
    """Print a line; a line that is too long to read is truncated, unless `whole` is set."""
    from rich.text import Text

    from inercal.cli.terminal import terminal

    if len(text) > _MAX_LINE and not whole:
        text = f"{text[:_MAX_LINE]}… ({len(text)} characters; --json prints all)"
    terminal(highlight=False).print(Text(text, style))


def print_lines(texts: Iterable[str], bullet: str = "", *, whole: bool = False) -> None:
    """Print lines with `print_line`, each after the same bullet."""
    for text in texts:
        print_line(f"{bullet}{text}", whole=whole)


def print_json(content: Mapping[str, Any] | Sequence[Any]) -> None:
    """Print one JSON object or list on standard output; numbers that are not finite become null."""
    from pydantic_core import to_jsonable_python

    is_unicode = (sys.stdout.encoding or "utf-8").lower().replace("-", "") == "utf8"
    plain = to_jsonable_python(content, inf_nan_mode="null")
    text = json.dumps(plain, indent=1, ensure_ascii=not is_unicode, allow_nan=False)
    sys.stdout.write(text + "\n")


def print_coefficients(outcome: "Outcome", truth: Mapping[str, float]) -> None:
    """Print the coefficients with U (k = 2), and error/u if the truth is known."""
    from inercal.calibration.delays import delay_words, significant_delays, stated_delays
    from inercal.calibration.display import coefficient_lines, title
    from inercal.pipeline.outcome import true_coefficients

    calibration = outcome.calibration
    true = true_coefficients(calibration, truth)
    rows = [list(line[:5]) for line in coefficient_lines(calibration)]
    if truth:
        for row, std in zip(rows, calibration.std, strict=True):
            row.append(f"{(calibration.value(row[0]) - true[row[0]]) / std:+.2f}")
    error = (">error / u",) if truth else ()
    heads = ("coefficient", "meaning", ">value", ">U (k = 2)", "unit", *error)
    print_table(heads, rows, title=title(calibration), section=axis_of)
    delays = stated_delays(calibration.conditions)
    for kind in delays if "w" in delays else significant_delays(calibration.conditions):
        print_line(f"Delay: {delay_words(kind, delays[kind])}.")
    print_lines(calibration.conformity_lines, whole=True)


def print_verdict(verdict: "Verdict", *, explain: bool = False) -> None:
    """Print the verdict and, with `explain`, all details under headings."""
    first, *others = verdict.lines
    print_line(first, f"bold {_COLOURS[verdict.tone]}")
    print_lines(others, whole=True)
    for heading, lines in verdict.explanation if explain else ():
        print_line(f"\n{heading}", "bold")
        # Not truncated, because no other output contains these lines.
        print_lines(lines, "· ", whole=True)


def exit_with_verdict(outcome: "Outcome", *, strict: bool = False) -> None:
    """End the program with the exit status of the verdict, after all output is complete.

    The status is 0 if the result is consistent or usable with reservations, and 3 if it should not
    be relied on. With `strict`, reservations also give 3.
    """
    bad = {"unreliable", "reservations"} if strict else {"unreliable"}
    exit_if(outcome.verdict.grade in bad)


def exit_if(failed: object, status: int = 3) -> None:
    """End the program with an exit status, after all output is complete, if something failed."""
    if failed:
        raise typer.Exit(status)
