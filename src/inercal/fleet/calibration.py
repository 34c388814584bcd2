"""A line calibrated in batches: what is done is skipped, what fails is a row, nothing is lost."""

import json
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from importlib.metadata import version
from pathlib import Path

from inercal.errors import InercalError, InputError
from inercal.fleet import results
from inercal.fleet.batch import BatchDone, Work, compute_batch, failed_row
from inercal.fleet.line import Line
from inercal.fleet.recordings import Version, version_of
from inercal.io.atomic_files import write_text
from inercal.parallel import Settled, TolerantExecutor, WorkerLost

TASK_SECONDS = 2.0  # of a batch: its overhead is then small, and little is lost with a worker
_MOST_IN_BATCH = 200
_WINDOW = 4  # batches a worker that are handed out
SUMMARY = "_fleet.json"  # readers of datasets leave such names out


@dataclass
class Counts:
    """Sensors of a line by what became of them.

    Parameters
    ----------
    sensors : int
        In the table.
    kept, kept_failed : int
        With a result that was there, and how many of these have no calibration.
    done, failed, lost : int
        Calibrated now; refused now; whose worker died.
    tasks : int
        Batches.
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
        """Sensors that need no more work."""
        return self.kept + self.done + self.failed + self.lost


def calibrate_line(
    line: Line,
    executor: TolerantExecutor,
    *,
    out: Path | None = None,
    batch: int | None = None,
    retry_failed: bool = False,
    progress: Callable[[Counts], None] | None = None,
) -> Counts:
    """Calibrate the sensors of a line that have no result yet.

    Parameters
    ----------
    line : Line
    executor : TolerantExecutor
        Where batches are computed, four times as many at once as it has workers; it is not closed.
    out : Path, optional
        Folder of the results; by default `fleet` in the line's folder.
    batch : int, optional
        Sensors of a batch; by default as many as take two seconds.
    retry_failed : bool
        Whether sensors that failed with the same recording and run file are tried again.
    progress : callable, optional
        Called after each batch.

    Raises
    ------
    InputError
        The template is wrong for every sensor, or results cannot be written. Results that are
        there stay.
    """
    folder = line.folder / results.FOLDER if out is None else out
    counts = Counts(len(line.rows))
    todo, refused = _pending(line, folder, retry_failed, counts)
    _refuse_wrong_run_files(line, todo, refused)
    if refused:
        rows = [
            failed_row(line.folder, work, str(error), type(error).__name__)
            for work, error in refused
        ]
        results.write_part(folder, rows)
        counts.failed += len(refused)
    Scheduling(line, folder, executor, batch, counts, progress, compute_batch).run(todo)
    write_summary(folder, counts)
    return counts


def write_summary(folder: Path, counts: Counts) -> None:
    """Write counts and version to the folder of the parts."""
    content = {"inercal": version("inercal"), **vars(counts)}
    write_text(folder / SUMMARY, json.dumps(content, indent=1) + "\n")


_Refused = tuple[Work, InercalError]


def _pending(
    line: Line, folder: Path, retry_failed: bool, counts: Counts
) -> tuple[list[Work], list[_Refused]]:
    """Return the sensors to calibrate, and those whose recording is not there."""
    known = _known_versions(folder, retry_failed)
    installed = version("inercal")
    todo: list[Work] = []
    refused: list[_Refused] = []
    for row in line.rows:
        digest = line.digest(row)
        try:
            found = version_of(line.folder, row.recording)
        except InputError as error:
            refused.append((Work(row, digest, Version(0, "")), error))
            continue
        if known.get(row.id, _NONE)[:3] == (digest, found, installed):
            counts.kept += 1
            counts.kept_failed += known[row.id][3] != results.DONE
        else:
            todo.append(Work(row, digest, found))
    return todo, refused


_Known = tuple[str, Version, str, str]
_NONE: _Known = ("", Version(0, ""), "", "")


def _known_versions(folder: Path, retry_failed: bool) -> dict[str, _Known]:
    """Return digest of the run file, versions of recording and inercal, and status of results."""
    columns = ("id", "sections_sha256", "size", "mark", "status", "inercal")
    found: dict[str, _Known] = {}
    for row in results.read_results(folder, columns).to_pylist():
        if row["status"] == results.DONE or not retry_failed:
            mark = Version(row["size"], row["mark"])
            found[row["id"]] = (row["sections_sha256"], mark, row["inercal"], row["status"])
    return found


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
                line.run(work.row)
                errors[shape] = None
            except InercalError as error:
                has_file = isinstance(error, InputError) and error.file is not None
                errors[shape] = error if has_file else error.located(line.path)
        error = errors[shape]
        if error is None:
            kept.append(work)
        else:
            refused.append((work, error))
    if todo and not kept:
        raise next(error for error in errors.values() if error is not None)
    todo[:] = kept


_Compute = Callable[[Line, Path, Sequence[Work]], BatchDone]


class Scheduling:
    """Batches that are handed out and taken back, with few of them under way.

    Parameters
    ----------
    line : Line
    out : Path
        Of the parts.
    executor : TolerantExecutor
    batch : int or None
        Sensors of a batch; None for as many as take two seconds.
    counts : Counts
        Of the line, which is kept up to date.
    progress : callable or None
        Called with the counts after each batch.
    compute : callable
        Computes a batch: from the line without its rows, `out` and the work.
    """

    def __init__(
        self,
        line: Line,
        out: Path,
        executor: TolerantExecutor,
        batch: int | None,
        counts: Counts,
        progress: Callable[[Counts], None] | None,
        compute: _Compute,
    ):
        self._compute = compute
        self._line, self._out, self._executor = replace(line, rows=()), out, executor
        self._workers, self._batch = executor.workers, batch
        self._counts, self._progress = counts, progress
        self._under_way: dict[int, Sequence[Work]] = {}
        self._measured = 0
        self._seconds = 0.0

    def run(self, todo: Iterable[Work]) -> None:
        """Calibrate the sensors."""
        waiting = iter(todo)
        self._hand_out(waiting)
        for settled in self._executor.settled():
            self._take_back(settled)
            if self._progress is not None:
                self._progress(self._counts)
            self._hand_out(waiting)

    def _size(self) -> int:
        """Return how many sensors take two seconds; one, until that is known."""
        if self._batch is not None:
            return self._batch
        if not self._measured:
            return 1
        return round(min(max(TASK_SECONDS * self._measured / self._seconds, 1), _MOST_IN_BATCH))

    def _hand_out(self, waiting: Iterator[Work]) -> None:
        # Until a batch has come back, each worker has one: how long they take is not known.
        known = bool(self._measured or self._batch)
        window = self._workers * (_WINDOW if known else 1)
        while len(self._under_way) < window:
            some = [work for _, work in zip(range(self._size()), waiting, strict=False)]
            if not some:
                return
            self._submit(some)

    def _submit(self, work: Sequence[Work]) -> None:
        index = self._executor.submit(self._compute, self._line, self._out, work)
        self._under_way[index] = work
        self._counts.tasks += 1

    def _take_back(self, settled: Settled) -> None:
        work = self._under_way.pop(settled.index)
        if isinstance(settled.error, WorkerLost):
            self._answer_loss(work, settled.error)
        elif settled.error is not None:
            raise settled.error
        else:
            done: BatchDone = settled.result
            self._counts.done += done.done
            self._counts.failed += done.failed
            self._measured += len(work)
            self._seconds += done.seconds

    def _answer_loss(self, work: Sequence[Work], error: WorkerLost) -> None:
        """Send the sensors of a lost batch again one by one; one that is alone is the cause."""
        if len(work) > 1:
            for one in work:
                self._submit([one])
            return
        row = failed_row(self._line.folder, work[0], str(error), "WorkerLost", status=results.LOST)
        results.write_part(self._out, [row])
        self._counts.lost += 1
