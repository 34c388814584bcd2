"""The bench that is simulated for one run, and for the same run when it goes on later."""

from pathlib import Path

from inercal.host.bench_simulator import BenchSimulator
from inercal.host.clock import SimulatedClock
from inercal.host.run_folder import LOG
from inercal.host.run_log import read_frames
from inercal.host.web.run_request import RunRequest, SimulationRequest, read_process_record

_TIME_STEP, _TIME_MARGIN = 10.0, 2.0  # s of the bench


def simulation_request(order: RunRequest) -> SimulationRequest | None:
    """Return the bench that is to be simulated; None where none is.

    A run that goes on has the bench that it had.
    """
    note = read_process_record(Path(order.folder)) if order.plan is None else None
    was = note.simulated if note is not None else None
    if order.simulated is None:
        return None if order.table or order.imu else was
    return SimulationRequest(order.simulated, was.seed if was is not None else order.seed)


def advance_past_log(bench: BenchSimulator, folder: Path) -> None:
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
    until = max((frame.time for frame in read_frames(log)), default=0.0) + _TIME_MARGIN
    clock = SimulatedClock(bench.clock)
    now = clock.now()
    while now < until:
        now = min(now + _TIME_STEP, until)
        clock.begin(now)
        clock.end()
    clock.close()
