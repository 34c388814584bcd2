"""Run tasks in worker processes, of which one that dies loses only its current task.

A pool of the standard library breaks as a whole when one of its processes dies, and does not say
which task was being computed. Here each process computes one task at a time.

`ProcessExecutor` runs tasks in this process, and then also in other processes if the work is long
enough. The first tasks run here and show how long a task takes. If the waiting tasks would take
long, other processes compute them; this process continues until the others are ready. If the user
states the number of processes, they compute all tasks.
"""

import pickle
from collections import deque
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from math import inf
from multiprocessing.connection import Connection, wait
from time import perf_counter
from typing import Any

from inercal.basics.parallel.executor import (
    LOOK,
    AwakeClock,
    Executor,
    Settled,
    Task,
    TimeExceeded,
    TolerantExecutor,
    WorkerLost,
    reported_steps,
)
from inercal.basics.parallel.worker_process import WorkerContext, WorkerProcess

_STARTS = 5  # number of processes that may die before they start a task
_LONGEST_START = 600.0  # s, for a process to start and import on a busy machine


@dataclass
class _Worker:
    process: WorkerProcess
    connection: Connection
    task: Task | None = None
    step: int | None = None  # None until the task starts
    since: float = 0.0  # time on the executor's clock


class IsolatedExecutor(TolerantExecutor):
    """Executor that runs tasks in other processes and replaces processes that have died.

    Parameters
    ----------
    workers : int
        Number of processes; each starts with its first task.
    modules : sequence of str, optional
        Modules that the server of the processes loads.
    waiting : deque of Task, optional
        Accepted tasks, if another executor accepts them.
    """

    def __init__(
        self, workers: int, modules: Sequence[str] = (), waiting: deque[Task] | None = None
    ):
        super().__init__()
        if waiting is not None:
            self._waiting = waiting
        self._bound: deque[Task] = deque()  # must run in this process: they cannot be pickled
        self._most = workers
        self._context = WorkerContext(modules)
        self._context.prepare()
        self._workers: list[_Worker] = []
        self._failed_starts = 0
        self._clock = AwakeClock()

    @property
    def workers(self) -> int:
        """Largest number of processes."""
        return self._most

    def settled(self) -> Iterator[Settled]:
        """Yield each task as it ends."""
        while True:
            self._hand_out()
            while self._bound:
                yield self._bound.popleft().settle()
            busy = [one for one in self._workers if one.task is not None]
            if not busy:
                if self._waiting:
                    continue
                return
            ready = wait([one.connection for one in busy], LOOK)
            now = self._clock()
            for worker in busy:
                # Received messages are read before time limits are checked, because this process
                # may have slept.
                found = self._receive(worker) if worker.connection in ready else self._judge(worker)
                if found is not None:
                    yield found
                elif worker.connection in ready:
                    worker.since = now

    def close(self) -> None:
        """Terminate the processes."""
        self._waiting.clear()
        self._context.terminate()
        for worker in self._workers:
            worker.process.join()
            worker.connection.close()
        self._workers.clear()

    def _hand_out(self) -> None:
        """Give each idle process the next task, and start missing processes."""
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
        try:
            content = pickle.dumps((task.function, task.arguments))
        except Exception:  # the type of the error depends on the object that cannot be pickled
            self._bound.append(task)
            return
        worker.task, worker.step, worker.since = task, None, self._clock()
        with suppress(OSError):  # it has died; `_receive` will find its connection closed
            worker.connection.send_bytes(content)

    def _receive(self, worker: _Worker) -> Settled | None:
        """Return the outcome that a process sent; None for a step, or if the task is sent again."""
        assert worker.task is not None
        try:
            message = pickle.loads(worker.connection.recv_bytes())
        except (EOFError, OSError):
            return self._answer_death(worker)
        if isinstance(message, int):
            worker.step = message
            return None
        index, worker.task = worker.task.index, None
        result, error = message
        return Settled(index, result, error)

    def _answer_death(self, worker: _Worker) -> Settled | None:
        """Drop a process that has died; if its task had not started, send it to another process."""
        task = self._remove(worker)
        code = worker.process.exitcode
        how = f"signal {-code}" if code is not None and code < 0 else f"exit status {code}"
        if worker.step is None and self._failed_starts < _STARTS:
            self._failed_starts += 1
            self._waiting.appendleft(task)
            return None
        return Settled(task.index, None, WorkerLost(f"the worker died ({how})"))

    def _judge(self, worker: _Worker) -> Settled | None:
        """Terminate a process whose step has exceeded its time limit."""
        assert worker.task is not None
        if self.limit is None:
            return None
        step = worker.step
        limit = _LONGEST_START if step is None else self.limit(worker.task.index, step)
        if self._clock() - worker.since <= limit:
            return None
        worker.process.kill()
        if step is None:
            return self._answer_death(worker)
        return Settled(self._remove(worker).index, None, TimeExceeded.of(step, limit))

    def _remove(self, worker: _Worker) -> Task:
        assert worker.task is not None
        self._workers.remove(worker)
        worker.connection.close()
        worker.process.join()
        return worker.task


def _compute(connection: Connection) -> None:
    """Compute incoming tasks until the other end of the connection is closed."""
    while True:
        try:
            content = connection.recv_bytes()
        except (EOFError, OSError):
            return
        with reported_steps(lambda number: connection.send_bytes(pickle.dumps(number))):
            outcome = _outcome(content)
        connection.send_bytes(outcome)


def _outcome(content: bytes) -> bytes:
    try:
        function, arguments = pickle.loads(content)
        return pickle.dumps((function(*arguments), None))
    except Exception as error:
        try:
            return pickle.dumps((None, error))
        except Exception:  # the result or error cannot be pickled
            return pickle.dumps((None, RuntimeError(f"{type(error).__name__}: {error}")))


# The server of the processes spends about 1 s on imports. Two processes halve the computing time,
# so for less than 2 s of work they would cost more than they save. Each further process costs a
# tenth of a second, and needs half of this work.
LEAST_WORK = 2.0  # s
# The first task may spend half a second loading compiled kernels, so its time would make the work
# seem longer than it is.
_FIRST_SEEMS_LONGER = 3.0
_MOMENT = 1e-9  # s, to divide by


class ProcessExecutor(Executor):
    """Executor that runs tasks in this process, or in others if they repay it.

    Parameters
    ----------
    workers : int
        Largest number of other processes; 2 or more.
    least_work : float, optional
        Two processes start if the waiting tasks would take at least this time, s, and further ones
        if each has half of it to do.
    at_once : bool, optional
        Whether other processes compute all tasks. They get ready while this process prepares the
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
        super().__init__()
        self._workers, self._share, self._modules = workers, least_work / 2, modules
        self._others: IsolatedExecutor | None = None
        self._ready = inf  # time on the clock at which the others take over
        self._first_here = True
        if at_once:
            self._open_others(workers)
            self._ready = -inf

    def completed(self) -> Iterator[tuple[int, Any]]:
        """Yield index and result of each task as it finishes."""
        while self._waiting and perf_counter() < self._ready:
            task, begin = self._waiting.popleft(), perf_counter()
            result = task()
            seconds = perf_counter() - begin
            if self._others is None:
                each = seconds / (_FIRST_SEEMS_LONGER if self._first_here else 1.0)
                self._first_here = False
                repaid = int(each * len(self._waiting) / max(self._share, _MOMENT))
                if (number := min(self._workers, len(self._waiting), repaid)) > 1:
                    self._open_others(number)
            yield task.index, result
        if self._others is not None and self._waiting:
            try:
                yield from self._others.completed()
            except WorkerLost as lost:
                raise WorkerLost(
                    "a worker process was killed, perhaps because memory ran out; try fewer "
                    "workers, such as --workers 1"
                ) from lost

    def close(self) -> None:
        """Terminate the other processes."""
        self._waiting.clear()
        if self._others is not None:
            self._others.close()

    def _open_others(self, number: int) -> None:
        self._others = IsolatedExecutor(number, self._modules, self._waiting)
        self._ready = perf_counter() + self._share  # its server loads modules meanwhile
