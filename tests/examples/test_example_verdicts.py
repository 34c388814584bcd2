"""Examples: their verdicts, fit for a customer without keys, and the truth that is simulated."""

import shutil
from pathlib import Path

import numpy as np
import pytest
from scipy.special import chdtri
from tests.base_seeds import evidence, slow
from tests.calibration.short_lines import KEY, require_short

from inercal.calibration.explanation import UNDETECTABLE, customer_lines, customer_sections
from inercal.pipeline import Outcome, calibrate, simulate_files
from inercal.recordings.io.write import write_recordings
from inercal.runfile import Run, read

EXAMPLES = Path(__file__).parents[2] / "examples"
# Examples that a host, an instrument or another file must precede: other tests run these.
_OTHERS = {
    "bench/plan", "check_standard/job", "fleet/run", "logs/poses", "measure/head",
    "measure/plate", "one_axis_arm/arm", "own_bench/tilt", "rate_table/ship_bench", "live/imu",
    "turntable/soaks",
}  # fmt: skip
# These take seconds, most for their simulation.
_SLOW = {
    "centrifuge/arm_run", "centrifuge/lab", "centrifuge/printed", "hand_held/mpu9150",
    "hand_held/simulated", "hand_held/xsens", "magnetometer/motion", "magnetometer/nine_axes",
    "rate_platform/imu", "rate_platform/small_rates",
    "six_position/archive", "systematic/imu",
    "temperature/soaks", "turntable/filter_keys", "turntable/mimu", "turntable/two_clocks",
}  # fmt: skip
# Like others; tests of recordings or the record of all numbers calibrate these too.
_RARE = {
    "centrifuge/printed", "hand_held/mpu9150", "hand_held/xsens", "rate_platform/imu",
    "rate_platform/small_rates", "six_position/archive", "turntable/filter_keys",
    "turntable/two_clocks",
}  # fmt: skip
RUN_FILES = [
    str(path.relative_to(EXAMPLES).with_suffix(""))
    for path in sorted(EXAMPLES.glob("**/*.toml"))
    if "\n[method]\n" in path.read_text(encoding="utf-8")
]


def test_only_examples_that_exist_are_left_out():
    assert set(RUN_FILES) >= _OTHERS | _SLOW | _RARE


@pytest.fixture(scope="module")
def examples(tmp_path_factory: pytest.TempPathFactory, data_dir: Path) -> Path:
    """Return a copy of the examples, in which recordings are simulated."""
    folder = tmp_path_factory.mktemp("copy")
    (folder / "shared").mkdir()
    (folder / "shared" / "data").symlink_to(data_dir)
    return Path(shutil.copytree(EXAMPLES, folder / "work" / "examples"))


def simulated_and_calibrated(run: Run) -> Outcome:
    """Return the outcome; what was simulated for it errs as stated."""
    if run.file(run.data.file).exists():
        return calibrate(run)
    made = {run.file(file): recording for file, recording in simulate_files(run).items()}
    write_recordings(made)
    outcome = calibrate(run)
    for path in made:  # other examples simulate files of the same name
        path.unlink()
    calibration = outcome.calibration
    truth = [run.truth.get(name, 0.0) for name in calibration.sensor.coefficients]
    error = calibration.values - np.array(truth)
    nees = error @ np.linalg.solve(calibration.covariance, error)
    # 0.05 and 99.95 % points
    assert chdtri(error.size, 0.9995) < nees < chdtri(error.size, 0.0005)
    return outcome


@pytest.mark.parametrize(
    "name",
    [
        evidence(name) if name in _RARE else slow(name) if name in _SLOW else name
        for name in RUN_FILES
        if name not in _OTHERS
    ],
)
def test_the_verdict_of_an_example_is_six_short_lines_with_an_explanation(
    name: str, examples: Path
):
    run = read(examples / f"{name}.toml")
    outcome = simulated_and_calibrated(run)
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
