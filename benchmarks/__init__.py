"""Speed and size against a peer or a limit, measured in one run: `python -m benchmarks`.

Each module has `rows()`, which checks that both sides give the same answer and then times them.
"""

import os
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[1]
DATA = Path(os.environ.get("INERCAL_DATA", ROOT.parent / "shared" / "data"))


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
    """

    name: str
    ours: float
    peer: float
    peer_name: str
    unit: str = "s"


@dataclass(frozen=True)
class Skipped:
    """A line that says why there is nothing to compare."""

    name: str
    reason: str


def best(work: Callable[[], object], repeat: int = 5) -> float:
    """Return the shortest of several times, s, after a first call that may compile."""
    work()
    times: list[float] = []
    for _ in range(repeat):
        begin = time.perf_counter()
        work()
        times.append(time.perf_counter() - begin)
    return min(times)
