"""[data] hold: holds that the recording itself numbers, on a turntable."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from tests.refusals import refused

from inercal.basics.errors import InputError
from inercal.benches import Turntable
from inercal.benches.turntable.reading.readback_angles import add_table_angles
from inercal.benches.turntable.reading.track_observation import observe
from inercal.pipeline import apply_data_columns, calibrate, load_recording, simulate
from inercal.recordings import Recording, Track
from inercal.recordings.io.write import write_recording
from inercal.runfile import Run, read

EXAMPLE = Path(__file__).parents[2] / "examples" / "turntable"


def copy_run(folder: Path, *changes: tuple[str, str]) -> Run:
    text = (EXAMPLE / "mimu.toml").read_text(encoding="utf-8")
    for old, new in (('file = "mimu.csv"', 'file = "mimu.npz"\nhold = "holds"'), *changes):
        assert old in text, old
        text = text.replace(old, new)
    (folder / "mimu.toml").write_text(text, encoding="utf-8")
    (folder / "path.csv").write_text((EXAMPLE / "path.csv").read_text(encoding="utf-8"), "utf-8")
    return read(folder / "mimu.toml")


def simulate_recording(
    run: Run, change: Callable[[Recording], Recording] = lambda made: made
) -> Run:
    write_recording(change(apply_data_columns(run, simulate(run, 3))), run.file(run.data.file))
    return run


def observe_track(run: Run) -> Track:
    assert isinstance(run.bench, Turntable)
    track = observe(run).observations.track
    assert track is not None
    return track


def change_hold_column(
    change: Callable[[np.ndarray], np.ndarray],
) -> Callable[[Recording], Recording]:
    def changed(made: Recording) -> Recording:
        readback = dict(made.readback)
        readback["holds"] = change(readback["holds"].copy())
        return replace(made, readback=readback)

    return changed


def test_holds_are_those_that_the_column_numbers(tmp_path: Path):
    shorter: list[np.ndarray] = []

    def cut(number: np.ndarray) -> np.ndarray:
        at = np.flatnonzero(number == 2)
        number[at[: at.size // 2]] = -1  # the table stands there, and the host did not say so
        shorter.append(number)
        return number

    run = simulate_recording(copy_run(tmp_path), change_hold_column(cut))
    track = observe_track(run)
    assert track.hold.tolist() == shorter[0].tolist()
    assert len(set(track.hold.tolist())) == 10


@pytest.mark.slow
def test_the_calibration_is_as_good_as_with_holds_that_are_sought(tmp_path: Path):
    run = simulate_recording(copy_run(tmp_path))
    stated = calibrate(run).estimate
    sought = calibrate(replace(run, data=run.data.model_copy(update={"hold": None}))).estimate
    apart = (stated.value - sought.value)[:24] / sought.std[:24]
    assert np.abs(apart).max() < 0.5
    assert stated.std[:24] == pytest.approx(sought.std[:24], rel=0.1)


def test_a_gap_within_a_hold_splits_it(tmp_path: Path):
    def without(made: Recording) -> Recording:
        number = made.readback["holds"]
        at = np.flatnonzero(number == 4)
        gone = at[300:380]  # 0.8 s
        return made.take(np.setdiff1d(np.arange(number.size), gone))

    run = simulate_recording(copy_run(tmp_path), without)
    assert observe_track(run).hold.max() == 10 - 1


@pytest.mark.slow
def test_a_hold_of_less_than_a_second_is_no_step_but_is_followed(tmp_path: Path):
    def cut(number: np.ndarray) -> np.ndarray:
        at = np.flatnonzero(number == 3)
        number[at[60:]] = -1
        return number

    run = simulate_recording(copy_run(tmp_path), change_hold_column(cut))
    assert isinstance(run.bench, Turntable)
    gathered = observe(run)
    assert "y down" not in gathered.observations.labels
    assert (observe_track(run).hold == 3).sum() == 60


def test_turns_of_the_readback_are_taken_as_counted(tmp_path: Path):
    """Nothing is unwrapped: in an outage the table may go more than half a turn."""

    def jumped(made: Recording) -> Recording:
        readback = {n: np.zeros_like(v) if n == "inner" else v for n, v in made.readback.items()}
        readback["inner"][20000:] = 200.0
        return replace(made, readback=readback)

    run = copy_run(tmp_path)
    write_recording(jumped(apply_data_columns(run, simulate(run, 3))), run.file(run.data.file))
    assert isinstance(run.bench, Turntable)
    said = add_table_angles(run, load_recording(run), run.bench).recording.readback["inner"]
    assert np.degrees(said[-1]) == pytest.approx(200.0)


@pytest.mark.parametrize(
    "change", [lambda n: n + 0.5, lambda n: n * 0 - 1], ids=["not whole", "none"]
)
def test_invalid_hold_numbers_are_refused(
    tmp_path: Path, change: Callable[[np.ndarray], np.ndarray]
):
    run = simulate_recording(copy_run(tmp_path), change_hold_column(change))
    with refused(file=run.path, key="[data] hold"):
        calibrate(run)


def test_a_readback_of_its_own_file_has_no_column_of_holds(tmp_path: Path):
    with pytest.raises(InputError):
        copy_run(tmp_path, ('label = "step"', 'table_file = "t.csv"\ntable_time = "t"'))


def test_a_column_is_not_named_for_holds_and_something_else(tmp_path: Path):
    simulate_recording(copy_run(tmp_path))
    with pytest.raises(InputError) as refusal:
        calibrate(copy_run(tmp_path, ('"holds"', '"ax"')))
    assert "'ax'" in str(refusal.value)


def test_the_key_is_of_a_turntable_alone(tmp_path: Path):
    text = (EXAMPLE.parent / "six_position").glob("*.toml")
    path = next(iter(sorted(text)))
    made = path.read_text(encoding="utf-8").replace("[data]\n", '[data]\nhold = "hold"\n')
    (tmp_path / "run.toml").write_text(made, encoding="utf-8")
    with pytest.raises(InputError) as refusal:
        read(tmp_path / "run.toml")
    assert "hold" in str(refusal.value)
    assert '"turntable"' in str(refusal.value)
