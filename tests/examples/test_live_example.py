"""The example of the page on live correction prints what the page shows."""

import re
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from inercal.calibration.files import load, save
from inercal.pipeline import apply, calibrate, simulate_files
from inercal.pipeline.live_correction import LiveCorrector
from inercal.recordings.io.write import write_recordings
from inercal.runfile import read

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "how-to" / "apply.md").read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def calibration_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("live")
    text = (ROOT / "examples" / "ferraris_simulated" / "run.toml").read_text(encoding="utf-8")
    (folder / "run.toml").write_text(text, encoding="utf-8")
    recordings = simulate_files(folder / "run.toml")
    write_recordings({folder / name: one for name, one in recordings.items()})
    return save(calibrate(folder / "run.toml").calibration, folder / "run.calibration.json")


def test_the_example_prints_the_lines_of_the_page(calibration_file: Path):
    example = ROOT / "examples" / "live"
    command = [sys.executable, "-m", "inercal", "apply", str(calibration_file)]
    command += [str(example / "imu.toml"), "--stream", str(example / "lines.csv")]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    (shown,) = re.findall(r"```text\n(.*?)```", PAGE, flags=re.S)
    assert done.stdout == shown


def test_the_python_of_the_page_gives_the_first_line(
    calibration_file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    shutil.copytree(ROOT / "examples" / "live", tmp_path / "examples" / "live")
    shutil.copytree(calibration_file.parent, tmp_path / "examples" / "ferraris_simulated")
    monkeypatch.chdir(tmp_path)
    (code,) = re.findall(r"```python\n(.*?)```", PAGE, flags=re.S)
    found: dict[str, Any] = {}
    exec(compile(code, "apply.md", "exec"), found)
    first = re.findall(r"^0\.0000000,(.*)$", PAGE, flags=re.M)[0].split(",")
    assert [f"{value:.9g}" for value in found["block"].values[0]] == first[:-1]


def test_the_example_agrees_with_apply(calibration_file: Path):
    calibration = load(calibration_file)
    run = read(ROOT / "examples" / "live" / "imu.toml")
    recording = apply(calibration, run)
    lines = np.loadtxt(ROOT / "examples" / "live" / "lines.csv", delimiter=",")
    block = LiveCorrector(calibration, run).correct(
        lines[:, 0], lines[:, 1:7], lines[:, 7] + 273.15
    )
    np.testing.assert_array_equal(block.values[:, :6], recording.data)
    assert block.flags.tolist() == [0, 0, 0, 1, 0]
