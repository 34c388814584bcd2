"""What the program prints where nobody listens, the disk is full or characters are missing."""

import json
import os
import shutil
import subprocess
import sys
from itertools import product
from pathlib import Path

import pytest
from tests.base_seeds import chosen, evidence
from tests.program import run_program
from tests.runfile.run_file_texts import SIX_POSITIONS, run_file

from inercal.calibration.files import load

START = (sys.executable, "-m", "inercal")


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = run_file(
        tmp_path_factory.mktemp("run"), SIX_POSITIONS, ("triad 3", "triad \\u001b[2J µ√")
    )
    result, register = path.with_name("run.calibration.json"), path.with_name("register.db")
    for arguments in (
        ("simulate", path),
        ("calibrate", path, "--out", path.parent, "--no-report"),
        ("store", "import", result, "--register", register),
    ):
        assert run_program(*arguments).status == 0
    head = Path(__file__).parents[2] / "examples" / "dividing_head" / "pair.toml"
    shutil.copy(head, path.with_name("head.toml"))
    return path


def shell(run: Path, redirection: str, *arguments: str, **environment: str) -> tuple[int, str, str]:
    """Run a verb as a shell redirects it; return exit status, output and standard error."""
    command = f'"$@" {redirection}'
    done = subprocess.run(
        ["bash", "-o", "pipefail", "-c", command, "bash", *START, *arguments],
        cwd=run.parent,
        env={**os.environ, **environment},
        capture_output=True,
        check=False,
    )
    return done.returncode, done.stdout.decode("latin-1"), done.stderr.decode("latin-1")


VERBS = (
    ("calibrate", "run.toml", "--no-report"),
    ("calibrate", "run.toml", "--no-report", "--json"),
    ("report", "run.toml"),
    ("plan", "dual-orthogonal", "--run", "head.toml"),
    ("reproduce", "centrifuge", "--trials", "20"),
    ("budget", "run.toml", "--trials", "2"),
    ("simulate", "run.toml", "--force"),
    ("apply", "run.calibration.json", "run.toml", "--out", "corrected.csv", "--force"),
    ("export", "run.calibration.json", "--to", "csv", "--out", "run.csv", "--force"),
    ("store", "import", "run.calibration.json", "--register", "register.db"),
    ("store", "list", "--register", "register.db"),
    ("bench", "devices"),
    ("--help",),
)


@pytest.mark.slow
def test_a_calibration_survives_a_full_disk_and_an_encoding(run: Path):
    arguments = ("calibrate", "run.toml", "--no-report")
    code, _, error = shell(run, "> /dev/full", *arguments)
    assert (code, error.count("\n")) == (2, 1)
    assert "run.calibration.json" in error
    load(run.with_name("run.calibration.json"))
    code, output, error = shell(run, "", *arguments, PYTHONIOENCODING="ascii")
    assert (code, error, output.isascii()) == (0, "", True)
    assert "triad" in output


ENCODINGS = {
    "cp1252": {"PYTHONIOENCODING": "cp1252"},
    "ascii": {"PYTHONIOENCODING": "ascii"},
    "C": {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"},
}
OUTPUTS = ("> /dev/full", "cp1252", "| head -1", "ascii", ">&-", "C", "<&-", "2>&-", "2> /dev/full")
# Each verb with one output; the verbs are more than the outputs.
PAIRS = chosen(
    product(VERBS, OUTPUTS),
    [(verb, OUTPUTS[k % len(OUTPUTS)]) for k, verb in enumerate(VERBS)],
)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("arguments", "to"), PAIRS, ids=lambda one: one if isinstance(one, str) else " ".join(one)
)
def test_each_verb_ends_well_whatever_its_output_is(run: Path, arguments: tuple[str, ...], to: str):
    calibration = run.with_name("run.calibration.json")
    before = calibration.stat().st_mtime_ns
    encoding = ENCODINGS.get(to)
    code, output, error = shell(run, "" if encoding else to, *arguments, **encoding or {})
    if encoding:
        assert (code, "Traceback" in error) == (0, False), error
    elif to == "| head -1":
        assert (code, output.count("\n")) == (0, 1)
        assert error.count("\n") == 0 or "inercal: warning" in error
    elif to == "> /dev/full":
        assert (code, error.count("\n")) == (2, 1), error
    else:
        assert (code, error) == (0, "")
    if arguments[0] == "calibrate":
        assert to != "> /dev/full" or "run.calibration.json" in error
        assert calibration.stat().st_mtime_ns > before
        load(calibration)


@pytest.mark.evidence  # its sample: a calibration that survives a full disk
@pytest.mark.parametrize(
    ("redirection", "status", "encoding"),
    [
        ("> /dev/full", 2, "utf-8"),
        ("| head -1", 0, "utf-8"),
        ("", 0, "ascii"),
        ("", 0, "cp1252"),
    ],
)
def test_a_run_on_a_bench_is_finished_whatever_its_output_is(
    run: Path, tmp_path: Path, redirection: str, status: int, encoding: str
):
    folder = str(tmp_path / "demo")
    arguments = ("demo", "--quick", "--out", folder)
    code, _, error = shell(run, redirection, *arguments, PYTHONIOENCODING=encoding)
    assert (code, "Traceback" in error) == (status, False), error
    load(tmp_path / "demo" / "mimu.calibration.json")
    assert (folder in error.splitlines()[-1]) == (status == 2)


@pytest.mark.slow
@pytest.mark.parametrize("encoding", ["cp1252", evidence("ascii"), evidence("utf-8")])
def test_json_is_json_in_every_encoding(run: Path, encoding: str):
    arguments = ("calibrate", "run.toml", "--no-report", "--json")
    code, output, _ = shell(run, "", *arguments, PYTHONIOENCODING=encoding)
    text = output.encode("latin-1").decode(encoding)
    assert (code, json.loads(text)["sensor"]["name"]) == (0, "triad \x1b[2J µ√")


@pytest.mark.slow
def test_control_characters_of_names_never_reach_the_terminal(run: Path):
    for arguments in (
        ("calibrate", "run.toml", "--no-report"),
        ("store", "list", "--register", "register.db"),
        ("store", "show", "1", "--register", "register.db"),
        ("store", "show", "\x1b[2J", "--register", "register.db"),
        ("calibrate", "\x1b]0;title\x07.toml"),
        ("calibrat\x1b[2J",),
    ):
        _, output, error = shell(run, "", *arguments)
        assert "\x1b[2J" not in output + error
        assert "\x1b]" not in output + error
        assert "\x07" not in output + error
