"""Calibrate a line in batches. Finished sensors are skipped, and each failure gets a row."""

import json
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from importlib.metadata import version
from math import inf
from pathlib import Path

from inercal.basics.atomic_files import write_text
from inercal.basics.errors import InercalError, InputError
from inercal.basics.parallel import Settled, TimeExceeded, TolerantExecutor, WorkerLost
from inercal.fleet import results
from inercal.fleet.batch import BatchDone, Work, compute_batch, failed_row
from inercal.fleet.inputs import ABSENT, line_inputs
from inercal.fleet.latest import OUTDATED, latest_results
from inercal.fleet.line import Line
from inercal.fleet.results import ResultWriter
from inercal.fleet.time_limit import TimeLimit

TASK_SECONDS = 2.0  # s per batch: low overhead, and little work is lost if a worker dies
# The last batches are shorter, so that all workers finish together. On a cluster, a batch costs
# 2 to 5 ms, which is at most 1.3 % of this time.
SHORTEST_TASK = 0.4  # s
_MOST_IN_BATCH = 200
_WINDOW = 4  # batches per worker in progress
_FIRST_BATCHES = 2  # before the times are known; one of them may take very long
_REPAID = 1.0  # s of work that repay a worker: its start takes about a tenth of this
_MOST_EARLY = 3  # sensors that may be stopped before the times of others are known
SUMMARY = "_fleet.json"  # dataset readers ignore such names


@dataclass
class Counts:
    """Number of sensors in a line by status.

    Parameters
    ----------
    sensors : int
        Number of sensors in the table.
    kept, kept_failed : int
        Number of sensors that already had a result, and how many of these results were failures.
    done, failed, lost : int
        Number of sensors that this run calibrated, that failed in this run, and whose worker died.
    tasks : int
        Number of batches.
    """

    sensors: int
    kept: int = 0
    kept_failed: int = 0
    done: int = 0
    failed: int = 0
    lost: int = 0
    tasks: int = 0

    @property
    def settled(self) -> int:
        """Return the number of sensors that need no more work."""
        return self.kept + self.done + self.failed + self.lost


def calibrate_line(
    line: Line,
    executor: TolerantExecutor,
    *,
    out: Path | None = None,
    batch: int | None = None,
    retry_failed: bool = False,
    timeout: float | None = None,
    progress: Callable[[Counts], None] | None = None,
) -> Counts:
    """Calibrate the sensors of a line that have no result yet.

    Parameters
    ----------
    line : Line
    executor : TolerantExecutor
        Executor for the batches. It gets four batches per worker at a time. The caller closes it.
    out : Path, optional
        Folder for the results; by default `fleet` in the line's folder.
    batch : int, optional
        Number of sensors in a batch; by default, a batch takes about two seconds.
    retry_failed : bool
        Whether to retry sensors that failed with the same recording and run file.
    timeout : float, optional
        Time limit for a sensor, s; by default, `TimeLimit` computes the limit. A `SerialExecutor`
        has no limit.
    progress : callable, optional
        Function called after each batch.

    Raises
    ------
    InputError
        The template is wrong for every sensor, or results cannot be written. Existing results are
        kept.
    """
    folder = line.folder / results.FOLDER if out is None else out
    counts = Counts(len(line.rows))
    todo, refused, latest = _pending(line, folder, retry_failed, counts)
    _refuse_wrong_run_files(line, todo, refused)
    if todo or refused:
        writer = results.open_writer(folder, latest)
        rows = [
            failed_row(line.folder, work, str(error), type(error).__name__)
            for work, error in refused
        ]
        if rows:
            writer.write(rows)
            counts.failed += len(rows)
        limit = TimeLimit(timeout)
        Scheduling(line, writer, executor, batch, counts, progress, compute_batch, limit).run(todo)
    write_summary(folder, counts)
    return counts


def write_summary(folder: Path, counts: Counts) -> None:
    """Write the counts and the version to the folder of the parts."""
    content = {"inercal": version("inercal"), **vars(counts)}
    write_text(folder / SUMMARY, json.dumps(content, indent=1) + "\n")


_Refused = tuple[Work, InercalError]


def _pending(
    line: Line, folder: Path, retry_failed: bool, counts: Counts
) -> tuple[list[Work], list[_Refused], int]:
    """Return the sensors to calibrate, the sensors without recording, and the newest generation."""
    now = line_inputs(line)
    found = latest_results(line, folder, (), now).to_pylist()
    counting: dict[str, str] = {row["id"]: row["status"] for row in found if not row[OUTDATED]}
    todo: list[Work] = []
    refused: list[_Refused] = []
    for inputs in now.values():
        status = counting.get(inputs.row.id)
        if status is not None and (status == results.DONE or not retry_failed):
            counts.kept += 1
            counts.kept_failed += status != results.DONE
        elif isinstance(inputs.found, InputError):
            refused.append((Work(inputs.row, inputs.digest, ABSENT), inputs.found))
        else:
            todo.append(Work(inputs.row, inputs.digest, inputs.found))
    return todo, refused, max((row["generation"] or 0 for row in found), default=0)


def _refuse_wrong_run_files(line: Line, todo: list[Work], refused: list[_Refused]) -> None:
    """Check each run file that differs by more than sensor and recording, before any work.

    Sensors whose run file is wrong are moved to `refused`.

    Raises
    ------
    InputError
        Every run file is wrong.
    """
    errors: dict[tuple[str, ...], InercalError | None] = {}
    kept: list[Work] = []
    for work in todo:
        shape = line.shape(work.row)
        if shape not in errors:
            try:
                line.run(work.row, work.digest)
                errors[shape] = None
            except InercalError as error:
                has_file = isinstance(error, InputError) and error.file is not None
                named = (error.key or "-").replace("] ", ".").strip("[]")
                column = next(
                    (one for one in line.columns if f"{one}.".startswith(f"{named}.")), ""
                )
                error = error if has_file else error.located(line.path)
                errors[shape] = error.located(f"column {column}") if column else error
        error = errors[shape]
        if error is None:
            kept.append(work)
        else:
            refused.append((work, error))
    if todo and not kept:
        raise next(error for error in errors.values() if error is not None)
    todo[:] = kept


_Compute = Callable[[Line, ResultWriter, Sequence[Work]], BatchDone]


class Scheduling:
    """Distributes batches to workers and collects the results; few batches run at a time.

    Parameters
    ----------
    line : Line
    out : ResultWriter
        Writer for the results.
    executor : TolerantExecutor
    batch : int or None
        Number of sensors in a batch; if None, a batch takes about two seconds, and at the end less.
    counts : Counts
        Counts for the line; the scheduler updates them.
    progress : callable or None
        Function called with the counts after each batch.
    compute : callable
        Function that calibrates a batch. Its arguments are the line without rows, `out` and the
        work.
    limit : TimeLimit
        Time limit for a sensor.
    """

    def __init__(
        self,
        line: Line,
        out: ResultWriter,
        executor: TolerantExecutor,
        batch: int | None,
        counts: Counts,
        progress: Callable[[Counts], None] | None,
        compute: _Compute,
        limit: TimeLimit,
    ):
        self._compute, self._limit = compute, limit
        executor.limit = self._longest
        self._line, self._out, self._executor = replace(line, rows=()), out, executor
        self._workers, self._batch = executor.workers, batch
        self._counts, self._progress = counts, progress
        self._under_way: dict[int, Sequence[Work]] = {}
        self._measured = 0
        self._seconds, self._shortest = 0.0, inf
        self._repaid = min(self._workers, _FIRST_BATCHES)
        self._stopped_early: set[str] = set()  # ids
        self._postponed: list[Work] = []

    def run(self, todo: Iterable[Work]) -> None:
        """Calibrate the sensors."""
        waiting = iter(todo)
        self._hand_out(waiting)
        for settled in self._executor.settled():
            self._take_back(settled)
            if self._progress is not None:
                self._progress(self._counts)
            self._hand_out(waiting)

    def _longest(self, index: int, step: int) -> float:
        """Return the time limit for the slowest sensor in a batch, s."""
        work, stopped = self._under_way[index][step], self._stopped_early
        others = self._counts.sensors - self._counts.settled > 1
        early = others and work.row.id not in stopped and len(stopped) < _MOST_EARLY
        return self._limit.seconds(work.version.size, early=early)

    def _size(self) -> int:
        """Return the number of sensors in the next batch, or 1 if their time is not known."""
        if self._batch is not None:
            return self._batch
        if not self._measured:
            return 1
        each = self._seconds / self._measured
        begun = self._counts.settled + sum(map(len, self._under_way.values()))
        left = (self._counts.sensors - begun) * each
        share = left / (2 * self._workers) if self._workers > 1 else TASK_SECONDS
        seconds = min(TASK_SECONDS, max(share, SHORTEST_TASK))
        return round(min(max(seconds / each, 1), _MOST_IN_BATCH))

    def _window(self) -> int:
        """Return the number of batches in progress: one for each worker if few are repaid."""
        if self._measured:
            work = (self._counts.sensors - self._counts.settled) * self._shortest
            self._repaid = max(self._repaid, min(int(work / _REPAID), self._workers))
        enough = self._batch is not None or (self._measured and self._repaid == self._workers)
        return self._workers * _WINDOW if enough else self._repaid

    def _hand_out(self, waiting: Iterator[Work]) -> None:
        window = self._window()
        while len(self._under_way) < window:
            some = [work for _, work in zip(range(self._size()), waiting, strict=False)]
            if not some and self._postponed and not self._under_way:
                some = [self._postponed.pop()]
            if not some:
                return
            self._submit(some)

    def _submit(self, work: Sequence[Work]) -> None:
        index = self._executor.submit(self._compute, self._line, self._out, work)
        self._under_way[index] = work
        self._counts.tasks += 1

    def _take_back(self, settled: Settled) -> None:
        work = self._under_way.pop(settled.index)
        error = settled.error
        if isinstance(error, TimeExceeded):
            self._answer_excess(work, error)
        elif isinstance(error, WorkerLost):
            self._answer_loss(work, error)
        elif error is not None:
            raise error
        else:
            done: BatchDone = settled.result
            self._counts.done += done.done
            self._counts.failed += done.failed
            self._measured += len(work)
            self._seconds += sum(done.seconds)
            self._shortest = min(self._shortest, *done.seconds)
            self._limit.note([one.version.size for one in work], done.seconds)

    def _answer_loss(self, work: Sequence[Work], error: WorkerLost) -> None:
        """Resubmit the sensors of a lost batch one by one, or record a single sensor as lost."""
        if len(work) > 1:
            for one in work:
                self._submit([one])
            return
        self._lose(work[0], str(error), error)

    def _answer_excess(self, work: Sequence[Work], error: TimeExceeded) -> None:
        """Record the sensor that took too long, and resubmit the others in its batch."""
        late = work[error.step]
        if others := [one for one in work if one is not late]:
            self._submit(others)
        if error.limit < self._limit.seconds(late.version.size):
            self._stopped_early.add(late.row.id)
            self._postponed.append(late)
        else:
            self._lose(late, self._limit.reason(error.limit), error)

    def _lose(self, work: Work, reason: str, error: WorkerLost) -> None:
        name = type(error).__name__
        self._out.write([failed_row(self._line.folder, work, reason, name, status=results.LOST)])
        self._counts.lost += 1
