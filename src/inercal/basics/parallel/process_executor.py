"""Run tasks in this process, and then also in other processes if the work is long enough.

The first tasks run here and show how long a task takes. If the waiting tasks would take long, other
processes compute them; this process continues until the others are ready. If the user states the
number of processes, they compute all tasks.
"""

from collections.abc import Iterator, Sequence
from math import inf
from time import perf_counter
from typing import Any

from inercal.basics.parallel.executor import Executor, WorkerLost
from inercal.basics.parallel.isolated_executor import IsolatedExecutor

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
