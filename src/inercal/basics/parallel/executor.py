"""Define the interface of executors, and an executor that runs tasks in this process.

A task is divided into steps, which show the submitter its progress and have a time limit each. It
calls `begin_step` when a step begins; its first step begins automatically. The executor measures
the time of each step, and terminates the process if a step exceeds its limit.
"""

from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Callable, Generator, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from time import monotonic
from typing import Any, Self

from inercal.basics.closeable import Closeable
from inercal.basics.errors import InercalError
from inercal.basics.units import format_duration


class WorkerLost(InercalError):
    """A process that was computing a task ended without a result."""


class TimeExceeded(WorkerLost):
    """A step of a task exceeded its time limit, and its process was terminated."""

    step = 0  # counted from 0
    limit = 0.0  # s

    @classmethod
    def of(cls, step: int, limit: float) -> Self:
        """Return the error for a step and its time limit, s."""
        error = cls(f"stopped after {format_duration(limit)}")
        error.step, error.limit = step, limit
        return error


@dataclass(frozen=True)
class Settled:
    """A finished task: its index, and its result or the exception that it raised."""

    index: int
    result: Any
    error: BaseException | None


@dataclass(frozen=True)
class Task:
    """A function call, and its index in the order of submission."""

    index: int
    function: Callable[..., Any]
    arguments: tuple[Any, ...]

    def __call__(self) -> Any:
        """Call the function and return its result."""
        return self.function(*self.arguments)

    def settle(self) -> Settled:
        """Call the function in this process and return the outcome."""
        try:
            return Settled(self.index, self(), None)
        except Exception as error:
            return Settled(self.index, None, error)


class Executor(Closeable, ABC):
    """The interface of executors, which run tasks and are closed at the end of a `with` block."""

    def __init__(self):
        self._waiting: deque[Task] = deque()  # accepted but not started
        self._count = 0

    def submit(self, function: Callable[..., Any], *arguments: Any) -> int:
        """Accept a task, and return its index, counted from 0."""
        self._waiting.append(Task(self._count, function, arguments))
        self._count += 1
        return self._count - 1

    @abstractmethod
    def completed(self) -> Iterator[tuple[int, Any]]:
        """Yield the index and result of each task as it finishes, until all have finished.

        More tasks may be submitted in the meantime.

        Raises
        ------
        WorkerLost
            A process ended without a result.
        Exception
            The exception that a task raised; if several tasks failed, the exception of the task
            with the lowest index.
        """

    @abstractmethod
    def close(self) -> None:
        """Stop all running tasks immediately; unfinished tasks have no result."""


class TolerantExecutor(Executor):
    """An executor that continues after a task has failed or a worker process has ended."""

    dashboard = ""  # address of a page that shows the progress, if any
    limit: Callable[[int, int], float] | None = None
    """Function of task index and step number that returns the step's time limit, s; or None."""

    @property
    @abstractmethod
    def workers(self) -> int:
        """Number of tasks computed at once."""

    @abstractmethod
    def settled(self) -> Iterator[Settled]:
        """Yield each task as it ends; if its process ended, the outcome is `WorkerLost`.

        If a step takes longer than `limit`, its process is terminated, and the task ends with
        `TimeExceeded`. More tasks may be submitted in the meantime.
        """

    def forget_after(self, index: int) -> None:
        """Drop tasks with a larger index that have not started."""
        kept = [task for task in self._waiting if task.index <= index]
        self._waiting.clear()
        self._waiting.extend(kept)

    def completed(self) -> Iterator[tuple[int, Any]]:
        """Yield the index and result of each task as it finishes."""
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
    """Executor that runs each task in this process when it is asked for; no time limits."""

    @property
    def workers(self) -> int:
        """Number of tasks computed at once, always one."""
        return 1

    def settled(self) -> Iterator[Settled]:
        """Run and yield the tasks in order."""
        while self._waiting:
            yield self._waiting.popleft().settle()

    def close(self) -> None:
        """Drop the remaining tasks."""
        self._waiting.clear()


def in_order(executor: Executor, first: int = 0) -> Iterator[Any]:
    """Yield the results of an executor in the order of submission.

    Parameters
    ----------
    executor : Executor
    first : int
        Index of the first task that is not yet completed.

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


LOOK = 0.5
"""Time between an executor's checks of the steps, s."""
_MOST = 2.0  # longest time counted between two checks, s

_report: ContextVar[Callable[[int], None] | None] = ContextVar("report", default=None)


def begin_step(number: int) -> None:
    """Report that a step of the running task begins, if its time is being measured.

    Parameters
    ----------
    number : int
        Number of the step, counted from 0.
    """
    if number and (report := _report.get()) is not None:
        report(number)


@contextmanager
def reported_steps(report: Callable[[int], None]) -> Generator[None]:
    """Call a function at each step that begins in the block, including the first."""
    token = _report.set(report)
    try:
        report(0)
        yield
    finally:
        _report.reset(token)


class AwakeClock:
    """Clock that counts only the time during which this process was running, s.

    If this process was stopped, for example with Ctrl-Z in a terminal, its workers were usually
    stopped too, so this time must not count as a delay of a worker.
    """

    def __init__(self):
        self._last = monotonic()
        self._awake = 0.0

    def __call__(self) -> float:
        """Return the time; the caller must ask for the time at least every `LOOK` seconds."""
        now = monotonic()
        self._awake += min(now - self._last, _MOST)
        self._last = now
        return self._awake
