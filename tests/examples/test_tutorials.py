"""The tutorials, done as written: each command, in order, and the lines that they show."""

import re
import shlex
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import pytest
from tests.base_seeds import slow
from tests.program import run_program

ROOT = Path(__file__).parents[2]
TUTORIALS = ROOT / "docs" / "tutorials"
_BLOCK = re.compile(r"(?P<before>[^\n]*)\n\n```(?P<kind>console|toml)\n(?P<text>.*?)```", re.S)
_RUN = re.compile(r"\d{8}-\d{6}")  # in the name of a run's folder
SIMULATE, RUN = ["inercal", "bench", "simulate"], ["inercal", "bench", "run"]


class Step(NamedTuple):
    """A command with the lines of its output that a page shows, or keys to add to a file."""

    command: list[str]
    shown: list[str]
    keys: str = ""
    file: str = ""


def steps(page: Path) -> Iterator[Step]:
    for block in _BLOCK.finditer(page.read_text(encoding="utf-8")):
        if block["kind"] == "toml":
            name = re.search(r"`([^`]+\.toml)`", block["before"])
            assert name is not None, block["before"]
            yield Step([], [], block["text"], name[1])
            continue
        for one in block["text"].split("$ ")[1:]:
            command, *shown = one.rstrip().split("\n")
            yield Step(shlex.split(command), shown)


def add_keys(path: Path, keys: str) -> None:
    """Add the keys of each section to that section of a file."""
    text = path.read_text(encoding="utf-8")
    for heading, lines in re.findall(r"^(\[.+?\])\n(.*?)(?=^\[|\Z)", keys, re.M | re.S):
        assert text.count(f"{heading}\n") == 1
        text = text.replace(f"{heading}\n", f"{heading}\n{lines.strip()}\n")
    path.write_text(text, encoding="utf-8")


def carry_out(step: Step) -> None:
    if step.keys:
        add_keys(Path(step.file), step.keys)
    elif step.command[0] == "cp":
        *_, source, target = step.command
        (shutil.copytree if Path(source).is_dir() else shutil.copy)(source, target)
    else:
        assert step.command[0] == "inercal"
        ended = run_program(*step.command[1:])
        lines = {_RUN.sub("", line.strip()) for line in ended.output.splitlines()}
        for line in step.shown:
            assert _RUN.sub("", line) in lines, (
                f"{step.command}: {line!r} is not in\n{ended.output}{ended.error}"
            )


@pytest.fixture
def empty(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    shutil.copytree(ROOT / "examples", tmp_path / "examples")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("INERCAL_REGISTER", str(tmp_path / "register.db"))
    monkeypatch.setenv("COLUMNS", "500")  # the pages show lines in one piece
    return tmp_path


@pytest.mark.slow
@pytest.mark.parametrize("name", [slow("first-calibration"), "certificate", slow("fleet")])
def test_a_tutorial_is_done_as_written(empty: Path, name: str):
    for step in steps(TUTORIALS / f"{name}.md"):
        carry_out(step)


@pytest.mark.slow
def test_the_tutorial_of_the_bench_is_done_as_written(empty: Path):
    program = [sys.executable, "-m", "inercal"]
    bench: subprocess.Popen[str] | None = None
    printed: list[str] = []
    try:
        for step in steps(TUTORIALS / "simulated-bench.md"):
            if step.command[:3] == SIMULATE:
                bench = subprocess.Popen(
                    [*program, *step.command[1:]],
                    stdout=subprocess.PIPE,
                    stdin=subprocess.PIPE,
                    text=True,
                )
                assert bench.stdout is not None
                line = bench.stdout.readline()
                assert line.startswith(step.shown[0])
                printed = shlex.split(line)
            elif step.command[:3] == RUN:
                assert printed[:4] == step.command[:4]
                carry_out(step._replace(command=printed))
            else:
                carry_out(step)
    finally:
        if bench is not None:
            bench.terminate()
            bench.communicate()


def test_every_tutorial_is_tested():
    tested = {"first-calibration", "certificate", "fleet", "simulated-bench"}
    assert {page.stem for page in TUTORIALS.glob("*.md")} == tested
