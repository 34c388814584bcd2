"""A line calibrated in batches: values, what is kept, what fails, what is lost."""

import json
import os
import signal
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.base_seeds import evidence
from tests.fleet.lines import TEMPLATE, make_line, readings, rows_of, write_recording, write_table
from tests.refusals import refused

import inercal
from inercal.basics.errors import InputError
from inercal.basics.parallel import SerialExecutor, Settled, TolerantExecutor, WorkerLost
from inercal.basics.parallel.isolated_executor import IsolatedExecutor
from inercal.calibration.files import save
from inercal.fleet import batch as batch_module
from inercal.fleet import calibration as fleet_calibration
from inercal.fleet import results
from inercal.fleet.calibration import Counts, calibrate_line
from inercal.fleet.export import sensor_calibration
from inercal.fleet.line import Line, read_line

pytest.importorskip("pyarrow")


def run(folder: Path, executor: TolerantExecutor | None = None, **options: Any) -> Counts:
    with executor or SerialExecutor() as opened:
        return calibrate_line(read_line(folder), opened, **options)


@pytest.fixture(scope="module")
def calibrated(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = make_line(tmp_path_factory.mktemp("line"), 8)
    counts = run(folder, batch=3)
    assert (counts.done, counts.failed, counts.tasks) == (8, 0, 3)
    return folder


@pytest.mark.slow
def test_values_are_those_of_a_single_calibration(calibrated: Path):
    line = read_line(calibrated)
    for k, (row, sensor) in enumerate(zip(rows_of(calibrated), line.rows, strict=True)):
        path = calibrated / f"{sensor.id}.toml"
        text = TEMPLATE.replace("[data]\n", f'[data]\nfile = "{sensor.recording}"\n')
        path.write_text(text, encoding="utf-8")
        alone = inercal.calibrate(path).calibration
        path.unlink()
        np.testing.assert_array_equal(row["value"], alone.values)
        lower = np.tril_indices(len(alone.values))
        np.testing.assert_array_equal(row["covariance"], alone.covariance[lower])
        names = row["coefficients"].split()
        biases = [row["value"][names.index(f"a{axis}.k0")] for axis in "xyz"]
        np.testing.assert_allclose(biases, 9.81 * readings(k)[1], atol=1e-3)


def test_the_calibration_file_of_a_row_is_read_as_it_was_written(calibrated: Path, tmp_path: Path):
    found = sensor_calibration(read_line(calibrated), calibrated / results.FOLDER, "S003")
    loaded = inercal.load(save(found, tmp_path / "one.calibration.json"))
    row = rows_of(calibrated)[3]
    assert loaded.sensor.name == "S003"
    np.testing.assert_array_equal(loaded.values, row["value"])
    assert loaded.provenance["recording sha256"] == row["recording_sha256"]


@pytest.mark.slow
@pytest.mark.parametrize("size", [evidence(1), 7, 50])
def test_batches_and_workers_change_no_value(calibrated: Path, tmp_path: Path, size: int):
    folder = make_line(tmp_path, 8)
    with IsolatedExecutor(2) if size == 7 else SerialExecutor() as executor:
        calibrate_line(read_line(folder), executor, batch=size)
    assert rows_of(folder) == rows_of(calibrated)


@pytest.mark.slow
def test_what_is_done_is_kept_and_a_changed_file_alone_is_computed_again(tmp_path: Path):
    folder = make_line(tmp_path, 5)
    run(folder)
    again = run(folder)
    assert (again.kept, again.done, again.tasks) == (5, 0, 0)
    before = rows_of(folder)
    write_recording(folder / "recordings" / "S002.npz", 77, each=120)
    changed = run(folder)
    assert (changed.kept, changed.done) == (4, 1)
    after = rows_of(folder)
    assert [a == b for a, b in zip(before, after, strict=True)] == [True, True, False, True, True]
    (folder / "run.toml").write_text(TEMPLATE.replace("0.1 °", "0.2 °"), encoding="utf-8")
    assert run(folder).done == 5
    assert [row["id"] for row in rows_of(folder)] == [f"S{k:03d}" for k in range(5)]


def test_an_override_changes_the_result_of_its_sensor(tmp_path: Path):
    folder = make_line(tmp_path, 2)
    run(folder)
    before = rows_of(folder)
    rows = [
        (name, f"recordings/{name}.npz", g)
        for name, g in (("S000", ""), ("S001", "9.79 m/s² ± 1 mm/s²"))
    ]
    write_table(folder, rows, ("bench.gravity",))
    assert run(folder).done == 1
    after = rows_of(folder)
    assert after[0]["value"] == before[0]["value"]
    assert abs(after[1]["value"][1] - before[1]["value"][1]) > 1e-3


def broken(folder: Path) -> Iterator[str]:
    """Break ten recordings in ten ways; yield their names."""
    good, _ = readings(0)
    path = folder / "recordings"

    def write(name: str, **columns: np.ndarray) -> str:
        np.savez(path / name, allow_pickle=False, **columns)
        return name.removesuffix(".npz")

    whole = (path / "S000.npz").read_bytes()
    (path / "S000.npz").write_bytes(whole[:2000])  # cut short
    yield "S000"
    (path / "S001.npz").write_bytes(b"")
    yield "S001"
    (path / "S002.npz").write_text("no archive", encoding="utf-8")
    yield "S002"
    (path / "S003.npz").unlink()
    yield "S003"
    yield write("S004.npz", **{key: good[key] for key in ("t", "x", "y", "face")})
    yield write("S005.npz", **{**good, "x": np.full_like(good["x"], np.nan)})
    yield write("S006.npz", **{**good, "face": np.repeat("x_p", good["t"].size)})
    yield write("S007.npz", **{**good, **{key: 9.81 * good[key] for key in "xyz"}})
    yield write("S008.npz", **{key: one[:30] for key, one in good.items()})
    yield write("S009.npz", **{**good, "t": good["t"][::-1].copy()})


@pytest.mark.slow
def test_broken_recordings_are_rows_with_reasons_and_the_rest_is_done(tmp_path: Path):
    folder = make_line(tmp_path, 24)
    names = list(broken(folder))
    counts = run(folder, batch=6)
    assert (counts.done, counts.failed) == (14, 10)
    rows = {row["id"]: row for row in rows_of(folder)}
    assert sorted(name for name, row in rows.items() if row["status"] == "failed") == names
    for name in names:
        reason = rows[name]["error"]
        assert reason, name
        assert "\n" not in reason
        assert rows[name]["error_type"] in ("InputError", "NotObserved")
        assert not rows[name]["traceback"]
    assert run(folder).tasks == 0  # a failed row counts until its key changes
    write_recording(folder / "recordings" / "S001.npz", 1)
    assert run(folder).done == 1
    assert run(folder, retry_failed=True).failed == 9


def test_a_template_that_is_wrong_for_all_is_refused_before_any_work(tmp_path: Path):
    folder = make_line(tmp_path, 3)
    text = TEMPLATE.replace("tilt", "tlit")
    (folder / "run.toml").write_text(text, encoding="utf-8")
    with refused(key="[bench] tlit"):
        run(folder)
    assert not (folder / results.FOLDER).exists()


def test_a_sensor_whose_override_is_wrong_fails_alone(tmp_path: Path):
    folder = make_line(tmp_path, 3)
    rows = [(f"S{k:03d}", f"recordings/S{k:03d}.npz", tilt) for k, tilt in enumerate(("", "3", ""))]
    write_table(folder, rows, ("bench.tilt",))
    counts = run(folder)
    assert (counts.done, counts.failed) == (2, 1)
    (failed,) = (row for row in rows_of(folder) if row["status"] == "failed")
    assert failed["id"] == "S001"


POISON = "S004"


def compute_or_die(line: Line, out: results.ResultWriter, work: Any) -> Any:
    """Compute a batch; the process of one sensor dies."""
    if any(one.row.id == POISON for one in work):
        os.kill(os.getpid(), signal.SIGKILL)
    return batch_module.compute_batch(line, out, work)


@pytest.mark.slow
@pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="a process cannot be killed here")
def test_a_sensor_that_kills_its_worker_is_lost_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    folder = make_line(tmp_path, 9)
    monkeypatch.setattr(fleet_calibration, "compute_batch", compute_or_die)
    counts = run(folder, IsolatedExecutor(2), batch=4)
    assert (counts.done, counts.failed, counts.lost) == (8, 0, 1)
    (lost,) = (row for row in rows_of(folder) if row["status"] == "lost")
    assert lost["id"] == POISON
    assert run(folder).tasks == 0
    monkeypatch.undo()
    assert run(folder, retry_failed=True).done == 1
    assert all(row["status"] == "done" for row in rows_of(folder))


class Interrupted(TolerantExecutor):
    """Serial, until so many tasks are done; then the client ends."""

    def __init__(self, most: int):
        self._serial, self._most = SerialExecutor(), most

    @property
    def workers(self) -> int:
        return 1

    def submit(self, function: Any, *arguments: Any) -> int:
        return self._serial.submit(function, *arguments)

    def settled(self) -> Iterator[Settled]:
        for number, one in enumerate(self._serial.settled()):
            if number == self._most:
                raise KeyboardInterrupt
            yield one

    def forget_after(self, index: int) -> None:
        self._serial.forget_after(index)

    def close(self) -> None:
        self._serial.close()


@pytest.mark.slow
@pytest.mark.parametrize("most", [evidence(0), 1, evidence(3)])
def test_an_interrupted_fleet_goes_on_to_the_same_rows(calibrated: Path, tmp_path: Path, most: int):
    folder = make_line(tmp_path, 8)
    with pytest.raises(KeyboardInterrupt):
        run(folder, Interrupted(most), batch=2)
    counts = run(folder)
    assert counts.kept >= 2 * most
    assert rows_of(folder) == rows_of(calibrated)


@pytest.mark.slow
def test_a_full_disk_ends_the_fleet_and_keeps_what_is_there(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    folder = make_line(tmp_path, 4)
    written = 0
    replace = os.replace

    def full(source: Path, target: Path) -> None:
        nonlocal written
        written += 1
        if written == 3:
            raise OSError(28, "No space left on device")
        replace(source, target)

    monkeypatch.setattr(os, "replace", full)
    with pytest.raises(InputError, match="No space left"):
        run(folder, batch=1)
    assert len(rows_of(folder)) == 2
    assert not list((folder / results.FOLDER).glob(".part*"))
    monkeypatch.undo()
    assert run(folder).kept == 2


def test_part_of_a_worker_that_died_in_writing_does_not_count(tmp_path: Path):
    folder = make_line(tmp_path, 2)
    (folder / results.FOLDER).mkdir()
    (folder / results.FOLDER / ".part-123").write_bytes(b"PAR1 and no more")
    assert run(folder).done == 2
    assert len(rows_of(folder)) == 2


def test_a_damaged_part_is_named(tmp_path: Path):
    folder = make_line(tmp_path, 2)
    run(folder)
    part = min((folder / results.FOLDER).glob("part-*.parquet"))
    part.write_bytes(part.read_bytes()[:100])
    with refused(file=part):
        run(folder)


def test_an_error_of_a_task_that_is_no_loss_is_raised(tmp_path: Path):
    class Failing(Interrupted):
        def settled(self) -> Iterator[Settled]:
            for one in self._serial.settled():
                yield Settled(one.index, None, WorkerLost("gone") if one.index else OSError("no"))

    with pytest.raises(OSError, match="no"):
        run(make_line(tmp_path, 3), Failing(9), batch=1)


def test_the_summary_says_counts_and_version(calibrated: Path):
    content = json.loads((calibrated / results.FOLDER / "_fleet.json").read_text(encoding="utf-8"))
    assert content["sensors"] == 8
    assert content["inercal"] == inercal.__version__
