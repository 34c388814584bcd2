"""`inercal init`: draft a run file from a recording, with questions in a terminal."""

import shlex
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from inercal.basics.atomic_files import write_text
from inercal.basics.errors import InputError, MissingExtra
from inercal.cli.console import print_json, print_written_files, progress_status, report_line
from inercal.cli.options import Force, Json, assignments, flag, out_option, repeated
from inercal.cli.outputs import PAGE, RUN_FILE, check_outputs

if TYPE_CHECKING:
    from inercal.pipeline.drafts import Draft

SET = repeated(
    'Values that you know: --set "data.rate=100 Hz", --set data.gyro=gx,gy,gz.',
    "--set",
    metavar="KEY=VALUE",
)


def run(
    logs: list[Path] = typer.Argument(
        metavar="LOG…",
        help="The recording: a file, a file for the accelerometers and one for the gyros, several "
        "files with the same columns, a folder, or a name with a star.",
    ),
    out: Path | None = out_option("Run file to write; by default the log's name with .toml."),
    stated: list[str] = SET,
    yes: bool = typer.Option(
        False, "--yes", "-y", help="Ask no questions, but report each decision."
    ),
    report: bool = flag("--report", "Write a page that shows the signals and sections."),
    force: Force = False,
    json: Json = False,
) -> None:
    """Draft a run file from a recording: columns, units, rate, sections and possible methods.

    Each line of the draft states its reason. In a terminal, you are asked for values that cannot be
    found from the data.
    """
    from inercal.pipeline.drafts import recording_name

    if run_file := next((one for one in logs if one.suffix.lower() == ".toml"), None):
        raise InputError(
            f"{run_file} is a run file already: calibrate it with inercal calibrate {run_file}, or "
            "give a recording",
            file=run_file,
        )
    path = out or Path(f"{recording_name(logs)}.toml")
    files = {"run_file": path}
    page = path.with_suffix(".draft.html")
    kinds = {path: RUN_FILE} | ({page: PAGE} if report else {})
    check_outputs(kinds, logs, force=force)
    draft = draft_logs(logs, path, stated, yes=yes)
    write_text(path, draft.text)
    missing = None
    if report:
        from inercal.report import report_packages

        try:
            with report_packages():
                from inercal.report.recording_pages import draft_page
            files["page"] = write_text(page, draft_page(draft))
        except MissingExtra as error:
            missing = error
    if json:
        from inercal.basics.documents import attributes

        content = {
            "keys": [attributes(one, "section key value reason") for one in draft.entries],
            "questions": [one.name for one in draft.questions],
            "methods": [
                {"name": one.name, "keys": one.keys, "works": one.outcome is not None,
                 "text": one.text}
                for one in draft.trials
            ],
            "facts": list(draft.facts),
            "assumptions": list(draft.assumptions),
        }  # fmt: skip
        print_json(content | {what: str(name) for what, name in files.items()})
        return
    for line in (*draft.facts, *draft.assumptions):
        print(line)
    for trial in draft.trials:
        print(f"· {trial.text}")
    print_written_files(files.values())
    for question in draft.questions:
        print(f"please state {question.name}: {question.question}")
    if draft.questions:
        names = [*map(str, logs), *(["--out", str(out)] if out else []), "--force"]
        keys = [*stated, *(f"{one.dotted}=…" for one in draft.questions)]
        sets = " ".join(f"--set {shlex.quote(one)}" for one in keys)
        print(f"then: inercal init {shlex.join(names)} {sets}")
    else:
        print(f"next: inercal calibrate {path}")
    if missing is not None:
        report_line(f"no page: {missing}")


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
