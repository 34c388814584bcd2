"""A line of sensors: what the engine costs, and what two workers gain.

Each recording has six positions of 10⁴ samples in all. The engine's own cost is that of tasks that
compute nothing, by the same window of batches. The efficiency of many workers is computed from the
cost of a sensor, of a worker and of a task, and from what the client does before and beside them.
"""

import resource
import shutil
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import cast

import numpy as np
from distributed import LocalCluster
from tests.fleet import simulated_line
from tests.fleet.lines import TEMPLATE, make_line

from benchmarks import Duration, Row, Skipped, best
from benchmarks.start_up import processor_time
from inercal.basics.parallel import available_cores, open_tolerant_executor
from inercal.fleet import results
from inercal.fleet.batch import BatchDone, Work, compute_batch
from inercal.fleet.calibration import SHORTEST_TASK, TASK_SECONDS, Counts, Scheduling
from inercal.fleet.inputs import Version, line_inputs
from inercal.fleet.line import Line, SensorRow, read_line
from inercal.fleet.time_limit import TimeLimit

SENSORS, FEW, EACH = 2000, 50, 1667  # recordings, few of them, samples of each position
TOGETHER = 100  # sensors of a batch
WORKERS, MANY = 16, 10_000  # of which the efficiency is computed, and their sensors
LOOP = 5  # calls of `inercal calibrate` by which a loop over the program is judged
REPORTED = 100_000  # sensors
SIZES = (1_000, 10_000, 100_000)  # tasks that compute nothing


def compute_nothing(line: Line, out: results.ResultWriter, work: Sequence[Work]) -> BatchDone:
    """Take the place of `compute_batch`."""
    return BatchDone(len(work), 0, (1e-9,) * len(work))


def engine_cost(scheduler: str | None, tasks: int) -> tuple[Duration, float]:
    """Return the time of all tasks, of client and workers, and the client's growth, MB."""
    line = Line(Path(), {}, ())
    work = Work(SensorRow("a", "b"), "", Version(0, ""))
    with open_tolerant_executor(None if scheduler else 2, scheduler) as executor:
        out = results.ResultWriter(Path(), 1)
        scheduling = Scheduling(
            line, out, executor, 1, Counts(tasks), None, compute_nothing, TimeLimit()
        )
        before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        begin, used = time.perf_counter(), time.process_time()
        scheduling.run(work for _ in range(tasks))
        wall, processor = time.perf_counter() - begin, time.process_time() - used
        grown = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before
    return Duration(processor, wall, processor), grown / 1e3


def fleet(folder: Path, workers: int) -> Duration:
    """Return the time of a line's calibration by the program."""
    shutil.rmtree(folder / results.FOLDER, ignore_errors=True)
    return processor_time("fleet", "calibrate", folder, "--workers", str(workers))


def calibrate_one(folder: Path, k: int) -> Duration:
    """Return the time of `inercal calibrate` of one sensor."""
    run = folder / "one.toml"
    sensor = read_line(folder).rows[k]
    text = TEMPLATE.replace("[data]\n", f'[data]\nfile = "{sensor.recording}"\n')
    run.write_text(text, encoding="utf-8")
    return processor_time("calibrate", run, "--no-report", "--out", folder / "one")


class NoParts:
    """Takes the place of `ResultWriter`, and writes nothing."""

    def write(self, rows: Sequence[object]) -> None:
        """Discard the rows."""


def load_and_average(path: Path) -> list[np.ndarray]:
    """Do what no program can leave out: load the arrays, and average the six positions."""
    with np.load(path) as archive:
        labels, _ = archive["face"], archive["t"]
        readings = np.stack([archive[name] for name in "xyz"])
    ends = np.flatnonzero(labels[1:] != labels[:-1]) + 1
    return [part.mean(axis=1) for part in np.split(readings, ends, axis=1)]


def sensor_rows(folder: Path) -> Iterator[Row]:
    """Measure a sensor of a batch in this process, beside loading and averaging alone."""
    line = read_line(folder)
    work = [Work(row, line.digest(row), Version(0, "")) for row in line.rows[:TOGETHER]]
    paths = [folder / one.row.recording for one in work]
    loaded = best(lambda: [load_and_average(path) for path in paths])
    out = cast(results.ResultWriter, NoParts())
    ours = best(lambda: compute_batch(line, out, work))
    each = 1e3 / TOGETHER * ours
    name = "fleet: a sensor of a batch, 10⁴ samples"
    yield Row(name, each, 6.0, "limit", "ms")
    yield Row(name, each, 1e3 / TOGETHER * loaded, "np.load and six means", "ms", to_reach=0.2)


def report_rows() -> Iterator[Row]:
    """Measure the report over a hundred thousand sensors of drawn results."""
    with TemporaryDirectory() as name:
        folder = Path(name)
        simulated_line.write_line(folder, REPORTED)
        taken = processor_time("fleet", "report", folder)
        size = (folder / "report.html").stat().st_size / 1e6
    yield Row("fleet: report over 10⁵ sensors", taken, 20.0, "limit")
    yield Row("fleet: its page", size, 5.0, "limit", "MB")


def rows() -> Iterator[Row | Skipped]:
    """Measure the engine, then the calibrations."""
    cluster = LocalCluster(
        2, threads_per_worker=1, host="127.0.0.1", dashboard_address="127.0.0.1:0"
    )
    task: dict[str, float] = {}
    for scheduler, name in ((None, "processes"), (cluster.scheduler_address, "Dask")):
        task[name] = engine_cost(scheduler, SIZES[0])[0] / SIZES[0]
        share = 100 * task[name] / SHORTEST_TASK
        yield Row(f"fleet: a task by {name}, of the work of the shortest", share, 2.0, "limit", "%")
    cluster.close()
    costs = [engine_cost(None, size) for size in SIZES]
    grown = costs[-1][0] / costs[0][0] / (SIZES[-1] / SIZES[0])
    yield Row("fleet: a task of 10⁵, against one of 10³", grown, 1.2, "limit", "")
    yield Row("fleet: client's growth by 10⁵ tasks", max(costs[-1][1], 1e-3), 20.0, "limit", "MB")
    yield from report_rows()
    with TemporaryDirectory() as name:
        folder = make_line(Path(name), SENSORS, EACH)
        yield from sensor_rows(folder)
        one, two = fleet(folder, 1), fleet(folder, 2)
        what = f"fleet: {SENSORS} recordings of 10⁴ samples"
        yield Row(f"{what}, two workers, CPU", two, 1.1 * one, "1.1 × one worker")
        yield _efficiency(folder, one, task["processes"])
        loop = np.mean([calibrate_one(folder, k) for k in range(LOOP)])
        yield Row(f"{what}, CPU", one, SENSORS * float(loop), "a loop over inercal calibrate",
                  to_reach=5.0)  # fmt: skip
        if available_cores() < 2:
            yield Skipped(f"{what}, two workers, wall", "one core")
            return
        yield Row(f"{what}, two workers, wall", two.wall, one.wall, "one worker", to_reach=1.8)


def _efficiency(folder: Path, one: Duration, task: float) -> Row:
    """Compare the time of many workers, computed from measured costs, with their share of one."""
    with TemporaryDirectory() as name:
        small = make_line(Path(name), FEW, EACH)
        few, by_two = fleet(small, 1), fleet(small, 2)
    sensor = (one.processor - few.processor) / (SENSORS - FEW)
    worker = by_two.processor - few.processor
    begin = time.process_time()
    line_inputs(read_line(folder))
    client = (time.process_time() - begin) / SENSORS
    start = few.processor - FEW * sensor  # client, server and first worker one after another
    tasks = MANY * sensor / TASK_SECONDS
    shared = start + worker + MANY * (client + sensor / WORKERS) + tasks * task
    name = f"fleet: {MANY} recordings by {WORKERS} workers, from the costs of each"
    alone = (start + MANY * sensor) / WORKERS
    return Row(name, shared, alone, f"one worker / {WORKERS}", to_reach=0.85)
