"""Runs of method systematic from a run file: simulated, calibrated, planned, refused."""

import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from tests.base_seeds import evidence
from tests.refusals import refused

from inercal.basics.errors import InputError, NotObserved
from inercal.benches.turntable.paths import systematic_path
from inercal.pipeline import calibrate, simulate_files
from inercal.pipeline.design.turntable_path import turntable_path_sheet
from inercal.recordings import Recording
from inercal.recordings.io.write import write_recordings
from inercal.report import write_report
from inercal.runfile import read

EXAMPLE = Path(__file__).parents[2] / "examples" / "systematic" / "imu.toml"


def run_file(folder: Path, *changes: tuple[str, str], name: str = "imu.toml") -> Path:
    text = EXAMPLE.read_text(encoding="utf-8").replace('"50 Hz"', '"20 Hz"')
    text = text.replace("imu.csv", "imu.npz")
    for old, new in changes:
        assert old in text, old
        text = text.replace(old, new)
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return path


def simulated(path: Path, seed: int, edit: Callable[[Recording], Recording] | None = None) -> Path:
    """Simulate a run, and change its recording before it is written."""
    run = read(path)
    made = simulate_files(run, seed)
    for name, one in made.items():
        write_recordings({run.file(name): one if edit is None else edit(one)})
    return path


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with one recording of short rests."""
    made = tmp_path_factory.mktemp("systematic")
    simulated(run_file(made, ('path = "systematic"', 'path = "systematic"\nseconds = "20 s"')), 3)
    return made


@pytest.mark.slow
@pytest.mark.parametrize("runs", [2, evidence(6)])
def test_errors_are_as_large_as_stated_in_simulations_of_the_package(tmp_path: Path, runs: int):
    squares: list[float] = []
    for seed in range(runs):
        run = read(simulated(run_file(tmp_path), seed))
        outcome = calibrate(run)
        sensor, found = outcome.calibration.sensor, outcome.estimate
        truth = np.array([run.truth.get(name, 0.0) for name in sensor.coefficients])
        p = truth.size
        off = found.value[:p] - truth
        squares.append(float(off @ np.linalg.solve(found.covariance[:p, :p], off)) / p)
        assert outcome.verdict.grade != "unreliable"
    assert 0.7 < np.mean(squares) < 1.4


@pytest.mark.slow
def test_the_calibration_states_frame_lag_and_shared_errors(folder: Path, tmp_path: Path):
    outcome = calibrate(folder / "imu.toml")
    calibration = outcome.calibration
    assert calibration.frame == "triangular"
    assert {one.name for one in calibration.shared or ()} == {"g", "latitude"}
    assert "lag of the accelerometers" in calibration.conditions
    assert outcome.observations.labels == tuple(f"p{k}" for k in range(1, 20))
    page = write_report(outcome, tmp_path / "report.html").read_text(encoding="utf-8")
    for words in ("Velocity after turns", "velocity over a rest", "one hour"):
        assert words in page


@pytest.mark.slow
def test_the_path_has_nineteen_rests_and_level_turns(folder: Path):
    steps = systematic_path()
    assert len(steps) == 19
    sheet = turntable_path_sheet(read(folder / "imu.toml"))
    assert sheet.warnings == ()
    expected = {one.name: one.std for one in sheet.expected}
    outcome = calibrate(folder / "imu.toml")
    stated = dict(
        zip(outcome.calibration.sensor.coefficients, outcome.calibration.std, strict=True)
    )
    ratios = [expected[name] / stated[name] / float(outcome.estimate.birge) for name in stated]
    assert np.allclose(ratios, 1.0, atol=0.1)


def path_table(folder: Path, angles: list[tuple[int, int, int]]) -> None:
    rows = ["label,kind,outer [°],middle [°],inner [°],seconds [s]"]
    rows += [f"r{k},position,{a},{b},{c},15" for k, (a, b, c) in enumerate(angles)]
    (folder / "path.csv").write_text("\n".join(rows) + "\n", encoding="utf-8")


@pytest.mark.slow
def test_the_plan_warns_of_turns_about_the_vertical_with_the_axis(tmp_path: Path):
    # z turns about the vertical only; x and y about level axes
    path_table(
        tmp_path,
        [(0, 0, 0), (90, 0, 0), (0, 0, 0), (0, 90, 0), (0, 180, 0), (0, 270, 0), (0, 0, 0),
         (0, 0, 90), (0, 0, 180), (0, 0, 270), (0, 0, 0)],
    )  # fmt: skip
    path = run_file(tmp_path, ('path = "systematic"', 'path = "path.csv"'))
    sheet = turntable_path_sheet(read(path))
    assert [text.split()[2] for text in sheet.warnings] == ["z"]
    outcome = calibrate(simulated(path, 1))
    assert any(one.what == "path" for one in outcome.findings)
    std = dict(zip(outcome.calibration.sensor.coefficients, outcome.estimate.std, strict=False))
    assert std["gz.scale"] > 10 * std["gx.scale"]


def test_a_path_without_turns_about_z_names_the_coefficients_it_leaves_open(tmp_path: Path):
    angles = [(0, 0, 0), (0, 90, 0), (0, 180, 0), (0, 270, 0), (0, 0, 0), (0, 0, 90), (0, 0, 180),
              (0, 0, 270)]  # fmt: skip
    path_table(tmp_path, angles)
    path = run_file(tmp_path, ('path = "systematic"', 'path = "path.csv"'))
    with refused(NotObserved, names=("gx.delta_p", "gy.delta_o", "gz.scale")):
        turntable_path_sheet(read(path))
    simulated(path, 1)
    with refused(NotObserved, names=("gx.delta_p", "gy.delta_o", "gz.scale")):
        calibrate(path)


UNUSED = {
    '[bench] lean': ('kind = "turntable"', 'kind = "turntable"\nlean = "4 ″"'),
    '[bench] azimuth': ('kind = "turntable"', 'kind = "turntable"\nazimuth = "1 ° ± 1 °"'),
    '[data] table': ('label = "step"', 'label = "step"\ntable = ["outer", "middle", "inner"]'),
    "[data] marks": ('label = "step"', 'label = "step"\nmarks = "labels"'),
    "[sensor.gyro] white": ('white = "0.1 °/√h"', ""),
}  # fmt: skip


@pytest.mark.parametrize("key", UNUSED)
def test_keys_without_use_and_missing_noise_are_refused_by_name(folder: Path, key: str):
    path = run_file(folder, UNUSED[key], name="refused.toml")
    with refused(InputError, key=key):
        calibrate(path)


def test_a_key_of_this_method_is_refused_with_others(tmp_path: Path):
    shutil.copytree(EXAMPLE.parents[1] / "turntable", tmp_path, dirs_exist_ok=True)
    path = tmp_path / "mimu.toml"
    text = path.read_text(encoding="utf-8")
    path.write_text(text.replace("[data]", '[data]\nsample = "mean"'), encoding="utf-8")
    with refused(InputError, key="[data] sample"):
        calibrate(path)
    path.write_text(text.replace('"38 °"', '"38 ° ± 0.1 °"'), encoding="utf-8")
    with refused(InputError, key="[bench] latitude"):
        read(path)


def test_means_are_no_simulation_of_the_package(tmp_path: Path):
    path = run_file(tmp_path, ('label = "step"', 'label = "step"\nsample = "mean"'))
    with refused(InputError, key="[data] sample"):
        simulated(path, 0)


def _cut(first: float, last: float) -> Callable[[Recording], Recording]:
    def edit(one: Recording) -> Recording:
        keep = slice(*np.searchsorted(one.time, [first, last]).tolist())
        return _some(one, np.arange(one.time.size)[keep])

    return edit


def _some(one: Recording, rows: np.ndarray) -> Recording:
    labels = None if one.labels is None else one.labels[rows]
    readback = {name: column[rows] for name, column in one.readback.items()}
    return replace(one, time=one.time[rows], data=one.data[rows], labels=labels, readback=readback)


def _gap(one: Recording) -> Recording:
    # The first turn is from 35 to 39 s.
    lost = (one.time > 36.5) & (one.time < 36.7)
    return _some(one, np.flatnonzero(~lost))


DAMAGES = {
    "begins in motion": _cut(37.0, 1e9),
    "ends in motion": _cut(0.0, 37.0 + 14 * 24.0),
    "p1 to p2": _gap,
    "rests": _cut(0.0, 70.0),
}


@pytest.mark.parametrize("damage", DAMAGES)
def test_damaged_recordings_are_refused_by_name(tmp_path: Path, damage: str):
    path = run_file(tmp_path, ('path = "systematic"', 'path = "systematic"\nseconds = "20 s"'))
    simulated(path, 3, DAMAGES[damage])
    with refused(InputError) as refusal:
        calibrate(path)
    assert damage in str(refusal.value)


def test_clipped_readings_are_refused(tmp_path: Path):
    path = run_file(
        tmp_path,
        ('path = "systematic"', 'path = "systematic"\nseconds = "20 s"'),
        ('"150 °/s"', '"20 °/s"'),
    )
    simulated(path, 3)
    with refused(InputError, names=("gx",)):
        calibrate(path)


@pytest.mark.slow
def test_a_recording_of_another_path_is_named(folder: Path):
    other = ('path = "systematic"', 'path = "fast"')
    outcome = calibrate(run_file(folder, other, name="other.toml"))
    assert any(one.what == "path" and "stated plan" in one.message for one in outcome.findings)
    own = calibrate(folder / "imu.toml")
    np.testing.assert_array_equal(outcome.estimate.value, own.estimate.value)


@pytest.mark.slow
def test_the_readback_of_a_table_is_worth_a_factor_that_the_guide_states(tmp_path: Path):
    path = simulated(run_file(tmp_path), 0)
    alone = calibrate(path)
    text = path.read_text(encoding="utf-8")
    for old, new in (
        ('name = "systematic"', 'name = "turntable_kalman"'),
        ('path = "systematic"', 'path = "systematic"\nseconds = "40 s"\nalso = ["k2"]'),
        ('"48.10 ° ± 0.01 °"', '"48.1 °"'),
        ('label = "step"', 'label = "step"\ntable = ["outer", "middle", "inner"]'),
    ):
        assert old in text
        text = text.replace(old, new)
    with_angles = tmp_path / "angles.toml"
    with_angles.write_text(text, encoding="utf-8")
    read_back = calibrate(with_angles)
    std = [
        dict(zip(one.calibration.sensor.coefficients, one.estimate.std, strict=False))
        for one in (alone, read_back)
    ]
    ratio = {name: std[0][name] / std[1][name] for name in std[0] if name in std[1]}
    for terms, low, high in (
        (("k1", "bias"), 0.9, 1.3), (("scale",), 1.5, 2.2), (("k0", "k2"), 2.2, 7.0),
        (("delta_o", "delta_p"), 1.5, 7.0),
    ):  # fmt: skip
        sizes = [one for name, one in ratio.items() if name.partition(".")[2] in terms]
        assert low < min(sizes)
        assert max(sizes) < high
