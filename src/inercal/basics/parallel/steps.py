"""Divide a task into steps, which show the submitter its progress and have a time limit each.

A task calls `begin_step` when a step begins; its first step begins automatically. The executor
measures the time of each step, and terminates the process if a step exceeds its limit.
"""

from collections.abc import Callable, Generator
from contextlib import contextmanager
from contextvars import ContextVar
from time import monotonic

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
