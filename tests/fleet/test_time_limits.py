"""A sensor that takes too long is named, and the others are calibrated."""

import os
import signal
import sys
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from threading import Event
from typing import Any

import pytest
from tests.base_seeds import evidence
from tests.fleet.lines import make_line, rows_of, write_recording
from tests.fleet.test_fleet_cluster import Cluster
from tests.program import run_program

from inercal.basics.parallel import (
    SerialExecutor,
    Settled,
    Task,
    TimeExceeded,
    TolerantExecutor,
    executor,
    open_tolerant_executor,
)
from inercal.basics.parallel.isolated_executor import IsolatedExecutor
from inercal.fleet import calibration as fleet_calibration
from inercal.fleet import results
from inercal.fleet.batch import BatchDone, Work, failed_row
from inercal.fleet.calibration import Counts, calibrate_line
from inercal.fleet.line import Line, read_line
from inercal.fleet.station import calibrate_arrival
from inercal.fleet.time_limit import TimeLimit

# A worker loads this module before its first step, so the import of Parquet, which takes seconds on
# a busy machine, does not count as the time of a sensor.
pytest.importorskip("pyarrow.parquet")
SLOW = "S003"
HANGING = (SLOW, "S005")


class TimedExecutor(TolerantExecutor):
    """Runs tasks here; a sensor takes the time that is stated, though nobody waits for it."""

    def __init__(self, seconds: dict[str, float]):
        self._seconds = seconds
        self._tasks: deque[Task] = deque()
        self._count = 0

    @property
    def workers(self) -> int:
        return 1

    def submit(self, function: Callable[..., Any], *arguments: Any) -> int:
        self._count += 1
        self._tasks.append(Task(self._count - 1, function, arguments))
        return self._count - 1

    def settled(self) -> Iterator[Settled]:
        while self._tasks:
            yield self._settle(self._tasks.popleft())

    def _settle(self, task: Task) -> Settled:
        assert self.limit is not None
        work = task.arguments[-1]
        for step, one in enumerate([work] if isinstance(work, Work) else work):
            limit = self.limit(task.index, step)
            if self._seconds.get(one.row.id, 0.1) > limit:
                return Settled(task.index, None, TimeExceeded.of(step, limit))
        return Settled(task.index, task(), None)

    def forget_after(self, index: int) -> None:
        raise NotImplementedError

    def close(self) -> None:
        self._tasks.clear()


def calibrated(folder: Path, seconds: dict[str, float], **options: Any) -> Counts:
    return calibrate_line(read_line(folder), TimedExecutor(seconds), **options)


def test_the_limit_follows_from_the_times_of_the_others():
    limit = TimeLimit()
    assert limit.seconds(1000) == 600
    assert limit.seconds(1000, early=True) == 60
    limit.note([1000] * 3, [0.5] * 3)
    assert limit.seconds(1000) == 60
    limit.note([1000, 2000], [1.0, 10.0])
    assert [limit.seconds(size) for size in (1000, 2000, 20_000)] == [200, 200, 2000]
    assert TimeLimit(3.0).seconds(10**9, early=True) == 3.0


@pytest.mark.slow
@pytest.mark.parametrize("batch", [evidence(1), 3, evidence(8)])
def test_a_sensor_that_hangs_is_named_and_the_others_are_done(tmp_path: Path, batch: int):
    folder = make_line(tmp_path, 8)
    counts = calibrated(folder, {SLOW: 1e9}, batch=batch)
    assert (counts.done, counts.lost) == (7, 1)
    (lost,) = (row for row in rows_of(folder) if row["status"] == "lost")
    assert (lost["id"], lost["error_type"]) == (SLOW, "TimeExceeded")
    assert "longer than 60 s" in lost["error"]
    assert "--timeout" in lost["error"]
    assert calibrated(folder, {}).tasks == 0
    assert calibrated(folder, {}, retry_failed=True).done == 1


@pytest.mark.slow
def test_a_slow_sensor_that_comes_first_is_judged_when_the_others_are_known(tmp_path: Path):
    folder = make_line(tmp_path / "a", 5)
    assert calibrated(folder, {"S000": 100.0}).done == 4  # the others take milliseconds
    folder = make_line(tmp_path / "b", 2)
    counts = calibrated(folder, {"S000": 100.0})  # too few others
    assert (counts.done, counts.lost) == (2, 0)
    folder = make_line(tmp_path / "c", 5)
    assert calibrated(folder, {"S000": 100.0}, timeout=101.0).done == 5
    folder = make_line(tmp_path / "d", 5)
    assert calibrated(folder, dict.fromkeys(("S000", "S001"), 1e9)).lost == 2


def test_a_station_says_that_a_recording_hangs(tmp_path: Path):
    folder = make_line(tmp_path, 2)
    for name, passed in (("S001", True), ("S000", False)):
        path = folder / "recordings" / f"{name}.npz"
        executor, limit = TimedExecutor({"S000": 31.0}), TimeLimit(30.0)
        result = calibrate_arrival(read_line(folder), path, folder / "fleet", executor, limit)
        assert result.passed is passed
    assert "longer than 30 s" in result.reason
    assert [row["status"] for row in rows_of(folder)] == ["lost", "done"]


@pytest.mark.parametrize("seconds", ["0", "-1", "nan", "inf"])
def test_a_limit_that_is_none_is_refused(tmp_path: Path, seconds: str):
    folder = make_line(tmp_path, 1)
    assert run_program("fleet", "calibrate", folder, f"--timeout={seconds}").status == 2
    assert not (folder / results.FOLDER).exists()


def test_the_time_of_a_stopped_client_is_nobodys_delay(monkeypatch: pytest.MonkeyPatch):
    times = iter([0.0, 0.5, 1000.0, 1000.5])
    monkeypatch.setattr(executor, "monotonic", lambda: next(times))
    clock = executor.AwakeClock()
    assert [clock() for _ in range(3)] == [0.5, 2.5, 3.0]


def hang(line: Line, out: results.ResultWriter, work: Sequence[Work]) -> BatchDone:
    """Calibrate nothing; one sensor hangs, and the process of another is stopped."""
    from inercal.basics.parallel.executor import begin_step

    rows: list[dict[str, Any]] = []
    for number, one in enumerate(work):
        begin_step(number)
        if one.row.id == SLOW:
            Event().wait()
        if one.row.id == "S005" and sys.platform != "win32":
            os.kill(os.getpid(), signal.SIGSTOP)
        rows.append(failed_row(line.folder, one, "no", "InputError"))
    out.write(rows)
    return BatchDone(0, len(rows), (0.1,) * len(rows))


def check_that_hangs_are_named(folder: Path, executor: TolerantExecutor) -> None:
    """Limit the time only of the sensors that hang, because a busy machine delays the others.

    They are known by the size of their recordings.
    """
    make_line(folder, 9)
    for name in HANGING:
        write_recording(folder / "recordings" / f"{name}.npz", 1, 101)
    hanging = (folder / "recordings" / f"{SLOW}.npz").stat().st_size

    def seconds(_limit: TimeLimit, size: int, *, early: bool = False) -> float:
        del early
        return 1.0 if size == hanging else 1e9

    with pytest.MonkeyPatch.context() as patch, executor:
        patch.setattr(fleet_calibration, "compute_batch", hang)
        patch.setattr(TimeLimit, "seconds", seconds)
        counts = calibrate_line(read_line(folder), executor, batch=3)
    assert (counts.failed, counts.lost) == (7, 2)
    lost = [row for row in rows_of(folder) if row["status"] == "lost"]
    assert [row["id"] for row in lost] == list(HANGING)
    assert all("longer than 1 s" in row["error"] for row in lost)


@pytest.mark.slow
def test_processes_that_hang_or_are_stopped_are_ended(tmp_path: Path):
    check_that_hangs_are_named(tmp_path, IsolatedExecutor(2))


@pytest.mark.slow
def test_workers_of_a_cluster_that_hang_or_are_stopped_start_anew(tmp_path: Path):
    (tmp_path / "cluster").mkdir()
    cluster = Cluster(tmp_path / "cluster", 2)
    try:
        executor = open_tolerant_executor(scheduler=cluster.address)
        check_that_hangs_are_named(tmp_path / "line", executor)
    finally:
        cluster.close()


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="a process cannot be killed here")
def test_a_worker_that_is_killed_as_it_starts_loses_no_sensor(tmp_path: Path):
    folder = make_line(tmp_path, 2)

    class Killing(IsolatedExecutor):
        killed = 0

        def _start(self) -> Any:
            worker = super()._start()
            if self.killed < 3:
                self.killed += 1
                worker.process.kill()
            return worker

    with Killing(1) as executor:
        counts = calibrate_line(read_line(folder), executor)
    assert (counts.done, counts.lost, executor.killed) == (2, 0, 3)


@pytest.mark.slow
def test_a_line_of_few_sensors_is_isolated_from_its_client(tmp_path: Path):
    folder = make_line(tmp_path, 3)
    ended = run_program("fleet", "calibrate", folder, "--timeout", "300")
    assert (ended.status, [row["status"] for row in rows_of(folder)]) == (0, ["done"] * 3)
    write_recording(folder / "recordings" / "S001.npz", 8)
    with SerialExecutor() as executor:
        assert calibrate_line(read_line(folder), executor).done == 1
