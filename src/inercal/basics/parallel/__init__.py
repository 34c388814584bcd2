"""Tasks that do not depend on one another, in this process or in several, with equal results.

A task is a call of a function with its arguments. An executor decides where and when a task runs,
never what it computes: the random stream of a task comes from its arguments, and tasks are cut in
the same way for any number of workers. So results do not depend on that number.

Functions and arguments that can be pickled may run in another process; others run in this one.
"""

import os
import sys
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, Self

from inercal.basics.errors import InercalError, InputError
from inercal.basics.units import format_duration

LOCAL = "local"
"""Instead of the address of a scheduler: this machine."""
_MOST = {"win32": 61}  # processes that Windows can wait for at once


class WorkerLost(InercalError):
    """A process that computed a task has ended without a result."""


class TimeExceeded(WorkerLost):
    """A step of a task took longer than its limit, and its process was ended."""

    step = 0  # counted from 0
    limit = 0.0  # s

    @classmethod
    def of(cls, step: int, limit: float) -> Self:
        """Return the error of a step with its limit, s."""
        error = cls(f"stopped after {format_duration(limit)}")
        error.step, error.limit = step, limit
        return error


@dataclass(frozen=True)
class Task:
    """A call, and its index in the order of submission."""

    index: int
    function: Callable[..., Any]
    arguments: tuple[Any, ...]

    def __call__(self) -> Any:
        """Return what the function returns."""
        return self.function(*self.arguments)


@dataclass(frozen=True)
class Settled:
    """A task that has ended: its index, and its result or what it raised."""

    index: int
    result: Any
    error: BaseException | None


class Executor(ABC):
    """Runs tasks; a context manager that is closed at the end of its block."""

    def __init__(self):
        self._waiting: deque[Task] = deque()  # accepted, and not begun
        self._count = 0

    def submit(self, function: Callable[..., Any], *arguments: Any) -> int:
        """Accept a task; return its index, counted from 0."""
        self._waiting.append(Task(self._count, function, arguments))
        self._count += 1
        return self._count - 1

    @abstractmethod
    def completed(self) -> Iterator[tuple[int, Any]]:
        """Yield index and result of each task as they come, until no task is left.

        Tasks may be submitted meanwhile.

        Raises
        ------
        WorkerLost
            A process ended without a result.
        Exception
            What a task raised: of several failed tasks, that of the first one by index.
        """

    @abstractmethod
    def close(self) -> None:
        """Stop at once whatever still runs; tasks that are not completed have no result."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


class TolerantExecutor(Executor):
    """An executor that continues after a task has failed, or a process was lost."""

    dashboard = ""  # address of a page that shows the work, if there is one
    limit: Callable[[int, int], float] | None = None
    """The longest time of a step, s, by index of the task and number of the step; None for any."""

    @property
    @abstractmethod
    def workers(self) -> int:
        """How many tasks it computes at once."""

    @abstractmethod
    def settled(self) -> Iterator[Settled]:
        """Yield each task as it ends, until no task is left; a lost process is `WorkerLost`.

        A process that computes a step for longer than `limit` is ended, and its task is settled
        with `TimeExceeded`. Tasks may be submitted meanwhile.
        """

    def forget_after(self, index: int) -> None:
        """Drop the tasks of larger index that do not run yet."""
        self._waiting = deque(task for task in self._waiting if task.index <= index)

    def completed(self) -> Iterator[tuple[int, Any]]:
        """Yield index and result of each task as they come."""
        failed: Settled | None = None
        for one in self.settled():
            if failed is not None and one.index > failed.index:
                continue
            if one.error is None:
                yield one.index, one.result
            else:
                failed = one
                self.forget_after(one.index)
        if failed is not None and failed.error is not None:
            raise failed.error


class SerialExecutor(TolerantExecutor):
    """Runs each task in this process when its result is asked for, without a limit of time."""

    @property
    def workers(self) -> int:
        """One."""
        return 1

    def settled(self) -> Iterator[Settled]:
        """Yield each task, in order."""
        while self._waiting:
            task = self._waiting.popleft()
            try:
                result = task()
            except Exception as error:
                yield Settled(task.index, None, error)
            else:
                yield Settled(task.index, result, None)

    def close(self) -> None:
        """Forget the tasks that are left."""
        self._waiting.clear()


def in_order(executor: Executor, first: int = 0) -> Iterator[Any]:
    """Yield the results of an executor in the order of submission.

    Parameters
    ----------
    executor : Executor
    first : int
        Index of the first task that is not completed.

    Examples
    --------
    >>> with SerialExecutor() as executor:
    ...     indices = [executor.submit(pow, 2, k) for k in range(3)]
    ...     list(in_order(executor))
    [1, 2, 4]
    """
    early: dict[int, Any] = {}
    following = first
    for index, result in executor.completed():
        early[index] = result
        while following in early:
            yield early.pop(following)
            following += 1


def available_cores() -> int:
    """Return the number of cores that this process may use."""
    if sys.version_info >= (3, 13):
        return os.process_cpu_count() or 1
    if sys.platform == "linux":
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def open_executor(workers: int | None = None, scheduler: str | None = None) -> Executor:
    """Return an executor of so many workers, this process among them, or one on a Dask cluster.

    Parameters
    ----------
    workers : int, optional
        By default one for each core that this process may use, if the work is long enough.
    scheduler : str, optional
        Address of a Dask scheduler, "tcp://host:8786" or "tls://host:8786"; "local" is this
        machine: as many processes as without it, which open no port.

    Raises
    ------
    InputError
        No worker, workers of a scheduler that has its own, or no scheduler at the address.
    MissingExtra
        Dask is not installed.
    """
    _require_worker(workers)
    if scheduler is not None and scheduler != LOCAL:
        return _open_cluster(scheduler, workers)
    if (number := _processes(workers)) == 1:
        return SerialExecutor()
    from inercal.basics.parallel.process_executor import ProcessExecutor

    return ProcessExecutor(number, at_once=workers is not None)


def open_tolerant_executor(
    workers: int | None = None, scheduler: str | None = None
) -> TolerantExecutor:
    """Return an executor whose tasks run in other processes, so that it survives their loss.

    Parameters
    ----------
    workers, scheduler
        As of `open_executor`.

    Raises
    ------
    InputError, MissingExtra
        As of `open_executor`.
    """
    _require_worker(workers)
    if scheduler is not None and scheduler != LOCAL:
        return _open_cluster(scheduler, workers)
    from inercal.basics.parallel.isolated_executor import IsolatedExecutor

    return IsolatedExecutor(_processes(workers))


def _open_cluster(scheduler: str, workers: int | None) -> TolerantExecutor:
    from inercal.basics.parallel.dask_executor import open_dask

    return open_dask(scheduler, workers)


def _require_worker(workers: int | None) -> None:
    if workers is not None and workers < 1:
        raise InputError(f"--workers {workers}: give 1 or more", key="--workers")


def _processes(workers: int | None) -> int:
    wanted = available_cores() if workers is None else workers
    return min(wanted, _MOST.get(sys.platform, wanted))


__all__ = [
    "LOCAL",
    "Executor",
    "SerialExecutor",
    "Settled",
    "Task",
    "TimeExceeded",
    "TolerantExecutor",
    "WorkerLost",
    "available_cores",
    "in_order",
    "open_executor",
    "open_tolerant_executor",
]
