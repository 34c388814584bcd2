"""Commands, run files and Python on the pages: each is understood, and what can be run is run."""

import re
import shlex
import shutil
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any

import pytest
import typer.main
from pydantic import ValidationError
from tests.examples.test_docs import DOCS, PAGES, ROOT
from tests.program import run_program
from typer.exceptions import TyperException

from inercal.benches.kind_definition import KINDS
from inercal.cli.app import app
from inercal.runfile import from_sections, schema
from inercal.runfile.schema import RunSchema, reader_options

_CONSOLE = re.compile(r"^```console\n(.*?)^```", re.M | re.S)
_INLINE = re.compile(r"`inercal ([a-z][^`]*)`")
_OPERATORS = {";", "&&", "|", ">", "<"}
OTHERS = {"cp", "dask", "docker", "echo", "make", "pip", "podman", "python"}
INCOMPLETE = {"MissingParameter", "BadOptionUsage"}  # a verb or an option is named, not shown
WHOLE = {"sensor", "bench", "data", "method"}
# How many commands at the begin of a page name files of the examples, or what was written before.
RUN = {
    "how-to/apply.md": 3,
    "how-to/bundle.md": 3,
    "how-to/export.md": 6,
    "how-to/fleet.md": 1,
    "how-to/measure.md": 1,
    "how-to/predict.md": 4,
    "how-to/prior.md": 2,
    "how-to/qualify.md": 1,
    "how-to/repeat.md": 2,
    "how-to/six-position.md": 1,
    "how-to/temperature.md": 3,
    "how-to/verdict.md": 1,
}
# Where the Python of the other pages is run.
PYTHON = {
    "docs/how-to/chamber.md": "host/chamber/test_chamber_page.py",
    "docs/how-to/own-driver.md": "examples/test_own_driver_page.py",
    "README.md": "examples/test_examples.py",
    "docs/how-to/apply.md": "examples/test_live_example.py",
    "docs/how-to/budget.md": "examples/test_docs.py",
    "docs/how-to/export.md": "export/test_export_example.py",
    "docs/how-to/ferraris.md": "examples/test_examples.py",
    "docs/how-to/first-calibration.md": "examples/test_docs.py",
    "docs/how-to/fleet.md": "fleet/test_line.py",
    "docs/how-to/imu-packets.md": "host/packets/test_how_to_page.py",
    "docs/how-to/noise.md": "noise/test_analysis.py",
    "docs/how-to/own-bench.md": "examples/test_docs.py",
    "docs/how-to/own-method.md": "examples/test_docs.py",
    "docs/how-to/predict.md": "examples/test_predict_example.py",
    "docs/how-to/recordings.md": "io/test_io_readers.py",
    "docs/how-to/register.md": "examples/test_docs.py",
    "docs/reference/calibration-file.md": "examples/test_docs.py",
    "docs/notebooks/compare_methods.md": "examples/test_notebooks.py",
    "docs/notebooks/noise_to_filter.md": "examples/test_notebooks.py",
    "docs/notebooks/quickstart.md": "examples/test_notebooks.py",
}
SCRIPTS = {"docs/how-to/means.md", "docs/how-to/reproduce.md", "docs/how-to/verdict.md"}


def identifier(path: Path) -> str:
    return str(path.relative_to(ROOT))


def parts(line: str) -> Iterator[list[str]]:
    """Yield the commands of a line of a shell, without what is redirected."""
    lexer = shlex.shlex(line, posix=True, punctuation_chars=";|<>&")
    lexer.whitespace_split = True
    lexer.commenters = "#"
    words: list[str] = []
    redirected = False
    for word in [*lexer, ";"]:
        if word in {">", "<"}:
            redirected = True
        elif word in _OPERATORS:
            if words:
                yield words
            words, redirected = [], False
        elif not redirected:
            words.append(word)


def commands(path: Path) -> list[list[str]]:
    """Return the commands that a page shows."""
    found: list[list[str]] = []
    for block in _CONSOLE.findall(path.read_text(encoding="utf-8")):
        for line in block.splitlines():
            if line.startswith("$ "):
                found += parts(line[2:])
    return found


@cache
def program() -> Any:
    """Return the command object of the program, which takes long to make."""
    return typer.main.get_command(app)


def verb_of(words: list[str]) -> tuple[Any, list[str]]:
    """Return the command object of a verb, and the words that follow."""
    command: Any = program()
    rest = list(words)
    while groups := getattr(command, "commands", None):
        assert rest, f"inercal {words}: which of {', '.join(groups)}?"
        if words[0] == "certificate" and rest[0] not in groups:
            rest.insert(0, "issue")  # of a file
        assert rest[0] in groups, f"inercal {words}: no verb {rest[0]!r}"
        command = groups[rest.pop(0)]
    return command, rest


@pytest.mark.parametrize("path", PAGES, ids=identifier)
def test_every_command_of_a_page_fits_the_arguments_of_its_verb(path: Path):
    for name, *words in commands(path):
        if name == "inercal":
            command, rest = verb_of(words)
            command.make_context(" ".join(words), rest)
        else:
            assert name in OTHERS, name


def too_much(command: Any, words: list[str]) -> str:
    """Return what a verb says of words that it does not take; arguments may be left out."""
    try:
        command.make_context("inercal", list(words))
    except TyperException as error:
        return "" if type(error).__name__ in INCOMPLETE else str(error)
    return ""


@pytest.mark.parametrize("path", PAGES, ids=identifier)
def test_verbs_and_options_within_a_text_exist(path: Path):
    for text in _INLINE.findall(path.read_text(encoding="utf-8")):
        words = [word for word in shlex.split(text) if word != "…"]
        groups = program().commands
        if words[0].isupper() or (words[0] in groups and len(words) == 1):
            continue
        command, rest = verb_of(words)
        known = {name for one in command.params for name in (*one.opts, *one.secondary_opts)}
        assert {word.split("=")[0] for word in rest if word.startswith("--")} <= known, text
        surplus = "" if "…" in text else too_much(command, rest)
        assert not surplus, f"{text}: {surplus}"


def test_every_target_of_make_on_a_page_exists():
    targets = set(re.findall(r"^([a-z]+):", (ROOT / "Makefile").read_text("utf-8"), re.M))
    named = {
        word
        for path in PAGES
        for text in (*commands(path),)
        if text[0] == "make"
        for word in text[1:2]
    }
    named |= {
        word
        for path in PAGES
        for word in re.findall(r"`make ([a-z]+)`", path.read_text(encoding="utf-8"))
    }
    assert named <= targets


@pytest.mark.slow
@pytest.mark.parametrize("name", RUN)
def test_the_commands_that_name_files_of_the_examples_run(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    shutil.copytree(ROOT / "examples", tmp_path / "examples")
    monkeypatch.chdir(tmp_path)
    shown = commands(DOCS / name)[: RUN[name]]
    for k, (verb, *words) in enumerate(shown):
        assert verb == "inercal"
        for n in range(2, 5) if words[-1].endswith("session_1.toml") else ():
            run_program(*words[:-1], words[-1].replace("_1", f"_{n}"))
        for n in range(22, 26) if words[-1].endswith("QA_21.toml") else ():
            run_program(*words[:-1], words[-1].replace("21", str(n)))
        if "board.params" in words:
            shutil.copy("examples/export/board.params", ".")
        ended = run_program(*words)
        # 3: the result is not to be relied on, which the page of the verdict shows
        assert ended.status == (3 if name.endswith("verdict.md") else 0), (k, words, ended.error)


def sections(path: Path) -> Iterator[dict[str, Any]]:
    for text in re.findall(r"```toml\n(.*?)```", path.read_text(encoding="utf-8"), flags=re.S):
        content = tomllib.loads(text)
        if set(content) <= set(RunSchema.model_fields):
            yield content


@pytest.mark.parametrize("path", PAGES, ids=identifier)
def test_keys_and_values_of_run_files_on_a_page_are_read(path: Path):
    if path.name == "own-bench.md":
        pytest.skip(
            "its kind of bench is that of the example, which tests/examples/test_docs.py reads"
        )
    for content in sections(path):
        if set(content) >= WHOLE:
            content["data"].setdefault("file", "log.csv")  # of a fleet each sensor has its own
            from_sections(ROOT / "examples" / "run.toml", content, "")
            continue
        stated = content.get("bench", {}).get("kind")
        kinds = [stated] if stated else list(KINDS)
        errors = [unread(content, kind) for kind in kinds]
        assert [] in errors, errors


def unread(content: dict[str, Any], kind: str) -> list[Any]:
    """Return what a run file of a kind of bench would refuse of some sections, as a part of it."""
    completed = dict(content)
    if "data" in content:
        completed["data"], _ = reader_options(content["data"], KINDS[kind].data)
    if "bench" in content:
        completed["bench"] = {"kind": kind} | content["bench"]
        completed["bench"].pop("qualification", None)  # read before the schema
        if "latitude" not in completed["bench"]:
            completed["bench"].setdefault("gravity", "9.81 m/s² ± 1 mm/s²")
    try:
        schema.schema_for_kind(kind).model_validate(completed)
    except ValidationError as error:
        return [one for one in error.errors() if one["type"] != "missing"]
    return []


def test_python_of_every_page_is_run_by_a_test():
    shown = {identifier(path) for path in PAGES if "```python\n" in path.read_text("utf-8")}
    assert shown == SCRIPTS | set(PYTHON)
    for page, file in PYTHON.items():
        assert (ROOT / "tests" / file).is_file(), page


@pytest.mark.slow
@pytest.mark.parametrize("name", sorted(SCRIPTS))
def test_python_of_a_page_runs_as_a_script(name: str, tmp_path: Path):
    shutil.copytree(ROOT / "examples", tmp_path / "examples")
    folder = tmp_path / "examples" / "verdict"  # of the run file that one of them names
    text = (ROOT / name).read_text(encoding="utf-8")
    for k, code in enumerate(re.findall(r"```python\n(.*?)```", text, flags=re.S)):
        script = folder / f"snippet_{k}.py"
        script.write_text(code.replace("trials=400", "trials=40"), encoding="utf-8")
        command = [sys.executable, "-W", "error", script.name]
        done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr
