"""The four sessions of examples/repeat, calibrated, and their repeatability."""

import shutil
from pathlib import Path

from tests.program import run_program

import inercal

EXAMPLES = Path(__file__).parents[2] / "examples" / "repeat"


def repeat_example(folder: Path) -> None:
    """Fill a folder with the example, its calibrations and what `inercal repeat` writes."""
    for file in EXAMPLES.iterdir():
        shutil.copy(file, folder)
    files: list[Path] = []
    for n in range(1, 5):
        found = inercal.calibrate(folder / f"session_{n}.toml").calibration
        files.append(inercal.save(found, folder / f"session_{n}.calibration.json"))
    ended = run_program("repeat", *files, "--out", folder)
    assert ended.status == 0, ended.error
