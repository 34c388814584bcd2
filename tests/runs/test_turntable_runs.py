"""Run files on a turntable, from the path to the verdict."""

import json
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.refusals import refused

from inercal.basics.errors import InercalError, InputError, NotObserved
from inercal.benches import Turntable
from inercal.cli.app import app, main
from inercal.methods.turntable.model import coarse_bias, triad_model
from inercal.physics.plan import Position, Rotation
from inercal.pipeline import Outcome, apply, apply_data_columns, calibrate, simulate
from inercal.pipeline.budget.experiment_from_runfile import experiment_from_run
from inercal.pipeline.design.turntable_path import turntable_path_sheet
from inercal.recordings import Recording, Track
from inercal.recordings.io.write import write_recording
from inercal.report import write_report
from inercal.runfile import Run, read

ROOT = Path(__file__).parents[2]
EXAMPLE = ROOT / "examples" / "turntable"
FILE = ('file = "mimu.csv"', 'file = "mimu.npz"')
Change = tuple[str, str]


def copy_run(folder: Path, *changes: Change, path: str | None = None) -> Run:
    text = (EXAMPLE / "mimu.toml").read_text(encoding="utf-8")
    for old, new in (FILE, *changes):
        assert old in text, old
        text = text.replace(old, new)
    (folder / "mimu.toml").write_text(text, encoding="utf-8")
    steps = (EXAMPLE / "path.csv").read_text(encoding="utf-8") if path is None else path
    (folder / "path.csv").write_text(steps, encoding="utf-8")
    return read(folder / "mimu.toml")


def path_with_labels(*wanted: str) -> str:
    lines = (EXAMPLE / "path.csv").read_text(encoding="utf-8").splitlines()
    kept = [line for line in lines if line.partition(",")[0] in ("label", *wanted)]
    return "\n".join(kept) + "\n"


def simulate_recording(
    run: Run, seed: int = 0, change: Callable[[Recording], Recording] = lambda made: made
) -> Run:
    write_recording(change(apply_data_columns(run, simulate(run, seed))), run.file(run.data.file))
    return run


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with the example's recording."""
    made = tmp_path_factory.mktemp("example")
    simulate_recording(copy_run(made))
    return made


@pytest.fixture(scope="module")
def nominal_outcome(folder: Path) -> Outcome:
    """Return what that recording is calibrated to."""
    return calibrate(copy_run(folder))


def truth(run: Run) -> np.ndarray:
    return np.array([run.truth[name] for name in run.sensor.coefficients])


@pytest.mark.slow
def test_the_truth_lies_within_u_about_19_times_in_20(tmp_path: Path):
    run = copy_run(tmp_path)
    off: list[np.ndarray] = []
    for seed in range(10):
        made = calibrate(simulate_recording(run, seed)).calibration
        off.append((made.values - truth(run)) / made.std)
    within = np.mean(np.abs(off) < 2)
    assert 0.90 <= within <= 0.99
    assert 0.75 < np.sqrt(np.mean(np.square(off))) < 1.15


@pytest.mark.slow
def test_steps_are_found_with_their_labels(tmp_path: Path, nominal_outcome: Outcome):
    run, outcome = copy_run(tmp_path), nominal_outcome
    assert outcome.observations.labels == tuple(step.label for step in run.steps)
    for done, asked in zip(outcome.steps, run.steps, strict=True):
        assert isinstance(done, Position | Rotation)
        if isinstance(asked, Rotation):
            assert isinstance(done, Rotation)
            assert done.axis == asked.axis
            assert done.angle == pytest.approx(asked.angle, rel=1e-4)
    assert outcome.estimate.consistent
    assert outcome.observations.track is not None
    assert len(outcome.estimate.courses) == 2
    page = tmp_path / "page.html"
    write_report(outcome, page, run.truth)
    text = page.read_text(encoding="utf-8")
    for words in ('id="course"', "NIS per component", "angle by readback"):
        assert words in text
    assert len(text) < 600_000


@pytest.mark.slow
def test_without_labels_the_plan_names_the_steps(tmp_path: Path):
    run = simulate_recording(copy_run(tmp_path, ('label = "step"\n', "")))
    labels = calibrate(run).observations.labels
    assert labels == tuple(step.label for step in run.steps)
    other = copy_run(tmp_path, ('label = "step"\n', ""), ('"path.csv"', '"fast"'))
    labels = calibrate(other).observations.labels
    assert labels[:2] == ("hold 1", "hold 2")
    assert "turn 1" in labels


def wrap_readback(made: Recording) -> Recording:
    return replace(made, readback={n: a % 360.0 for n, a in made.readback.items()})


@pytest.mark.slow
@pytest.mark.parametrize(
    ("changes", "change"),
    [
        ((), wrap_readback),
        ((("[method]", 'table_unit = "rad"\n\n[method]'),), lambda made: made),
        ((('["outer", "middle", "inner"]', '["A1", "A2", "A3"]'),), lambda made: made),
        ((('table = ["outer", "middle", "inner"]\n', ""),), lambda made: made),
    ],
    ids=["modulo a turn", "in rad", "other names", "names by default"],
)
def test_the_result_does_not_depend_on_how_the_readback_is_written(
    tmp_path: Path,
    nominal_outcome: Outcome,
    changes: tuple[Change, ...],
    change: Callable[[Recording], Recording],
):
    other = calibrate(simulate_recording(copy_run(tmp_path, *changes), change=change)).calibration
    np.testing.assert_allclose(
        other.values, nominal_outcome.calibration.values, rtol=1e-6, atol=1e-9
    )


@pytest.mark.slow
def test_lost_samples_cost_little(tmp_path: Path):
    run = copy_run(tmp_path)

    def lossy(made: Recording) -> Recording:
        return made.take(np.random.default_rng(1).random(made.time.size) > 1e-3)

    made = calibrate(simulate_recording(run, change=lossy)).calibration
    error = made.values - truth(run)
    assert 7 < error @ np.linalg.solve(made.covariance, error) < 51  # 0.1 % points of χ²


def test_a_calibration_corrects_its_own_recording(folder: Path, nominal_outcome: Outcome):
    corrected = apply(nominal_outcome.calibration, copy_run(folder))
    force = np.linalg.norm(corrected.data[500:2500, :3].mean(axis=0))
    assert force == pytest.approx(9.80123, abs=1e-3)
    assert corrected.channels == ("fx", "fy", "fz", "wx", "wy", "wz")


def refused_run(
    run: Run, mention: str = "", kind: type[InercalError] = InputError, **data: Any
) -> None:
    """Expect an error of one line with this data that mentions a key, a column or a value."""
    with refused(kind, **data) as refusal:
        calibrate(run)
    assert str(refusal.value).isprintable()
    assert mention in str(refusal.value)


def test_a_first_rest_that_is_too_short_is_refused(tmp_path: Path):
    short = path_with_labels("warm-up", "y up", "x+").replace("0,0,0,30", "0,0,0,12")
    refused_run(simulate_recording(copy_run(tmp_path, path=short)), "20 s")


@pytest.mark.parametrize("seconds", [20.0, 19.8, 19.05])
def test_a_first_rest_of_20_s_less_its_settling_is_accepted(folder: Path, seconds: float):
    run = copy_run(folder)
    assert isinstance(run.bench, Turntable)
    time = np.arange(round(100 * seconds) + 1) / 100
    track = Track(time, np.ones((time.size, 6)), np.zeros((time.size, 3)), np.zeros(time.size, int))
    assert np.isfinite(coarse_bias(run.bench, track, triad_model(run.sensor, "f"))).all()


@pytest.mark.slow
def test_unobserved_directions_of_a_path_are_named(tmp_path: Path):
    path = path_with_labels("warm-up", "y up", "z down")
    refused_run(simulate_recording(copy_run(tmp_path, path=path)), "gyros", NotObserved)


def insert_nan(name: str) -> Callable[[Recording], Recording]:
    def change(made: Recording) -> Recording:
        values = made.readback[name].copy()
        values[700] = np.nan
        return replace(made, readback={**made.readback, name: values})

    return change


def test_data_that_cannot_be_used_are_refused_in_one_line(tmp_path: Path):
    run = simulate_recording(copy_run(tmp_path), change=insert_nan("middle"))
    refused_run(run, "middle")
    path = run.file(run.data.file)
    path.write_bytes(b"")
    refused_run(run, "mimu.npz")
    simulate_recording(run)
    path.write_bytes(path.read_bytes()[:40_000])
    refused_run(run, "mimu.npz")


def turn_without_rest(made: Recording) -> Recording:
    return replace(made, readback=dict.fromkeys(made.readback, 30 * made.time))


def test_a_table_that_never_rests_is_refused(tmp_path: Path):
    run = simulate_recording(copy_run(tmp_path), change=turn_without_rest)
    refused_run(run, key="[data] table", names=("outer", "middle", "inner"))


@pytest.mark.parametrize(
    ("old", "new", "mention"),
    [
        ('"middle", "inner"]', '"middle"]', "[data] table"),
        ('"middle", "inner"]', '"middle", "tilt"]', "'tilt'"),
        ('"middle", "inner"]', '"middle", "gx"]', "'gx'"),
        ("[method]", 'table_unit = "g"\n\n[method]', "[data] table_unit"),
        ("[method]", 'kind = "means"\n\n[method]', "white"),
        ("[method]", 'marks = "labels"\n\n[method]', "[data] marks"),
        ("[method]", 'angle = "outer"\n\n[method]', "[data] angle"),
        ('"path.csv"', '"none.csv"', "[method] path: 'none.csv'"),
        ('"path.csv"', f'"{"x" * 300}"', "[method] path"),
        ('"path.csv"', '"path.csv"\nseconds = "9 s"', "[method] seconds"),
        ('white = "0.1 °/√h"\n', "", "[sensor.gyro] white"),
        ('"turntable_kalman"\npath', '"ferraris"\npath', "ferraris"),
    ],
)
def test_run_files_that_cannot_be_are_refused(folder: Path, old: str, new: str, mention: str):
    with pytest.raises(InputError) as refusal:
        calibrate(copy_run(folder, (old, new)))
    assert str(refusal.value).isprintable()
    assert mention in str(refusal.value)


def test_a_path_in_a_run_by_hand_is_refused(tmp_path: Path):
    text = (ROOT / "examples" / "six_position" / "run.toml").read_text(encoding="utf-8")
    (tmp_path / "run.toml").write_text(text + '\npath = "fast"\n', encoding="utf-8")
    with pytest.raises(InputError) as refusal:
        read(tmp_path / "run.toml")
    assert "six_position" in str(refusal.value)


@pytest.mark.slow
def test_a_plan_predicts_the_stated_uncertainties(tmp_path: Path, nominal_outcome: Outcome):
    run = copy_run(tmp_path)
    sheet = turntable_path_sheet(run)
    assert sheet.undecided == ()
    assert sheet.seconds == pytest.approx(236, abs=0.5)
    assert [row.step.label for row in sheet.rows] == [step.label for step in run.steps]
    stated = nominal_outcome.calibration.std
    np.testing.assert_allclose([one.std for one in sheet.expected], stated, rtol=0.03)


def test_a_plan_names_the_directions_its_path_does_not_observe(tmp_path: Path):
    sheet = turntable_path_sheet(
        copy_run(tmp_path, path=path_with_labels("warm-up", "y up", "z down"))
    )
    assert len(sheet.undecided) > 3
    assert any("gx" in words for words in sheet.undecided)


def test_a_refusal_is_one_line_and_status_two(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
):
    simulate_recording(copy_run(tmp_path))
    run = copy_run(tmp_path, ('"middle", "inner"]', '"middle", "tilt"]'))
    monkeypatch.setattr("sys.argv", ["inercal", "calibrate", str(run.path)])
    with pytest.raises(SystemExit) as stopped:
        main()
    assert stopped.value.code == 2
    printed = capsys.readouterr().err.strip().splitlines()
    assert len(printed) == 1
    assert "tilt" in printed[0]


@pytest.mark.slow
def test_the_verbs_go_from_plan_to_calibration(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    run = copy_run(tmp_path)

    def said(*words: str) -> str:
        app(list(words), standalone_mode=False)
        return capsys.readouterr().out

    planned = json.loads(said("plan", "turntable-kalman", "--run", str(run.path), "--json"))
    assert len(planned["steps"]) == 15
    assert {one["name"] for one in planned["expected"]} == set(run.sensor.coefficients)
    printed = said("plan", "turntable-kalman", "--run", str(run.path))
    assert re.search(r"15 steps, 3.93 min in all", printed)
    with pytest.raises(InputError):
        said("plan", "turntable-kalman", "--run", str(run.path), "--out", "sheet.csv")
    said("simulate", str(run.path))
    result = json.loads(said("calibrate", str(run.path), "--out", str(tmp_path), "--json"))
    assert len(result["coefficients"]) == 24
    assert Path(result["report"]).exists()


def test_a_refused_turntable_budget_names_the_alternative(tmp_path: Path):
    with pytest.raises(InputError) as refusal:
        experiment_from_run(copy_run(tmp_path))
    assert "inercal plan turntable-kalman" in str(refusal.value)
