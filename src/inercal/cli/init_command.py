"""`inercal init`: draft a run file from a recording, with questions in a terminal."""

import shlex
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from inercal.basics.atomic_files import write_text
from inercal.basics.errors import InputError, MissingExtra
from inercal.cli.console import print_json, print_written_files, report_line
from inercal.cli.log_drafts import SET, draft_logs
from inercal.cli.options import Force, Json, flag, out_option
from inercal.cli.outputs import PAGE, RUN_FILE, check_outputs

if TYPE_CHECKING:
    pass


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
