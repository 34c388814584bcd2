"""The bench that is simulated for one run, and for the same run when it goes on later."""

from functools import partial
from pathlib import Path

from inercal.host.addresses import layout_of_address
from inercal.host.clock import SimulatedClock
from inercal.host.compile import compiled
from inercal.host.folder import LOG
from inercal.host.log import frames
from inercal.host.run import Addresses
from inercal.host.simulated import SimulatedBench
from inercal.host.web.order import Order, noted
from inercal.runfile import Run

_STEP, _LATER = 10.0, 2.0  # s of the bench
WORDS = "starting the simulated bench; the first time on a machine all is compiled, about a minute"


def preset_of(order: Order) -> str | None:
    """Return the preset of the packets of a bench to be simulated; None where none is.

    A run that goes on without a word of where has the bench that it had.
    """
    if order.simulated is None and order.plan is None and not (order.table or order.imu):
        was = noted(Path(order.folder))
        return was.simulated if was is not None else None
    return order.simulated


def started(order: Order, run: Run, preset: str) -> SimulatedBench:
    """Return the bench, alike for one run however often it goes on; compiles meanwhile.

    Raises
    ------
    InputError
        As `SimulatedBench`.
    """
    compiling = partial(compiled, run, layout_of_address(f"tcp://simulated:1?preset={preset}"))
    return SimulatedBench(run.path, order.seed, preset, meanwhile=compiling)


def addresses(bench: SimulatedBench) -> Addresses:
    """Return where a simulated bench is."""
    return Addresses(bench.table, bench.imu, bench.clock or "")


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
