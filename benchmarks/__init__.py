"""Speed and size against a peer or a limit, measured in one run: `python -m benchmarks`.

Each module has `rows()`, which checks that both sides give the same answer and then times them.
"""

import os
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[1]
LEAST_TIME = 1.0  # s
DATA = Path(os.environ.get("INERCAL_DATA", ROOT.parent / "shared" / "data"))


class Duration(float):
    """A time, s, that a row judges, with what it is a part of or stands for.

    Parameters
    ----------
    value : float
        The judged one of the others.
    wall, processor : float
        Of the work, s; the processor's of all its processes.
    """

    wall: float
    processor: float

    def __new__(cls, value: float, wall: float, processor: float) -> "Duration":
        """Return the value with the other times."""
        new = super().__new__(cls, value)
        new.wall, new.processor = wall, processor
        return new


@dataclass(frozen=True)
class Row:
    """One line of the table.

    Parameters
    ----------
    name : str
        The work.
    ours, peer : float
        Time or memory for the same work.
    peer_name : str
        Who the peer is; "limit" where it is a number that ours must not exceed.
    unit : str
        Of ours and peer.
    to_reach : float
        The least ratio of peer to ours that is wanted.
    """

    name: str
    ours: float
    peer: float
    peer_name: str
    unit: str = "s"
    to_reach: float = 1.0

    @property
    def ratio(self) -> float:
        """How many times the peer's size is ours."""
        return self.peer / self.ours

    @property
    def reached(self) -> bool:
        """Whether the ratio is the wanted one or better."""
        return self.ratio >= self.to_reach

    @property
    def times(self) -> tuple[float, float] | None:
        """Wall and processor time of our work, s, where both were measured."""
        ours = self.ours
        return (ours.wall, ours.processor) if isinstance(ours, Duration) else None


@dataclass(frozen=True)
class Skipped:
    """A line that says why there is nothing to compare."""

    name: str
    reason: str


def best(work: Callable[[], object], repeat: int = 5) -> Duration:
    """Return the least processor time of several, s, after a first call that may compile.

    Short work is repeated for a second: other work on the machine lengthens some of its turns.
    """
    work()
    times: list[Duration] = []
    while len(times) < repeat or sum(times) < LEAST_TIME:
        begin, used = time.perf_counter(), time.process_time()
        work()
        wall, processor = time.perf_counter() - begin, time.process_time() - used
        times.append(Duration(processor, wall, processor))
    return min(times)
