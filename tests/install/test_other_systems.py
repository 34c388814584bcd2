"""What works without the modules and the functions that only Unix has, and in its code page.

This stands for Windows and macOS, on which the project was not tried.
"""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from tests.base_seeds import evidence

EXAMPLES = Path(__file__).parents[2] / "examples"
MODULES = ("fcntl", "termios", "pty", "tty", "grp", "pwd", "resource")
FUNCTIONS = (
    "O_NONBLOCK", "fork", "forkpty", "openpty", "getuid", "geteuid", "getpgid", "setsid", "killpg",
    "mkfifo",
)  # fmt: skip
WITHOUT = f"""
import os, sys
for name in {MODULES!r}:
    sys.modules[name] = None
for name in {FUNCTIONS!r}:
    if hasattr(os, name):
        delattr(os, name)
import multiprocessing
multiprocessing.set_start_method("spawn", force=True)  # a worker reads this file too
if __name__ == "__main__":
    from inercal.cli.app import main
    main()
"""


@pytest.fixture(scope="module")
def program(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("other") / "program.py"
    path.write_text(WITHOUT, encoding="utf-8")
    return path


def run(
    program: Path, *arguments: str | Path, encoding: str = "cp1252"
) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, str(program), *map(str, arguments)],
        env={**os.environ, "PYTHONIOENCODING": encoding, "PYTHONUTF8": "0"},
        capture_output=True,
        text=True,
        encoding=encoding,
        check=False,
    )


@pytest.mark.slow
def test_a_calibration_with_its_report_needs_nothing_of_unix(program: Path, tmp_path: Path):
    done = run(program, "calibrate", EXAMPLES / "six_position" / "run.toml", "--out", tmp_path)
    assert done.returncode == 0, done.stderr
    assert "µg" in done.stdout
    names = {path.name for path in tmp_path.iterdir()}
    assert names == {"run.calibration.json", "run.report.html"}


@pytest.mark.slow
@pytest.mark.parametrize(
    "arguments",
    [
        ("init", "six_position/positions.csv", "--json", "--out"),
        evidence(("simulate", "ferraris_simulated/run.toml", "--json", "--out")),
    ],
)
def test_other_verbs_need_nothing_of_unix(
    arguments: tuple[str, ...], program: Path, tmp_path: Path
):
    verb, file, *options = arguments
    result = tmp_path / ("run.toml" if verb == "init" else "log.csv")
    done = run(program, verb, EXAMPLES / file, *options, result)
    assert done.returncode == 0, done.stderr
    assert str(result) in json.loads(done.stdout).values()
    assert result.exists()


@pytest.mark.slow
def test_workers_are_spawned(program: Path, tmp_path: Path):
    run_file = EXAMPLES / "six_position" / "run.toml"
    options = ("--trials", "4", "--workers", "2", "--json", "--out", tmp_path)
    done = run(program, "budget", run_file, *options)
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["coefficients"]
