"""Output of the verbs: tables, lines, verdicts, JSON and progress.

A cell of a table that is too wide goes on in its next line; one of more than 200 characters, which
only a file can hold, is cut.
"""

import json
import sys
from collections.abc import Callable, Generator, Iterable, Mapping, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

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
    """Show a line of progress on standard error; yield the function that changes it."""
    from rich.text import Text

    from inercal.cli.terminal import terminal

    # Texts: rich reads markup in plain ones, and names come from files.
    with terminal(stderr=True).status(Text(what)) as status:
        yield lambda text: status.update(Text(text))


@contextmanager
def draw_refusal(run: "Run", page: "Path | None") -> Generator[None]:
    """Draw rests and thresholds of a refused recording, and name the page in the message.

    Parameters
    ----------
    run : Run
    page : Path or None
        The page to write; None for no page.
    """
    from inercal.basics.errors import InercalError

    try:
        yield
    except InercalError as error:
        if page is not None and _write_refusal_page(run, str(error), page):
            error.args = (f"{error} (see rests and thresholds in {page})", *error.args[1:])
        raise


def _write_refusal_page(run: "Run", message: str, page: "Path") -> bool:
    """Write the page of a refusal; return whether it was written."""
    from inercal.basics.errors import InputError
    from inercal.pipeline.refused_recording import inspect_refused_recording
    from inercal.report import write_refusal

    if (inspected := inspect_refused_recording(run)) is None:
        return False
    try:
        write_refusal(inspected, run.sensor, message, page)
    except InputError:
        return False  # the refusal itself is printed
    return True


def generation_text(generation: "Generation") -> str:
    """Return the progress of a search in one line."""
    return (
        f"generation {generation.number}, sum of squares {generation.cost:.3g} g⁴, largest norm "
        f"error {100 * generation.worst:.2g} %"
    )


def report_line(words: str) -> None:
    """Print a line of the program for whoever runs it, on standard error."""
    print(f"inercal: {words}", file=sys.stderr, flush=True)


def print_written_files(files: "Iterable[Path | str]") -> None:
    """Print the names of the files that were written."""
    for path in files:
        print(f"wrote {path}")


def open_register(address: str | None, by: str | None = None, *, create: bool = True) -> "Register":
    """Open a register; `create` makes one where there is none, `by` is who enters."""
    from inercal.laboratory.store import Register

    return Register(address, by, create=create)


def make_table(*heads: str, title: str | None = None, **options: Any) -> "Table":
    """Return a table that keeps every character; a head with ">" before it is of numbers."""
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
    """Print a table of texts that may come from files; those that end in " *" stand out.

    Parameters
    ----------
    heads : iterable of str
        ">" before a head aligns its column to the right, as numbers are.
    rows : iterable of sequence of str or Text
        An empty row begins a section.
    title : str, optional
    section : callable, optional
        A section begins where the value of this function of the first cell changes.
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
    """Return the axis of a coefficient, whose sections a table shows."""
    from inercal.basics.keys import CoefficientName

    return CoefficientName(name).axis


def number_heads(heads: Iterable[str], numbers: Iterable[str]) -> list[str]:
    """Return heads with the mark of numbers before those that begin with one of some words."""
    return [f">{head}" if head.startswith(tuple(numbers)) else head for head in heads]


def print_line(text: str, style: str = "", *, whole: bool = False) -> None:
    """Print a line; one that no person reads to its end is cut, unless it is wanted whole."""
    from rich.text import Text

    from inercal.cli.terminal import terminal

    if len(text) > _MAX_LINE and not whole:
        text = f"{text[:_MAX_LINE]}… ({len(text)} characters; --json prints all)"
    terminal(highlight=False).print(Text(text, style))


def print_lines(texts: Iterable[str], bullet: str = "", *, whole: bool = False) -> None:
    """Print lines, each with the same beginning, as `print_line` does."""
    for text in texts:
        print_line(f"{bullet}{text}", whole=whole)


def print_json(content: Mapping[str, Any] | Sequence[Any]) -> None:
    """Print one object or list on standard output; null stands for numbers that are not finite."""
    from pydantic_core import to_jsonable_python

    is_unicode = (sys.stdout.encoding or "utf-8").lower().replace("-", "") == "utf8"
    plain = to_jsonable_python(content, inf_nan_mode="null")
    text = json.dumps(plain, indent=1, ensure_ascii=not is_unicode, allow_nan=False)
    sys.stdout.write(text + "\n")


def print_coefficients(outcome: "Outcome", truth: Mapping[str, float]) -> None:
    """Print the coefficients with U (k = 2), and the error over u where the truth is known."""
    from inercal.calibration.display import coefficient_lines, title
    from inercal.pipeline.truth import true_coefficients

    calibration = outcome.calibration
    true = true_coefficients(calibration, truth)
    rows = [list(line[:5]) for line in coefficient_lines(calibration)]
    if truth:
        for row, std in zip(rows, calibration.std, strict=True):
            row.append(f"{(calibration.value(row[0]) - true[row[0]]) / std:+.2f}")
    error = (">error / u",) if truth else ()
    heads = ("coefficient", "meaning", ">value", ">U (k = 2)", "unit", *error)
    print_table(heads, rows, title=title(calibration), section=axis_of)
    print_lines(calibration.conformity_lines, whole=True)


def print_verdict(verdict: "Verdict", *, explain: bool = False) -> None:
    """Print the lines of a verdict, and with `explain` all that explains them, under headings."""
    first, *others = verdict.lines
    print_line(first, f"bold {_COLOURS[verdict.tone]}")
    print_lines(others, whole=True)
    for heading, lines in verdict.explanation if explain else ():
        print_line(f"\n{heading}", "bold")
        # Whole: no other output has them.
        print_lines(lines, "· ", whole=True)


def exit_with_verdict(outcome: "Outcome", *, strict: bool = False) -> None:
    """End the program with the status of the verdict, after all is written and printed.

    0 where the result is consistent or usable with reservations, 3 where it is not to be relied on;
    `strict` makes reservations 3 too.
    """
    import typer

    bad = {"unreliable", "reservations"} if strict else {"unreliable"}
    if outcome.verdict.grade in bad:
        raise typer.Exit(3)
