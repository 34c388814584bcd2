"""The example of a guided measurement, as its page has it."""

import re
import shutil
from pathlib import Path

import pytest
from tests.host.guided_runs import measure
from tests.program import run_program

from inercal.pipeline import calibrate
from inercal.runfile import read

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "how-to" / "measure.md").read_text(encoding="utf-8")


@pytest.fixture
def example(tmp_path: Path) -> Path:
    return Path(shutil.copytree(ROOT / "examples" / "measure", tmp_path / "measure"))


def test_piped_readings_are_calibrated_to_the_truth(example: Path):
    run_file = example / "plate.toml"
    given = (example / "readings.txt").read_text(encoding="utf-8")
    done = measure(run_file, given=[given])
    assert (done.status, done.error) == (0, "")
    (printed,) = re.findall(r"```text\n(6 positions.*?)```", PAGE, flags=re.S)
    assert done.output.startswith(printed)
    outcome = calibrate(run_file)
    assert outcome.verdict.grade == "consistent"
    calibration, truth = outcome.calibration, read(run_file).truth
    for name, value in zip(calibration.sensor.coefficients, calibration.values, strict=True):
        assert abs(value - truth.get(name, 0.0)) < 2 * calibration.uncertainty(name)


def test_what_the_page_says_of_mistakes_is_said(example: Path):
    run_file, table = example / "run.toml", example / "sheet.csv"
    text = (example / "plate.toml").read_text(encoding="utf-8").replace("plate.csv", "sheet.csv")
    said: list[str] = []
    for rows, kind in (("q_p,,,", "means"), ("x_p,1.0,,", "means"), ("", "recording")):
        run_file.write_text(text.replace('"means"', f'"{kind}"'), encoding="utf-8")
        table.write_text(f"position,ax,ay,az\n{rows}\n", encoding="utf-8")
        error = measure(run_file, given=[]).error.strip()
        said.append(error.replace(f"{example}/", ""))
    assert said == re.findall(r"^\| .* \| `(inercal: .*)` \|$", PAGE, flags=re.M)


def test_the_plan_of_the_example_is_printed(example: Path):
    done = run_program("plan", example / "plate.toml", "--out", example / "plate.csv")
    assert done.status == 0
    assert f"inercal measure {example / 'plate.toml'}" in done.output
