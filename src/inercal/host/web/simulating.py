"""The bench that is simulated for one run, and for the same run when it goes on later."""

from pathlib import Path

from inercal.host.clock import SimulatedClock
from inercal.host.folder import LOG
from inercal.host.log import frames
from inercal.host.simulated import SimulatedBench
from inercal.host.web.order import RunRequest, Simulated, noted

_STEP, _LATER = 10.0, 2.0  # s of the bench


def wanted(order: RunRequest) -> Simulated | None:
    """Return the bench that is to be simulated; None where none is.

    A run that goes on has the bench that it had.
    """
    note = noted(Path(order.folder)) if order.plan is None else None
    was = note.simulated if note is not None else None
    if order.simulated is None:
        return None if order.table or order.imu else was
    return Simulated(order.simulated, was.seed if was is not None else order.seed)


def let_pass(bench: SimulatedBench, folder: Path) -> None:
    """Let pass the time that the log of a run has, as if the bench had gone on meanwhile.

    Raises
    ------
    InputError
        A log that is damaged.
    LinkLost
        The bench has ended.
    """
    log = folder / LOG
    if not log.exists() or bench.clock is None:
        return
    until = max((frame.time for frame in frames(log)), default=0.0) + _LATER
    clock = SimulatedClock(bench.clock)
    now = clock.now()
    while now < until:
        now = min(now + _STEP, until)
        clock.begin(now)
        clock.end()
    clock.close()
