"""Tasks in several processes: this one, and others that start when the work is long enough.

The first tasks run here and show how long a task takes. Other processes start where the waiting
tasks would take long, or at once where the user states their number. This process computes tasks
too, before the others are ready and afterwards.
"""

import pickle
from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from functools import partial
from importlib import import_module
from queue import Empty, SimpleQueue
from threading import Semaphore
from time import perf_counter
from typing import Any, Self

from inercal.basics.parallel.executor import Executor, Settled, Task, WorkerLost
from inercal.basics.parallel.worker_process import WorkerContext

# A process imports for about 1 s until it computes. Two processes halve the time of the tasks: for
# less than 2 s of work they would save no more than they cost.
LEAST_WORK = 2.0  # s
# The first task may load compiled kernels for half a second: by it alone work seems longer.
_FIRST_SEEMS_LONGER = 3.0
# A wait without end would not hear the keyboard on Windows.
_WAIT = 0.2  # s


class ProcessExecutor(Executor):
    """Runs tasks in this process and in others.

    Parameters
    ----------
    workers : int
        Processes that compute, this one among them; 2 or more.
    least_work : float, optional
        Time that the waiting tasks must take by themselves for other processes to start, s.
    at_once : bool, optional
        Whether they start with the block of `with`, while this process prepares the tasks.
    """

    def __init__(self, workers: int, least_work: float = LEAST_WORK, at_once: bool = False):
        super().__init__()  # of those waiting the pool's thread takes some too
        self._workers, self._least_work, self._at_once = workers, least_work, at_once
        self._bound: deque[Task] = deque()  # to this process: they cannot be pickled
        self._outcomes: SimpleQueue[Settled] = SimpleQueue()
        self._open: set[int] = set()  # submitted, and not yielded
        self._task_seconds: float | None = None  # of one task, as far as known
        self._done_here = 0
        self._context = WorkerContext()
        self._pool: ProcessPoolExecutor | None = None
        # One task more than there are processes waits in the pool: one that is done goes on while
        # this process is busy.
        others = workers - 1
        self._places = Semaphore(others + 1)
        self._failure: Settled | None = None

    def __enter__(self) -> Self:
        """Start the other processes, if they are to start at once."""
        if self._at_once:
            self._start(self._workers - 1)
        return self

    def submit(self, function: Callable[..., Any], *arguments: Any) -> int:
        """Accept a task; return its index."""
        self._open.add(self._count)
        return super().submit(function, *arguments)

    def completed(self) -> Iterator[tuple[int, Any]]:
        """Yield index and result of each task as they come."""
        while self._open:
            if self._pool is None and self._is_long_work():
                self._start(min(self._workers - 1, len(self._waiting)))
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
        if self._pool is not None:
            # Not asked but terminated: a task may take minutes, and idle ones have nothing to lose.
            self._context.terminate()
            self._pool.shutdown(wait=True)

    def _start(self, others: int) -> None:
        self._pool = ProcessPoolExecutor(others, mp_context=self._context)
        for _ in range(others):  # each is started by a task
            self._pool.submit(_load_compiler)

    def _is_long_work(self) -> bool:
        if self._task_seconds is None:
            return False
        return self._task_seconds * len(self._waiting) >= self._least_work

    def _next_outcome(self) -> Settled | None:
        """Return what has come from another process, else the result of a task done here."""
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
        """Hand tasks to the pool while it has places; called in the pool's thread too."""
        while self._places.acquire(blocking=False):
            if (portable := self._next_portable()) is None:
                self._places.release()
                return
            index, content = portable
            try:
                future = pool.submit(_run_pickled, content)
            except RuntimeError as error:  # the pool is broken, or closed
                self._outcomes.put(Settled(index, None, error))
                return
            future.add_done_callback(partial(self._receive, pool, index))

    def _next_portable(self) -> tuple[int, bytes] | None:
        """Return the next task that can be pickled: its index and its content."""
        while True:
            try:
                task = self._waiting.popleft()
            except IndexError:
                return None
            try:
                return task.index, pickle.dumps((task.function, task.arguments))
            except Exception:  # of many types, by what cannot be pickled
                self._bound.append(task)

    def _receive(self, pool: ProcessPoolExecutor, index: int, future: Future[Any]) -> None:
        """Note a result and hand over the next task; called in the pool's thread."""
        error = future.exception()
        if not isinstance(error, BrokenProcessPool):
            self._places.release()
            self._feed(pool)
        self._outcomes.put(Settled(index, None if error else future.result(), error))

    def _fail(self, failed: Settled) -> None:
        """Note a failure; tasks after it are dropped, those before it may fail first."""
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


def _load_compiler() -> None:
    """Import what takes longest, before a task needs it."""
    import_module("numba")


def _run_pickled(content: bytes) -> Any:
    function, arguments = pickle.loads(content)
    return function(*arguments)
