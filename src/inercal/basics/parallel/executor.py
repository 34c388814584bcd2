"""What an executor is, and the one that runs tasks in this process."""

from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, Self

from inercal.basics.errors import InercalError
from inercal.basics.units import format_duration


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
