"""The program as a shell sees it: what it prints where, its status, and what it imports."""

import json
import os
import subprocess
import sys
from importlib.metadata import version
from pathlib import Path

import pytest
from tests.program import run_program
from tests.runfile.run_file_texts import SIX_POSITIONS, run_file

from inercal.cli.app import main

HEAVY = ("numpy", "scipy", "numba", "pint", "matplotlib", "sqlalchemy", "alembic")
VERBS = (
    "demo",
    "calibrate",
    "plan",
    "budget",
    "simulate",
    "apply",
    "predict",
    "export",
    "import",
    "report",
    "reproduce",
    "compile",
    "bench",
    "store",
)


def inercal(*arguments: str | Path) -> subprocess.CompletedProcess[str]:
    # What the installed script does, without relying on where it was installed.
    command = [sys.executable, "-m", "inercal", *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, encoding="utf-8", check=False)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("calibrat",), "No such command 'calibrat'. Did you mean 'calibrate'?"),
        (("calibrate",), "Missing argument 'RUN_FILE|LOG…'."),
        (
            ("calibrate", "run.toml", "--outt", "x"),
            "No such option: --outt (Possible options: --auto, --out)",
        ),
        (("demo", "--seed", "many"), "Invalid value for '--seed': "),
        (
            ("certificate", "issue", "a.json", "--lab", "lab.toml", "--language", "fr"),
            "Invalid value for '--language': 'fr' is not one of",
        ),
        (("bench", "resume", "folder", "--patience"), "Option '--patience' requires an argument."),
    ],
)
def test_what_is_no_command_is_one_line(arguments: tuple[str, ...], words: str):
    done = run_program(*arguments)
    assert (done.status, done.output) == (2, "")
    assert done.error.startswith(f"inercal: {words}")
    assert "--help" in done.error


@pytest.mark.slow
def test_help_and_version_import_no_numerics():
    asked = [
        ["--help"],
        ["calibrate", "--help"],
        ["budget", "--help"],
        ["bench", "--help"],
        ["bench", "run", "--help"],
        ["store", "--help"],
        ["store", "history", "--help"],
        ["--version"],
    ]
    code = (
        "import sys\n"
        "from inercal.cli.app import main\n"
        f"for arguments in {asked!r}:\n"
        "    sys.argv[1:] = arguments\n"
        "    try:\n"
        "        main()\n"
        "    except SystemExit as stop:\n"
        "        assert not stop.code, stop.code\n"
        f"    heavy = [m for m in {HEAVY!r} if m in sys.modules]\n"
        "    assert not heavy, (arguments, heavy)\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, encoding="utf-8", check=False
    )
    assert (done.returncode, done.stderr) == (0, "")


@pytest.mark.parametrize(("asked", "used"), [(None, "1"), ("4", "4")])
def test_linear_algebra_has_one_thread_unless_told_otherwise(
    monkeypatch: pytest.MonkeyPatch, asked: str | None, used: str
):
    monkeypatch.setattr(sys, "argv", ["inercal", "--version"])
    monkeypatch.setenv("OPENBLAS_NUM_THREADS", asked or "")
    if not asked:
        monkeypatch.delenv("OPENBLAS_NUM_THREADS")
    with pytest.raises(SystemExit):
        main()
    assert os.environ["OPENBLAS_NUM_THREADS"] == used


@pytest.mark.slow
def test_importing_the_package_changes_nothing_in_a_process():
    code = """
import os, sys, threading
before = dict(os.environ), threading.active_count(), sys.path[:], sys.flags
import inercal
inercal.calibrate
assert (dict(os.environ), threading.active_count(), sys.path, sys.flags) == before
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")


def test_help_lists_every_verb():
    done = inercal("--help")
    assert done.returncode == 0
    assert all(f" {verb} " in done.stdout for verb in VERBS)


def test_the_version_is_the_installed_one():
    done = inercal("--version")
    assert (done.returncode, done.stdout) == (0, f"inercal {version('inercal')}\n")


def test_a_mistake_is_one_line_on_standard_error_and_status_2(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    path = tmp_path / "none.toml"
    monkeypatch.setattr(sys, "argv", ["inercal", "calibrate", str(path), "--out", str(tmp_path)])
    with pytest.raises(SystemExit) as stop:
        main()
    assert stop.value.code == 2
    printed = capsys.readouterr()
    assert printed.out == ""
    assert printed.err.startswith(f"inercal: {path}: no such run file")
    assert printed.err.count("\n") == 1
    assert list(tmp_path.iterdir()) == []


def test_simulate_and_calibrate_work_one_after_the_other(tmp_path: Path):
    path = run_file(tmp_path, SIX_POSITIONS)
    simulated = run_program("simulate", path, "--seed", "4", "--json")
    assert (simulated.status, simulated.error) == (0, "")
    assert json.loads(simulated.output)["recording"] == str(tmp_path / "log.csv")
    done = run_program("calibrate", path, "--out", tmp_path, "--no-report")
    assert (done.status, done.error) == (0, "")
    assert "ax.k0" in done.output
    assert "the data agree with the stated noise and bench" in " ".join(done.output.split())
    assert (tmp_path / "run.calibration.json").is_file()


@pytest.mark.slow
def test_where_nothing_can_be_kept_kernels_are_compiled_into_a_folder_that_goes():
    script = """
import os, sys
os.access = lambda *_, **__: False
os.environ.pop("NUMBA_CACHE_DIR", None)
import inercal
assert "numba" not in sys.modules
from inercal.estimation import _kernels
print(os.environ["NUMBA_CACHE_DIR"])
"""
    run = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    folder = Path(run.stdout.strip())
    assert folder.name.startswith("inercal-")
    assert not folder.exists()


def test_no_help_loses_a_bracket_to_markup():
    """Help is printed as rich markup, of which "[job]" is a style and not a text."""
    import re

    import typer

    from inercal.cli.app import app

    def texts(command: object) -> list[str]:
        parts = [getattr(command, "help", "") or ""]
        parts += [getattr(one, "help", "") or "" for one in getattr(command, "params", ())]
        for one in getattr(command, "commands", {}).values():
            parts += texts(one)
        return parts

    found = texts(typer.main.get_command(app))
    assert any("\\[data]" in one for one in found)
    assert [one for one in found if re.search(r"(?<!\\)\[[a-zA-Z/@#]", one)] == []
