"""Tasks in other processes only: one that dies loses the task that it computed, and no other.

A pool of the standard library breaks as a whole when one of its processes dies, and does not say
which task was being computed. Here each process computes one task at a time.
"""

import pickle
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from multiprocessing.connection import Connection, wait
from typing import Any

from inercal.parallel import Settled, Task, TolerantExecutor, WorkerLost
from inercal.parallel.worker_process import WorkerContext, WorkerProcess


@dataclass
class _Worker:
    process: WorkerProcess
    connection: Connection
    task: Task | None = None


class IsolatedExecutor(TolerantExecutor):
    """Runs tasks in other processes, and starts another where one has died.

    Parameters
    ----------
    workers : int
        Processes; each starts with its first task.
    """

    def __init__(self, workers: int):
        self._most = workers
        self._context = WorkerContext()
        self._workers: list[_Worker] = []
        self._waiting: deque[Task] = deque()
        self._count = 0

    @property
    def workers(self) -> int:
        """Processes at most."""
        return self._most

    def submit(self, function: Callable[..., Any], *arguments: Any) -> int:
        """Accept a task; return its index."""
        self._waiting.append(Task(self._count, function, arguments))
        self._count += 1
        return self._count - 1

    def forget_after(self, index: int) -> None:
        """Drop the tasks of larger index that do not run yet."""
        self._waiting = deque(task for task in self._waiting if task.index <= index)

    def settled(self) -> Iterator[Settled]:
        """Yield each task as it ends."""
        while True:
            self._hand_out()
            busy = [one for one in self._workers if one.task is not None]
            if not busy:
                return
            ready = wait([one.connection for one in busy])
            for worker in busy:
                if worker.connection in ready:
                    yield self._receive(worker)

    def close(self) -> None:
        """Terminate the processes."""
        self._waiting.clear()
        self._context.terminate()
        for worker in self._workers:
            worker.process.join()
            worker.connection.close()
        self._workers.clear()

    def _hand_out(self) -> None:
        """Give each process without a task the next one, and start processes that lack."""
        for worker in self._workers:
            if worker.task is None and self._waiting:
                self._send(worker, self._waiting.popleft())
        while self._waiting and len(self._workers) < self._most:
            worker = self._start()
            self._workers.append(worker)
            self._send(worker, self._waiting.popleft())

    def _start(self) -> _Worker:
        ours, theirs = self._context.Pipe()
        process = self._context.Process(target=_compute, args=(theirs,), daemon=True)
        process.start()
        theirs.close()
        return _Worker(process, ours)

    def _send(self, worker: _Worker, task: Task) -> None:
        worker.task = task
        content = pickle.dumps((task.function, task.arguments))
        with suppress(OSError):  # it has died: its connection is at its end, as `_receive` finds
            worker.connection.send_bytes(content)

    def _receive(self, worker: _Worker) -> Settled:
        """Return what a process has sent; one that has died is forgotten."""
        task, worker.task = worker.task, None
        assert task is not None
        try:
            result, error = pickle.loads(worker.connection.recv_bytes())
        except (EOFError, OSError):
            self._workers.remove(worker)
            worker.connection.close()
            worker.process.join()
            lost = WorkerLost(f"the worker died ({_describe_exit(worker.process.exitcode)})")
            return Settled(task.index, None, lost)
        return Settled(task.index, result, error)


def _describe_exit(code: int | None) -> str:
    return f"signal {-code}" if code is not None and code < 0 else f"exit status {code}"


def _compute(connection: Connection) -> None:
    """Compute the tasks that come, until the other end is closed."""
    while True:
        try:
            content = connection.recv_bytes()
        except (EOFError, OSError):
            return
        connection.send_bytes(_outcome(content))


def _outcome(content: bytes) -> bytes:
    try:
        function, arguments = pickle.loads(content)
        return pickle.dumps((function(*arguments), None))
    except Exception as error:
        try:
            return pickle.dumps((None, error))
        except Exception:  # of an error that cannot be pickled
            return pickle.dumps((None, RuntimeError(f"{type(error).__name__}: {error}")))
