"""`inercal init`: a run file drafted from a recording."""

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from inercal.cli.console import print_json, print_written_files, progress_status

if TYPE_CHECKING:
    from inercal.pipeline.drafts import Draft, DraftKey

NAME = "init"


def run(
    logs: list[Path] = typer.Argument(
        metavar="LOG…", help="The recording, or the files of its accelerometers and of its gyros."
    ),
    out: Path | None = typer.Option(
        None, "--out", "-o", help="Run file to write; by default the log's name with .toml."
    ),
    stated: list[str] = typer.Option(
        [],
        "--set",
        metavar="KEY=VALUE",
        help='What you know: --set "data.rate=100 Hz", --set data.gyro=gx,gy,gz.',
    ),
    yes: bool = typer.Option(False, "--yes", "-y", help="Ask nothing: decide, and say so."),
    report: bool = typer.Option(False, "--report", help="Write a page with signals and sections."),
    force: bool = typer.Option(False, "--force", help="Write over an existing file."),
    json: bool = typer.Option(False, "--json", help="Print one JSON object."),
) -> None:
    """Draft a run file: columns, units, rate, sections and the methods that the data support.

    Each line of it gives its reason. In a terminal it asks for what the data do not show.
    """
    from inercal.basics.atomic_files import write_text
    from inercal.cli.outputs import PAGE, RUN_FILE, check_outputs

    path = out or Path(f"{logs[0].stem}.toml")
    files = {"run_file": path}
    page = path.with_suffix(".draft.html")
    kinds = {path: RUN_FILE} | ({page: PAGE} if report else {})
    check_outputs(kinds, logs, force=force)
    known = stated_keys(stated)
    asks = not yes and sys.stdin.isatty() and sys.stdout.isatty()
    draft = _draft(logs, path, known, asks=asks)
    if draft.questions and asks:
        draft = _ask(draft, logs, known)
    write_text(path, draft.text)
    missing = None
    if report:
        from inercal.basics.errors import MissingExtra
        from inercal.report import write_draft

        try:
            files["page"] = write_draft(draft, page)
        except MissingExtra as error:
            missing = error
    if json:
        print_json(_as_object(draft) | {what: str(name) for what, name in files.items()})
        return
    for fact in draft.facts:
        print(fact)
    for trial in draft.trials:
        print(f"· {trial.text}")
    print_written_files(files)
    for question in draft.questions:
        print(f"please tell {question.name}: {question.ask}")
        print(
            f'  inercal init {" ".join(map(str, logs))} --set "{question.section}.{question.key}=…"'
        )
    if not draft.questions:
        print(f"next: inercal calibrate {path}")
    if missing is not None:
        print(f"inercal: no page: {missing}", file=sys.stderr)


def stated_keys(texts: Sequence[str]) -> dict[str, str]:
    """Return the values of `--set`, by key.

    Raises
    ------
    InputError
        A text that is no key with its value, or a key that is stated twice.
    """
    from inercal.basics.errors import InputError

    known: dict[str, str] = {}
    for text in texts:
        key, value = _key_and_value(text)
        if key in known:
            raise InputError(f"--set {key} is stated twice: state it once", key="--set")
        known[key] = value
    return known


def _key_and_value(text: str) -> tuple[str, str]:
    from inercal.basics.errors import InputError

    key, separator, value = text.partition("=")
    if not separator or not value.strip() or "." not in key:
        raise InputError(
            f'--set {text!r}: write a key with its section, as "data.rate=100 Hz"', key="--set"
        )
    return key.strip(), value.strip()


def _draft(logs: Sequence[Path], path: Path, known: dict[str, str], *, asks: bool) -> "Draft":
    """Draft the run file; in a terminal, ask for accelerometers that are not recognised."""
    from inercal.basics.errors import InputError
    from inercal.pipeline.drafts import UnknownAccelerometers, draft_run_file

    key = "data.accelerometer"
    while True:
        try:
            with progress_status(f"reading {', '.join(map(str, logs))}"):
                return draft_run_file(logs, path, known)
        except UnknownAccelerometers as error:
            if not asks:
                raise
            print(f"Columns of numbers: {', '.join(error.columns)}")
        except InputError as error:
            if not asks or error.key != key:
                raise
            print(f"inercal: {error}", file=sys.stderr)
        known[key] = _three_columns(logs[0])


def _three_columns(log: Path) -> str:
    """Ask for three columns until three are given; an empty answer ends."""
    from inercal.basics.errors import InputError

    while True:
        answer = input("Which three are the accelerometers x, y, z (with commas)? ").strip()
        if not answer:
            raise InputError(f"{log}: no method calibrates without accelerometers", file=log)
        if answer.count(",") == len("xyz") - 1:
            return answer


def _ask(draft: "Draft", logs: Sequence[Path], known: dict[str, str]) -> "Draft":
    """Ask for what only the user knows, and draft again with the answers."""
    from inercal.basics.errors import InputError
    from inercal.pipeline.drafts import draft_run_file

    while questions := _unasked(draft, known):
        for question in questions:
            key = f"{question.section}.{question.key}"
            known[key] = input(f"{question.name}: {question.ask}? ").strip()
        answered = {key: value for key, value in known.items() if value}
        try:
            with progress_status("trying the methods"):
                draft = draft_run_file(logs, draft.path, answered)
        except InputError as error:
            print(f"inercal: {error}", file=sys.stderr)
            for question in questions:
                known.pop(f"{question.section}.{question.key}")
    return draft


def _unasked(draft: "Draft", known: dict[str, str]) -> "list[DraftKey]":
    """Return the questions that are still open; an empty answer leaves a key open."""
    return [one for one in draft.questions if f"{one.section}.{one.key}" not in known]


def _as_object(draft: "Draft") -> dict[str, object]:
    return {
        "keys": [
            {"section": one.section, "key": one.key, "value": one.value, "reason": one.reason}
            for one in draft.entries
        ],
        "questions": [one.name for one in draft.questions],
        "methods": [
            {"name": one.name, "keys": one.keys, "works": one.outcome is not None, "text": one.text}
            for one in draft.trials
        ],
        "facts": list(draft.facts),
    }
