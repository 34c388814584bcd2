"""The verdict of every example is short, explained whole, and fit for a customer without keys."""

import shutil
from pathlib import Path

import pytest
from tests.calibration.short_lines import KEY, require_short

from inercal.calibration.explanation import UNDETECTABLE, customer_lines, customer_sections
from inercal.pipeline import calibrate, simulate_files
from inercal.recordings.io.write import write_recordings
from inercal.runfile import read

EXAMPLES = Path(__file__).parents[2] / "examples"
# Examples that a host, an instrument or another file must precede: other tests run these.
_OTHERS = {
    "bench/plan", "check_standard/job", "fleet/run", "logs/poses", "measure/head",
    "measure/plate", "own_bench/tilt", "rate_table/ship_bench", "live/imu", "turntable/soaks",
}  # fmt: skip
# These take seconds, most for their simulation.
_SLOW = {
    "centrifuge/arm_run", "centrifuge/lab", "centrifuge/printed", "hand_held/mpu9150",
    "hand_held/simulated", "magnetometer/motion", "magnetometer/nine_axes",
    "rate_platform/imu", "rate_platform/small_rates",
    "six_position/archive", "systematic/imu",
    "temperature/soaks", "turntable/filter_keys", "turntable/mimu", "turntable/two_clocks",
}  # fmt: skip
RUN_FILES = [
    str(path.relative_to(EXAMPLES).with_suffix(""))
    for path in sorted(EXAMPLES.glob("**/*.toml"))
    if "\n[method]\n" in path.read_text(encoding="utf-8")
]


def test_only_examples_that_exist_are_left_out():
    assert set(RUN_FILES) >= _OTHERS | _SLOW


@pytest.mark.parametrize(
    "name",
    [
        pytest.param(name, marks=pytest.mark.slow if name in _SLOW else ())
        for name in RUN_FILES
        if name not in _OTHERS
    ],
)
def test_the_verdict_of_an_example_is_six_short_lines_with_an_explanation(
    name: str, tmp_path: Path, data_dir: Path
):
    folder = tmp_path / "work" / "examples"
    shutil.copytree(EXAMPLES, folder)
    (tmp_path / "shared").mkdir()
    (tmp_path / "shared" / "data").symlink_to(data_dir)
    run = read(folder / f"{name}.toml")
    if not run.file(run.data.file).exists():
        write_recordings({run.file(file): made for file, made in simulate_files(run).items()})
    outcome = calibrate(run)
    verdict = outcome.verdict
    require_short(verdict)
    assert outcome.calibration.notes == verdict.statements
    sections = dict(verdict.explanation)
    assert set(outcome.estimate.notes) & set(verdict.statements) or not outcome.estimate.notes
    count = len(sections.get(UNDETECTABLE, ()))
    assert not count or verdict.lines[-1].startswith(f"{count} effect")
    if verdict.grade != "consistent":
        assert any(line.startswith("Next: ") for line in verdict.lines)
    shown = [line for _, lines in customer_sections(verdict.explanation) for line in lines]
    assert not [line for line in (*shown, *customer_lines(verdict.lines)) if KEY.search(line)]
