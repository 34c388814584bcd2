"""The example of the guide, run as a user runs it; the table of the guide."""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from tests.program import run_program

from inercal.export import TARGETS
from inercal.export.readers import READERS

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "how-to" / "export.md").read_text(encoding="utf-8")


@pytest.mark.slow
def test_the_guide_shows_the_example_and_what_it_prints_and_its_header_runs(tmp_path: Path):
    script = ROOT / "examples" / "export" / "in_python.py"
    assert script.read_text(encoding="utf-8").split('"""\n\n')[1] in PAGE
    done = subprocess.run(
        [sys.executable, "-W", "error", script],
        cwd=tmp_path,
        env=os.environ | {"PYTHONIOENCODING": "utf-8"},
        capture_output=True,
        encoding="utf-8",
        check=True,
    )
    assert f"```text\n{done.stdout}```" in PAGE
    assert {path.name for path in tmp_path.iterdir()} == {"imu.h", "imu.params"}
    if shutil.which("gcc") is None:
        pytest.skip("the rest needs gcc")
    main = shutil.copy(ROOT / "examples" / "export" / "main.c", tmp_path)
    flags = ["-std=c99", "-Wall", "-Wextra", "-Werror", "-I", str(tmp_path)]
    subprocess.run(["gcc", *flags, main, "-o", tmp_path / "main"], check=True)
    printed = subprocess.run([tmp_path / "main"], capture_output=True, text=True, check=True).stdout
    assert f"`{printed.strip()}`" in PAGE


@pytest.mark.slow
def test_the_guide_shows_what_the_example_of_kalibr_prints(tmp_path: Path):
    script = ROOT / "examples" / "export" / "from_kalibr.py"
    done = subprocess.run(
        [sys.executable, "-W", "error", script],
        cwd=tmp_path,
        env=os.environ | {"PYTHONIOENCODING": "utf-8"},
        capture_output=True,
        encoding="utf-8",
        check=True,
    )
    assert f"```text\n{done.stdout}```" in PAGE
    assert {path.name for path in tmp_path.iterdir()} == {"imu.basalt.json"}


def test_the_guide_lists_the_targets():
    assert re.findall(r"^\| `(\w[\w-]*)` \|", PAGE, flags=re.MULTILINE) == list(TARGETS)


@pytest.mark.parametrize(
    ("arguments", "names"),
    [(("export", "x.json"), list(TARGETS)), (("import", "x.json"), list(READERS))],
    ids=["export", "import"],
)
def test_a_verb_without_target_or_format_lists_them(arguments: tuple[str, ...], names: list[str]):
    ended = run_program(*arguments)
    assert ended.status == 2
    listed = re.split(r"[^\w-]+", ended.error.partition(": ")[2])
    assert [word for word in listed if word in names] == names
