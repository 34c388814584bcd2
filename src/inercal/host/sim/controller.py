"""Base classes of the simulated controllers: a table whose time they advance, and text lines."""

from collections.abc import Callable

from inercal.host.sim.dynamics import FAULTS, AxesMotion, SimulatedTable
from inercal.host.sim.faults import unknown_fault


class Controller:
    """A `server.Device` that turns a table; subclasses add its sessions.

    Parameters
    ----------
    table : Table
    """

    def __init__(self, table: SimulatedTable):
        self.table = table

    @property
    def time(self) -> float:
        """Bench time, s."""
        return self.table.time

    def advance(self, until: float) -> AxesMotion:
        """Let bench time pass; return the true motion in each servo cycle."""
        return self.table.advance(until)

    def fault(self, words: str) -> None:
        """Set a fault of the table, such as `amplifier 2` or `frozen 1 off`; axes count from 1.

        Raises
        ------
        InputError
            There is no such fault or axis; the message lists the possible ones.
        """
        count = len(self.table.axes)
        match words.split():
            case [what, number, *state] if (
                what in FAULTS
                and number in map(str, range(1, count + 1))
                and state in ([], ["on"], ["off"])
            ):
                self.table.fault(int(number) - 1, what, state != ["off"])
            case _:
                axes = f"then an axis from 1 to {count}, then on or off"
                raise unknown_fault(words, f"{', '.join(FAULTS)}, {axes}")


class LineSession:
    """A connection on which a controller receives lines and answers each one at once.

    Received bytes are split at `ending`, and `answer` takes a line.
    """

    def __init__(self, ending: bytes, answer: Callable[[str], str]):
        self._ending, self._answer = ending, answer
        self._buffer = b""

    def feed(self, data: bytes) -> bytes:
        """As `server.Session.feed`."""
        *lines, self._buffer = (self._buffer + data).split(self._ending)
        return "".join(self._answer(line.decode("latin-1").strip()) for line in lines).encode()
