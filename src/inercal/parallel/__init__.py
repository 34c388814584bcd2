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

from inercal.errors import InercalError, InputError

_MOST = {"win32": 61}  # processes that Windows can wait for at once


class WorkerLost(InercalError):
    """A process that computed a task has ended without a result."""


@dataclass(frozen=True)
class Task:
    """A call, and its index in the order of submission."""

    index: int
    function: Callable[..., Any]
    arguments: tuple[Any, ...]

    def __call__(self) -> Any:
        """Return what the function returns."""
        return self.function(*self.arguments)


class Executor(ABC):
    """Runs tasks; a context manager that is closed at the end of its block."""

    @abstractmethod
    def submit(self, function: Callable[..., Any], *arguments: Any) -> int:
        """Accept a task; return its index, counted from 0."""

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


class SerialExecutor(Executor):
    """Runs each task in this process when its result is asked for."""

    def __init__(self):
        self._tasks: deque[Task] = deque()
        self._count = 0

    def submit(self, function: Callable[..., Any], *arguments: Any) -> int:
        """Accept a task; return its index."""
        self._tasks.append(Task(self._count, function, arguments))
        self._count += 1
        return self._count - 1

    def completed(self) -> Iterator[tuple[int, Any]]:
        """Yield index and result of each task, in order."""
        while self._tasks:
            task = self._tasks.popleft()
            yield task.index, task()

    def close(self) -> None:
        """Forget the tasks that are left."""
        self._tasks.clear()


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


def open_executor(workers: int | None = None) -> Executor:
    """Return an executor of so many workers, this process among them.

    Parameters
    ----------
    workers : int, optional
        By default one for each core that this process may use.

    Raises
    ------
    InputError
        No worker.
    """
    if workers is None:
        workers = available_cores()
    elif workers < 1:
        raise InputError(f"--workers {workers}: give 1 or more", key="--workers")
    if workers == 1:
        return SerialExecutor()
    from inercal.parallel.process_executor import ProcessExecutor

    return ProcessExecutor(min(workers, _MOST.get(sys.platform, workers)))


__all__ = [
    "Executor",
    "SerialExecutor",
    "Task",
    "WorkerLost",
    "available_cores",
    "in_order",
    "open_executor",
]
