"""A line calibrated in batches: what is done is skipped, what fails is a row, nothing is lost."""

import json
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from copy import deepcopy
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any, cast

from inercal.errors import InercalError, InputError
from inercal.fleet import results
from inercal.fleet.batch import BatchDone, Work, compute_batch, failed_row
from inercal.fleet.line import Line, SensorRow, sections_digest
from inercal.fleet.recordings import Version, version_of
from inercal.io.atomic_files import write_text
from inercal.parallel import Settled, TolerantExecutor, WorkerLost

TASK_SECONDS = 2.0  # of a batch: its overhead is then small, and little is lost with a worker
_MOST_IN_BATCH = 200
_WINDOW = 4  # batches a worker that are handed out
SUMMARY = "fleet.json"


@dataclass
class Counts:
    """Sensors of a line by what became of them.

    Parameters
    ----------
    sensors : int
        In the table.
    kept : int
        With a result that was there.
    done, failed, lost : int
        Calibrated now; refused now; whose worker died.
    tasks : int
        Batches.
    """

    sensors: int
    kept: int = 0
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
    workers: int,
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
        Where batches are computed; it is not closed.
    workers : int
        Its workers; so many times four batches are handed out at once.
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
    _refuse_wrong_template(line, todo, refused)
    if refused:
        results.write_part(folder, [failed_row(line.folder, *one) for one in refused])
        counts.failed += len(refused)
    _Scheduling(line, folder, executor, workers, batch, counts, progress).run(todo)
    write_summary(folder, counts)
    return counts


def write_summary(folder: Path, counts: Counts) -> None:
    """Write counts and version beside the parts."""
    content = {"inercal": version("inercal"), **vars(counts)}
    write_text(folder / SUMMARY, json.dumps(content, indent=1) + "\n")


_Refused = tuple[Work, str, str]  # with the error and its type


def _pending(
    line: Line, folder: Path, retry_failed: bool, counts: Counts
) -> tuple[list[Work], list[_Refused]]:
    """Return the sensors to calibrate, and those whose recording is not there."""
    known = _known_versions(folder, retry_failed)
    todo: list[Work] = []
    refused: list[_Refused] = []
    for row in line.rows:
        try:
            sections = line.sections(row)
        except InputError as error:
            refused.append(_refusal(row, {}, error))
            continue
        work = Work(row, sections, sections_digest(sections), Version(0, ""))
        try:
            found = version_of(line.folder, row.recording)
        except InputError as error:
            refused.append((work, str(error), type(error).__name__))
            continue
        if known.get(row.id) == (work.digest, found, version("inercal")):
            counts.kept += 1
        else:
            todo.append(Work(row, sections, work.digest, found))
    return todo, refused


def _refusal(row: SensorRow, sections: Mapping[str, Any], error: InputError) -> _Refused:
    work = Work(row, sections, sections_digest(sections), Version(0, ""))
    return work, str(error), type(error).__name__


def _known_versions(folder: Path, retry_failed: bool) -> dict[str, tuple[str, Version, str]]:
    """Return digest of the sections, version of the recording and of inercal of each result."""
    columns = ("id", "sections_sha256", "size", "mark", "status", "inercal")
    found: dict[str, tuple[str, Version, str]] = {}
    for row in results.read_results(folder, columns).to_pylist():
        if row["status"] == results.DONE or not retry_failed:
            mark = Version(row["size"], row["mark"])
            found[row["id"]] = (row["sections_sha256"], mark, row["inercal"])
    return found


def _refuse_wrong_template(line: Line, todo: list[Work], refused: list[_Refused]) -> None:
    """Check each run file that differs by more than sensor and recording, before any work.

    Sensors whose run file is wrong are moved to `refused`.

    Raises
    ------
    InputError
        Every run file is wrong.
    """
    from inercal.runfile import from_sections

    errors: dict[str, InercalError | None] = {}
    first: InercalError | None = None
    kept: list[Work] = []
    for work in todo:
        shape = _shape(work.sections)
        if shape not in errors:
            try:
                from_sections(line.path, deepcopy(dict(work.sections)), work.digest)
                errors[shape] = None
            except InercalError as error:
                errors[shape] = error.located(line.path) if _has_path(error) else error
        error = errors[shape]
        if error is None:
            kept.append(work)
        else:
            first = first or error
            refused.append((work, str(error), type(error).__name__))
    if first is not None and not kept:
        raise first
    todo[:] = kept


def _has_path(error: InercalError) -> bool:
    return isinstance(error, InputError) and error.file is None


def _shape(sections: Mapping[str, Any]) -> str:
    """Return what a run file says apart from sensor and recording."""
    bare: dict[str, Any] = deepcopy(dict(sections))
    for section, key in (("sensor", "name"), ("data", "file")):
        if isinstance(one := bare.get(section), dict):
            cast(dict[str, Any], one).pop(key, None)
    return sections_digest(bare)


class _Scheduling:
    """Batches that are handed out and taken back, with few of them under way."""

    def __init__(
        self,
        line: Line,
        out: Path,
        executor: TolerantExecutor,
        workers: int,
        batch: int | None,
        counts: Counts,
        progress: Callable[[Counts], None] | None,
    ):
        self._line, self._out, self._executor = line, out, executor
        self._window, self._batch = _WINDOW * workers, batch
        self._workers, self._counts, self._progress = workers, counts, progress
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
        window = self._window if self._measured or self._batch else self._workers
        while len(self._under_way) < window:
            some = [work for _, work in zip(range(self._size()), waiting, strict=False)]
            if not some:
                return
            self._submit(some)

    def _submit(self, work: Sequence[Work]) -> None:
        index = self._executor.submit(compute_batch, self._line.folder, self._out, work)
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
