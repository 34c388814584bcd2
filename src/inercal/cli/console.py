"""Output of the verbs: a table of coefficients, verdicts, JSON, progress; checks of --out."""

import json
import sys
from collections.abc import Callable, Generator, Mapping, Sequence
from contextlib import contextmanager
from math import isfinite
from typing import TYPE_CHECKING, Any, cast

if TYPE_CHECKING:
    from pathlib import Path

    from inercal.laboratory.store import Register
    from inercal.methods.ship_multi_angle.norm_equations import Generation
    from inercal.pipeline import Outcome
    from inercal.runfile import Run


_COLOURS = {"good": "green", "care": "yellow", "bad": "red"}


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
        f"generation {generation.number}, sum of squares {generation.cost:.3g} g⁴, largest error "
        f"of a norm {100 * generation.worst:.2g} %"
    )


def print_written_files(files: "Mapping[str, Path | str]") -> None:
    """Print the names of the files that were written."""
    for path in files.values():
        print(f"wrote {path}")


def open_register(address: str | None) -> "Register | None":
    """Open the register at an address, if any, before the work: a wrong address fails at once."""
    if address is None:
        return None
    from inercal.laboratory.store import Register

    return Register(address)


def print_json(content: Mapping[str, Any] | Sequence[Any]) -> None:
    """Print one object or list on standard output; null stands for numbers that are not finite."""
    is_unicode = (sys.stdout.encoding or "utf-8").lower().replace("-", "") == "utf8"
    text = json.dumps(_finite(content), indent=1, ensure_ascii=not is_unicode, allow_nan=False)
    sys.stdout.write(text + "\n")


def _finite(content: Any) -> Any:
    """Return an object with null for numbers that JSON has not."""
    if isinstance(content, float):
        return content if isfinite(content) else None
    if isinstance(content, Mapping):
        return {key: _finite(value) for key, value in cast(Mapping[str, Any], content).items()}
    if isinstance(content, list | tuple):
        return [_finite(value) for value in cast(Sequence[Any], content)]
    return content


def print_coefficients(outcome: "Outcome", truth: Mapping[str, float]) -> None:
    """Print the coefficients with U (k = 2), and the error over u where the truth is known."""
    from rich.text import Text

    from inercal.calibration.display import coefficient_lines, title
    from inercal.calibration.specification import conformity_lines
    from inercal.cli.tables import begin_section, make_table, number_columns
    from inercal.cli.terminal import terminal
    from inercal.pipeline.truth import true_coefficients

    calibration = outcome.calibration
    heads = ["coefficient", "meaning", *number_columns(("value", "U (k = 2)")), "unit"]
    heads += number_columns(("error / u",)) if truth else []
    table = make_table(*heads, title=title(calibration))
    previous, true = "", true_coefficients(calibration, truth)
    for line, std in zip(coefficient_lines(calibration), calibration.std, strict=True):
        previous = begin_section(table, line.name, previous)
        error = calibration.value(line.name) - true[line.name] if truth else 0.0
        table.add_row(*line[:5], *([f"{error / std:+.2f}"] if truth else []))
    console = terminal()
    console.print(table)
    summary, *others = outcome.verdict.lines
    style = f"bold {_COLOURS[outcome.verdict.tone]}"
    console.print(Text(outcome.verdict.word.capitalize(), style))
    console.print(summary, style="bold")
    for text in others:
        console.print(f"· {text}")
    for text in conformity_lines(calibration):
        console.print(Text(text))


def exit_with_verdict(outcome: "Outcome", *, strict: bool = False) -> None:
    """End the program with the status of the verdict, after all is written and printed.

    0 where the result is consistent or usable with reservations, 3 where it is not to be relied on;
    `strict` makes reservations 3 too.
    """
    import typer

    bad = {"unreliable", "reservations"} if strict else {"unreliable"}
    if outcome.verdict.grade in bad:
        raise typer.Exit(3)
