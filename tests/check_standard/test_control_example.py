"""The example of a check standard: its charts, the page, and the run that is marked by them."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from tests.program import run_program
from tests.report.page_tags import parsed

from inercal.pipeline import calibrate
from inercal.report.calibration_page import calibration_page

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def example(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with the example and what it writes; its output is in printed.txt."""
    folder = tmp_path_factory.mktemp("check") / "check_standard"
    shutil.copytree(ROOT / "examples" / "check_standard", folder)
    done = subprocess.run(
        [sys.executable, "-W", "error", folder / "thirty_days.py"],
        cwd=folder,
        env=os.environ | {"PYTHONIOENCODING": "utf-8", "COLUMNS": "100"},
        capture_output=True,
        encoding="utf-8",
        check=True,
    )
    (folder / "printed.txt").write_text(done.stdout, encoding="utf-8")
    return folder


@pytest.mark.slow
def test_the_guide_prints_what_the_example_prints(example: Path):
    printed = (example / "printed.txt").read_text(encoding="utf-8")
    guide = (ROOT / "docs" / "how-to" / "check-standard.md").read_text(encoding="utf-8")
    assert f"```text\n{printed}```" in guide


@pytest.mark.slow
def test_the_page_of_the_charts_is_whole(example: Path):
    text = (example / "REF-1.control.html").read_text(encoding="utf-8")
    tags = parsed(text)
    assert len(tags.ids) == len(set(tags.ids))
    assert text.count("<svg") == 4  # all together, and an axis each
    assert "JOB-26" in text
    assert "JOB-22" not in text


@pytest.mark.slow
def test_a_run_while_the_bench_was_out_of_control_is_marked(example: Path):
    outcome = calibrate(example / "job.toml")
    assert outcome.verdict.grade == "reservations"
    assert "check standard" in outcome.verdict.warned
    line = next(one for one in outcome.calibration.notes if one.startswith("check standard REF-1"))
    assert "out of control on 2026-03-28" in line
    assert "doubtful since 2026-03-25" in line
    assert outcome.calibration.conditions["check standard"].startswith("REF-1: out of control")
    assert "out of control on 2026-03-28" in calibration_page(outcome, None)
    # A week before the bench was in control.
    path = example / "job.toml"
    text = path.read_text(encoding="utf-8")
    path.write_text(text.replace("2026-03-28", "2026-03-23"), encoding="utf-8")
    earlier = calibrate(path)
    assert earlier.verdict.grade == "consistent"
    assert earlier.calibration.conditions["check standard"] == "REF-1: in control on 2026-03-23"
    path.write_text(text, encoding="utf-8")


@pytest.mark.slow
def test_the_verb_writes_nothing_over_other_files(example: Path):
    files = sorted(example.glob("*.json"))
    found = json.loads(files[0].read_text(encoding="utf-8"))
    assert found["in_control"] is False
    ended = run_program("control", *files, "--out", example)
    assert ended.status == 2
