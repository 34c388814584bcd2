"""Steps of a task, by which who submitted it sees where it is, and stops it if a step takes long.

A task says by `begin_step` that a step begins; its first one begins by itself. The executor counts
the time of each step, and ends the process that computes one beyond its limit.
"""

from collections.abc import Callable, Generator
from contextlib import contextmanager
from contextvars import ContextVar
from time import monotonic

LOOK = 0.5
"""Time after which an executor looks at the steps again, s."""
_MOST = 2.0  # s that count from one look to the next

_report: ContextVar[Callable[[int], None] | None] = ContextVar("report", default=None)


def begin_step(number: int) -> None:
    """Say that a step of the task that runs here begins; nothing if nobody counts its time.

    Parameters
    ----------
    number : int
        Counted from 0.
    """
    if number and (report := _report.get()) is not None:
        report(number)


@contextmanager
def reported_steps(report: Callable[[int], None]) -> Generator[None]:
    """Call a function with each step that begins in the block, the first one among them."""
    token = _report.set(report)
    try:
        report(0)
        yield
    finally:
        _report.reset(token)


class AwakeClock:
    """Time while this process was awake, s.

    One that was stopped, as by Ctrl-Z in a terminal, was often stopped together with its workers:
    what passed meanwhile is nobody's delay.
    """

    def __init__(self):
        self._last = monotonic()
        self._awake = 0.0

    def __call__(self) -> float:
        """Return the time; it is asked at least every `LOOK`."""
        now = monotonic()
        self._awake += min(now - self._last, _MOST)
        self._last = now
        return self._awake
