"""The dead-man control of a jog: an axis only turns while messages about a held key arrive.

Each key press has a number. `begin` makes a press live, and each `hold` message with the same
number keeps it live for `HOLD_TIMEOUT` after the arrival of the message, by the host's monotonic
clock. A press that has expired or was released stays dead, so delayed messages cannot revive it.

The loop that drives the table calls `is_live` in each tick and stops the axis if the press is dead.
The loop may be late, because it waits for a reply from the table. In this case, a separate thread
calls `overdue`, and the watchdog stops the table through its own connection.
"""

from collections.abc import Callable
from threading import Condition, Thread
from time import monotonic

from inercal.basics.closeable import Closeable

# Time from the last message to the stop command, s. The command then reaches the table within 0.3
# s.
HOLD_TIMEOUT = 0.25
_OVERDUE = 0.05  # s after the timeout; the watchdog then stops the table


class DeadMan(Closeable):
    """The dead-man control of a session; any thread may call its methods.

    Parameters
    ----------
    overdue : callable
        Function that is called once for each motion that was not stopped in time.
    timeout : float
        Time for which a press stays live after its last message, s.
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
        """Begin a new press; the previous press is then dead, and its number cannot be reused."""
        with self._changed:
            if press != self._press:
                self._press, self._count = press, 0
                self._deadline = monotonic() + self._timeout
                self._changed.notify_all()

    def hold(self, press: int) -> None:
        """Keep a press live after a message."""
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
        """Return whether a press is held."""
        with self._changed:
            return press == self._press and monotonic() < self._deadline

    @property
    def count(self) -> int:
        """Number of messages that have kept the press live."""
        return self._count

    def set_moving(self, moving: bool) -> None:
        """State whether the press moves an axis; False when the stop command is sent."""
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
