"""Speed against a peer, measured in one run: `python -m benchmarks`.

Each module has `rows()`, which checks that both sides give the same answer and then times them.
"""

import time
from collections.abc import Callable
from dataclasses import dataclass


@dataclass(frozen=True)
class Row:
    """One line of the table.

    Parameters
    ----------
    name : str
        The work.
    ours, peer : float
        Seconds for the same work.
    peer_name : str
        Who the peer is.
    """

    name: str
    ours: float
    peer: float
    peer_name: str


def best(work: Callable[[], object], repeat: int = 5) -> float:
    """Return the shortest of several times, s, after a first call that may compile."""
    work()
    times: list[float] = []
    for _ in range(repeat):
        begin = time.perf_counter()
        work()
        times.append(time.perf_counter() - begin)
    return min(times)
