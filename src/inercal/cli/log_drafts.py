"""Drafts of run files from logs, with questions in a terminal: for `init` and `calibrate`."""

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from inercal.basics.errors import InputError
from inercal.cli.console import progress_status, report_line
from inercal.cli.options import assignments, repeated

if TYPE_CHECKING:
    from inercal.pipeline.drafts import Draft

SET = repeated(
    'Values that you know: --set "data.rate=100 Hz", --set data.gyro=gx,gy,gz.',
    "--set",
    metavar="KEY=VALUE",
)


def draft_logs(logs: Sequence[Path], path: Path, stated: Sequence[str], *, yes: bool) -> "Draft":
    """Draft the run file for a recording; in a terminal, ask for values that only the user knows.

    Parameters
    ----------
    logs : sequence of Path
        Files of the recording.
    path : Path
        Path of the run file.
    stated : sequence of str
        Values given with `--set`.
    yes : bool
        Whether to take typical values instead of asking.

    Raises
    ------
    InputError
        If no method can use the recording, or a stated value is not possible.
    """
    known = stated_keys(stated)
    asks = not yes and sys.stdin.isatty() and sys.stdout.isatty()
    draft = _draft(logs, path, known, asks=asks, yes=yes)
    return _ask(draft, logs, known) if draft.questions and asks else draft


def stated_keys(texts: Sequence[str]) -> dict[str, str]:
    """Return the values given with `--set`, by key."""
    form = 'a key with its section, as "data.rate=100 Hz"'
    return assignments(texts, "--set", form, sectioned=True)


def _draft(
    logs: Sequence[Path], path: Path, known: dict[str, str], *, asks: bool, yes: bool
) -> "Draft":
    """Draft the run file; in a terminal, ask for accelerometer columns that are not recognised."""
    from inercal.pipeline.drafts import UnknownAccelerometers, draft_run_file

    key = "data.accelerometer"
    while True:
        try:
            with progress_status(f"reading {', '.join(map(str, logs))}"):
                return draft_run_file(logs, path, known, typical=yes)
        except UnknownAccelerometers as error:
            if not asks:
                raise
            print(f"Columns with numbers: {', '.join(error.columns)}")
        except InputError as error:
            if not asks or error.key != key:
                raise
            report_line(str(error))
        known[key] = _three_columns(logs[0])


def _three_columns(log: Path) -> str:
    """Ask until three columns are given; an empty answer cancels."""
    while True:
        answer = _answer("Accelerometer columns x, y and z, separated by commas: ")
        if not answer:
            raise InputError(f"{log}: no method works without accelerometers", file=log)
        if answer.count(",") == len("xyz") - 1:
            return answer


def _ask(draft: "Draft", logs: Sequence[Path], known: dict[str, str]) -> "Draft":
    """Ask for values that only the user knows, and draft again with the answers."""
    from inercal.pipeline.drafts import draft_run_file

    # An empty answer takes the typical value, or leaves the key open if there is none.
    typical = False
    while questions := [one for one in draft.questions if one.dotted not in known]:
        for question in questions:
            answer = _answer(f"{question.name} ({question.question}): ")
            known[question.dotted] = answer
            typical |= bool(question.typical) and not answer
        answered = {key: value for key, value in known.items() if value}
        try:
            with progress_status("trying the methods"):
                draft = draft_run_file(logs, draft.path, answered, typical=typical)
        except InputError as error:
            report_line(str(error))
            for question in questions:
                known.pop(question.dotted)
    return draft


def _answer(prompt: str) -> str:
    """Return what the user types; empty at the end of the input."""
    try:
        return input(prompt).strip()
    except EOFError:
        print()
        return ""
