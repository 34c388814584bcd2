"""A plan on a rate table simulated as a recording, and calibrated from it."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from tests.base_seeds import evidence
from tests.refusals import refused

from inercal.benches import RateTable
from inercal.benches.rate_table.reading import reduce_recording
from inercal.pipeline import apply, apply_data_columns, calibrate, simulate
from inercal.recordings.io.write import write_recording
from inercal.report.report_tables import coefficients
from inercal.runfile import Run, read

EXAMPLE = Path(__file__).parents[2] / "examples" / "rate_table" / "ship_recording.toml"
EXACT = (
    ('"9.7936 m/s² ± 0.5 mm/s²"', '"9.7936 m/s² ± 0"'),
    ('"250 mm ± 0.3 mm"', '"250 mm ± 0"'),
    ('seat = "0.5 mm"', 'seat = "0 mm"'),
    ('pose = "0.2 °"', 'pose = "0 °"'),
    ('speed = "0.05 %"', 'speed = "0 %"'),
    ('lean = "0.05 °"', 'lean = "0 °"'),
    ('white = "300 µg/√Hz"', 'white = "1e-9 µg/√Hz"'),
    ('quantisation = "122.0703125 µg"', ""),
)


def run_of(folder: Path, *changes: tuple[str, str]) -> Run:
    text = EXAMPLE.read_text(encoding="utf-8")
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    (folder / "ship_recording.toml").write_text(text, encoding="utf-8")
    return read(folder / "ship_recording.toml")


def truth(run: Run) -> np.ndarray:
    return np.array([run.truth.get(name, 0.0) for name in run.sensor.coefficients])


def test_the_example_is_simulated_and_calibrated(tmp_path: Path):
    run = run_of(tmp_path)
    path = run.file(run.data.file)
    write_recording(apply_data_columns(run, simulate(run)), path)
    header = path.read_text(encoding="utf-8").splitlines()[1]
    assert header == "time,ax,ay,az,mounting,rpm"
    outcome = calibrate(run)
    assert outcome.estimate.consistent
    assert not outcome.findings
    assert len(outcome.steps) == len(run.steps)
    error = outcome.calibration.values - truth(run)
    nees = float(error @ np.linalg.solve(outcome.calibration.covariance, error))
    assert 3 < nees < 36  # χ² of twelve: its 0.5 % and 99.97 % points


def test_without_noise_and_errors_the_truth_comes_back(tmp_path: Path):
    run = run_of(tmp_path, *EXACT)
    write_recording(apply_data_columns(run, simulate(run)), run.file(run.data.file))
    error = calibrate(run).calibration.values - truth(run)
    assert np.abs(error / run.sensor.unit_scale).max() < 1e-10


def test_a_result_in_the_symmetric_frame_is_compared_with_the_truth_in_it(tmp_path: Path):
    framed = ('name = "model 12, midships"', 'name = "m"\nframe = "symmetric"')
    damped = ('"ship_multi_angle"', '"ship_multi_angle"\nestimator = "damped"')
    run = run_of(tmp_path, *EXACT[:-2], framed, damped)
    write_recording(apply_data_columns(run, simulate(run)), run.file(run.data.file))
    outcome = calibrate(run)
    error = outcome.calibration.values - truth(run)
    # What is stated is in the frame of the mountings.
    assert np.abs(error / outcome.calibration.std).max() > 10
    (group,) = coefficients(outcome, run.truth)
    rows = [row for axis in group.axes for row in axis]
    print([row.error for row in rows])
    assert not any(row.error_is_large for row in rows)


def squares(run: Run, seed: int, trials: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the NEES per coefficient, and χ² over its degrees of freedom, (trials,)."""
    assert isinstance(run.bench, RateTable)
    whole = apply_data_columns(run, simulate(run, seed, trials))
    whole = replace(
        whole, channels=run.sensor.channels, readback={"arm_rate": whole.readback["rpm"]}
    )
    true, joint = truth(run), run.method.estimator("joint")
    found: list[tuple[float, float]] = []
    for data in whole.data:
        made = reduce_recording(run, replace(whole, data=data))
        estimate = joint(made.observations, run.sensor, run.bench, made.steps, ())
        alone = estimate.select(run.sensor.coefficients)
        error = alone.value - true
        nees = float(error @ np.linalg.solve(alone.covariance, error)) / error.size
        found.append((nees, float(estimate.chi2) / estimate.dof))
    nees, chi2 = np.array(found).T
    return nees, chi2


SHORT = (('seconds = "15 s"', 'seconds = "8 s"'), ('"50 Hz"', '"25 Hz"'))


def nees_and_chi_squared(run: Run, seed: int, trials: int) -> None:
    nees, chi2 = squares(run, seed, trials)
    print(f"NEES {nees.mean():.3f}, χ² / dof {chi2.mean():.3f} ± {chi2.std() / trials**0.5:.3f}")
    assert nees.mean() == pytest.approx(1, abs=4 * np.sqrt(2 / 12 / trials))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("seed", "trials"),
    [
        (1, 20),
        *(evidence(seed, 60) for seed in (1, 2, 3)),
        *(evidence(k, 300) for k in (11, 12, 13)),
    ],
)
@pytest.mark.parametrize("lean", ["0.05 °", "0.3 °"])
def test_simulated_recordings_err_as_their_calibrations_state(
    tmp_path: Path, seed: int, trials: int, lean: str
):
    nees_and_chi_squared(
        run_of(tmp_path, *SHORT, ('lean = "0.05 °"', f'lean = "{lean}"')), seed, trials
    )


def test_a_recording_needs_a_rate_to_be_simulated(tmp_path: Path):
    run = run_of(tmp_path, ('rate = "50 Hz"', ""))
    with refused(key="[data] rate", file=run.path):
        simulate(run)


def test_states_that_are_too_short_are_named_in_the_verdict(tmp_path: Path):
    run = run_of(tmp_path, ('seconds = "15 s"', 'seconds = "3 s"'))
    write_recording(apply_data_columns(run, simulate(run)), run.file(run.data.file))
    outcome = calibrate(run)
    (finding,) = outcome.findings
    assert finding.message.startswith("9 states left out: XY at 46 rpm, YX at 46 rpm, ")
    assert finding.message.endswith("; 3 are needed)")
    assert finding.message in outcome.verdict.statements


def test_a_wrong_rate_unit_of_a_recording_is_detected_by_the_norms(tmp_path: Path):
    run = run_of(tmp_path, ('seconds = "15 s"', 'seconds = "5 s"'))
    made = apply_data_columns(run, simulate(run))
    turned = {name: rate * np.pi / 30 for name, rate in made.readback.items()}
    write_recording(replace(made, readback=turned), run.file(run.data.file))
    with refused(key="[data] arm_rate_unit", file=run.path, names=("rad/s",)):
        calibrate(run)


@pytest.mark.slow
def test_what_is_written_is_whole_codes_and_keeps_its_names_when_corrected(tmp_path: Path):
    run = run_of(tmp_path, ('seconds = "15 s"', 'seconds = "6 s"'))
    made = simulate(run)
    assert np.array_equal(made.data, np.round(made.data))
    write_recording(apply_data_columns(run, made), run.file(run.data.file))
    corrected = apply(calibrate(run).calibration, run)
    write_recording(corrected, tmp_path / "corrected.csv")
    header = (tmp_path / "corrected.csv").read_text(encoding="utf-8").splitlines()[1]
    assert header == "time,fx,fy,fz,mounting,rpm"
