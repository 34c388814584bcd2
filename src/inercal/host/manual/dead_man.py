"""The dead-man of a jog: an axis turns only while messages of a held key arrive.

A press has a number. `begin` makes it live, each `hold` of the same number keeps it so, by the
host's monotonic clock, for `HOLD_TIMEOUT` from its arrival. A press that has expired or was
released is dead for good: messages that were held up on their way revive nothing.

The loop that drives the table asks `is_live` in each tick and stops the axis. Where it does not do
so in time, because it waits for a reply of the table, `overdue` is called from a thread of its own,
which has the watchdog stop the table by the watchdog's own connection.
"""

from collections.abc import Callable
from threading import Condition, Thread
from time import monotonic

from inercal.host.closeable import Closeable

# s from the last message to the command that stops, so that it is with the table by 0.3 s
HOLD_TIMEOUT = 0.25
_OVERDUE = 0.05  # s beyond it after which the watchdog must stop the table


class DeadMan(Closeable):
    """The dead-man of one session; its methods may be called from any thread.

    Parameters
    ----------
    overdue : callable
        Called once for each motion that was not stopped in time.
    timeout : float
        s that a press lives on after its last message.
    """

    def __init__(self, overdue: Callable[[], object], timeout: float = HOLD_TIMEOUT):
        self._overdue, self._timeout = overdue, timeout
        self._changed = Condition()
        self._press: int | None = None
        self._deadline, self._count = 0.0, 0
        self._is_moving = self._closed = False
        self._thread = Thread(target=self._watch, name="dead-man", daemon=True)
        self._thread.start()

    def begin(self, press: int) -> None:
        """Begin a new press; the previous one is dead, and its number cannot be used again."""
        with self._changed:
            if press != self._press:
                self._press, self._count = press, 0
                self._deadline = monotonic() + self._timeout
                self._changed.notify_all()

    def hold(self, press: int) -> None:
        """Keep a press alive."""
        with self._changed:
            now = monotonic()
            if press == self._press and now < self._deadline:
                self._deadline, self._count = now + self._timeout, self._count + 1

    def release(self) -> None:
        """End the press now."""
        with self._changed:
            self._deadline = min(self._deadline, monotonic())
            self._changed.notify_all()

    def is_live(self, press: int) -> bool:
        """Tell whether a press is held."""
        with self._changed:
            return press == self._press and monotonic() < self._deadline

    @property
    def count(self) -> int:
        """How many messages have kept the press alive."""
        return self._count

    def set_moving(self, moving: bool) -> None:
        """State whether the press moves an axis; false once the stop command is sent."""
        with self._changed:
            self._is_moving = moving
            self._changed.notify_all()

    def close(self) -> None:
        """End the thread."""
        with self._changed:
            self._closed = True
            self._changed.notify_all()

    def _watch(self) -> None:
        with self._changed:
            while not self._closed:
                left = self._deadline + _OVERDUE - monotonic()
                if not self._is_moving:
                    self._changed.wait()
                elif left > 0:
                    self._changed.wait(left)
                else:
                    self._is_moving = False
                    self._overdue()
