"""An executor that uses this process, and starts other processes if the work is long enough.

The first tasks run here and show how long a task takes. Other processes start if the waiting tasks
would take long, or immediately if the user states their number. This process also computes tasks,
both before the others are ready and afterwards.
"""

import pickle
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import suppress
from functools import partial
from queue import Empty, SimpleQueue
from threading import Semaphore, Thread
from time import perf_counter
from typing import Any, Self

from inercal.basics.parallel.executor import Executor, Settled, Task, WorkerLost
from inercal.basics.parallel.worker_process import WorkerContext

# The server of the workers spends about 1 s on imports. Two processes halve the computing time, so
# for less than 2 s of work they would cost more than they save. Each further process costs a tenth
# of a second, and needs half of this work.
LEAST_WORK = 2.0  # s
_MOMENT = 1e-9  # s, to divide by
# The first task may spend half a second loading compiled kernels, so its time would make the work
# seem longer than it is.
_FIRST_SEEMS_LONGER = 3.0
# On Windows, Ctrl-C would not interrupt a wait without a time limit.
_WAIT = 0.2  # s


class ProcessExecutor(Executor):
    """Executor that runs tasks in this process and in others.

    Parameters
    ----------
    workers : int
        Number of computing processes including this one; 2 or more.
    least_work : float, optional
        Another process starts if the waiting tasks would take at least this time, s, and further
        ones if each has half of it to do.
    at_once : bool, optional
        Whether the processes start when the `with` block begins, while this process prepares the
        tasks.
    modules : sequence of str, optional
        Modules that the server of the other processes loads.
    """

    def __init__(
        self,
        workers: int,
        least_work: float = LEAST_WORK,
        at_once: bool = False,
        modules: Sequence[str] = (),
    ):
        super().__init__()  # the pool's thread also takes waiting tasks from it
        self._workers, self._least_work, self._at_once = workers, least_work, at_once
        self._bound: deque[Task] = deque()  # must run in this process: they cannot be pickled
        self._outcomes: SimpleQueue[Settled] = SimpleQueue()
        self._open: set[int] = set()  # submitted but not yet yielded
        self._task_seconds: float | None = None  # duration of one task, if known
        self._done_here = 0
        self._context = WorkerContext(modules)
        self._starting: Thread | None = None
        self._pool: ProcessPoolExecutor | None = None
        self._places = Semaphore(0)
        self._failure: Settled | None = None

    def __enter__(self) -> Self:
        """Start the other processes if they should start immediately."""
        if self._at_once:
            self._start(self._workers - 1)
        return self

    def submit(self, function: Callable[..., Any], *arguments: Any) -> int:
        """Accept a task and return its index."""
        self._open.add(self._count)
        return super().submit(function, *arguments)

    def completed(self) -> Iterator[tuple[int, Any]]:
        """Yield index and result of each task as it finishes."""
        while self._open:
            if self._starting is None and (others := self._repaid_workers()):
                self._start(others)
            if self._pool is not None:
                self._feed(self._pool)
            outcome = self._next_outcome()
            if outcome is None or outcome.index not in self._open:
                continue
            self._open.remove(outcome.index)
            if outcome.error is None:
                yield outcome.index, outcome.result
            else:
                self._fail(outcome)
        if self._failure is not None and self._failure.error is not None:
            raise self._failure.error

    def close(self) -> None:
        """Terminate the other processes."""
        self._waiting.clear()
        self._bound.clear()
        self._open.clear()
        if self._starting is not None:
            self._starting.join()
        if self._pool is not None:
            # The processes are terminated and not asked to stop, because a task may take minutes.
            # Idle processes lose nothing by this.
            self._context.terminate()
            self._pool.shutdown(wait=True)

    def _start(self, others: int) -> None:
        """Start other processes in a thread, because their server loads modules for a second."""
        # The pool holds one task more than it has processes, so a process that finishes can
        # continue while this process is busy.
        self._places = Semaphore(others + 1)
        self._context.prepare()
        self._starting = Thread(target=self._open_pool, args=(others,), daemon=True)
        self._starting.start()

    def _open_pool(self, others: int) -> None:
        pool = ProcessPoolExecutor(others, mp_context=self._context)
        with suppress(EOFError, OSError):  # without the server, this process does all the work
            pool.submit(int)  # a task starts a process
            self._pool = pool
            self._feed(pool)

    def _repaid_workers(self) -> int:
        """Return how many other processes the waiting tasks repay."""
        work, share = (self._task_seconds or 0.0) * len(self._waiting), self._least_work / 2
        most = min(self._workers, len(self._waiting) + 1, int(work / max(share, _MOMENT)))
        return max(most - 1, 0)

    def _next_outcome(self) -> Settled | None:
        """Return an outcome from another process, or else the result of a task computed here."""
        try:
            return self._outcomes.get_nowait()
        except Empty:
            pass
        for tasks in (self._bound, self._waiting):
            try:
                return self._run_here(tasks.popleft())
            except IndexError:
                continue
        try:
            return self._outcomes.get(timeout=_WAIT)
        except Empty:
            return None

    def _run_here(self, task: Task) -> Settled:
        begin = perf_counter()
        try:
            outcome = Settled(task.index, task(), None)
        except Exception as error:
            return Settled(task.index, None, error)
        seconds = perf_counter() - begin
        self._done_here += 1
        self._task_seconds = seconds / (_FIRST_SEEMS_LONGER if self._done_here == 1 else 1.0)
        return outcome

    def _feed(self, pool: ProcessPoolExecutor) -> None:
        """Hand tasks to the pool while it has room; the pool's thread also calls this."""
        while self._places.acquire(blocking=False):
            if (portable := self._next_portable()) is None:
                self._places.release()
                return
            index, content = portable
            try:
                future = pool.submit(_run_pickled, content)
            except RuntimeError as error:  # the pool is broken or closed
                self._outcomes.put(Settled(index, None, error))
                return
            future.add_done_callback(partial(self._receive, pool, index))

    def _next_portable(self) -> tuple[int, bytes] | None:
        """Return the index and content of the next task that can be pickled."""
        while True:
            try:
                task = self._waiting.popleft()
            except IndexError:
                return None
            try:
                return task.index, pickle.dumps((task.function, task.arguments))
            except Exception:  # the type of the error depends on the object that cannot be pickled
                self._bound.append(task)

    def _receive(self, pool: ProcessPoolExecutor, index: int, future: Future[Any]) -> None:
        """Store a result and hand over the next task; the pool's thread calls this."""
        error = future.exception()
        if not isinstance(error, BrokenProcessPool):
            self._places.release()
            self._feed(pool)
        self._outcomes.put(Settled(index, None if error else future.result(), error))

    def _fail(self, failed: Settled) -> None:
        """Store a failure and drop later tasks; earlier tasks may still fail first."""
        if isinstance(failed.error, BrokenProcessPool):
            raise WorkerLost(
                "a worker process was killed, perhaps because memory ran out; try fewer "
                "workers, such as --workers 1"
            ) from failed.error
        self._failure = failed
        self._open = {index for index in self._open if index < failed.index}
        for _ in range(len(self._waiting)):
            try:
                task = self._waiting.popleft()
            except IndexError:
                break
            if task.index < failed.index:
                self._waiting.append(task)


def _run_pickled(content: bytes) -> Any:
    function, arguments = pickle.loads(content)
    return function(*arguments)
