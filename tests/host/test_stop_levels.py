"""Every level of a stop is reached where the one before it failed: ^A, J/, the watchdog.

The controller is the strict one of `strict_pmac`, which knows nothing of the project's simulator.
Times are those at which it read the requests.
"""

import os
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from math import radians
from threading import Event, Thread
from time import monotonic
from typing import Any

import pytest
from tests.host.strict_pmac import COUNTS_PER_TURN, StrictPmac

from inercal.host.drivers.pmac import Pmac, PmacAxis
from inercal.host.drivers.pmac_dialogue import STOP_TIMEOUT
from inercal.host.drivers.rotary_table import ProtocolError
from inercal.host.guard.watchdog import Watchdog
from inercal.host.sequencer import StopCommand
from inercal.host.table_driver import TableDriver

pytestmark = pytest.mark.wall_time

TRIALS = 50
NEXT_LEVEL = 0.3  # s from the failure of a level to the command of the next on the wire
RATE, ACCELERATION = radians(100), radians(2000)
DECELERATION = 100 / 2000  # s
AXES = tuple(
    PmacAxis(name, i, COUNTS_PER_TURN) for i, name in enumerate(("outer", "middle", "inner"), 1)
)
PATIENCE = 20.0  # s; what is waited for comes at once on an idle machine


def rest_within(server: StrictPmac, seconds: float) -> bool:
    end = monotonic() + seconds
    while not server.is_at_rest() and monotonic() < end:
        Event().wait(0.01)
    return server.is_at_rest()


@contextmanager
def turning(server: StrictPmac) -> Iterator[Pmac]:
    with Pmac(server.address, AXES, timeout=PATIENCE) as table:
        table.enable()
        for axis in table.axes:
            table.spin(axis, RATE, ACCELERATION)
        assert not server.is_at_rest()
        yield table


def repeat(trial: Callable[[], None]) -> None:
    """Do a trial as often as is required, many at once: most of its time is waiting."""
    with ThreadPoolExecutor(TRIALS // 2) as pool:
        for done in [pool.submit(trial) for _ in range(TRIALS)]:
            done.result()


def ignores_abort(request: str, connection: int) -> bool:
    return request == "^A"


def ignores_stops(request: str, connection: int) -> bool:
    """Ignore on the first connection what stops a table."""
    return connection == 0 and (request == "^A" or "J/ RHX$0" in request)


@pytest.mark.parametrize("delay", [0.0, 0.2])
@pytest.mark.slow
def test_one_request_a_packet_stops_the_table_fifty_times_in_fifty(delay: float):
    def trial() -> None:
        with StrictPmac(delay) as server, turning(server) as table:
            table.stop()
            assert rest_within(server, DECELERATION + 1.0)
            assert len(server.times("^A")) == 1
            assert all(axis.enabled for axis in table.read().axes)

    repeat(trial)


@pytest.mark.parametrize("delay", [0.0, 0.2])
def test_an_abort_that_is_not_answered_is_followed_by_j_slash_in_time(delay: float):
    def trial() -> None:
        with StrictPmac(delay, ignores_abort) as server, turning(server) as table:
            table.stop()
            assert rest_within(server, DECELERATION + 1.0)
            (aborted,) = server.times("^A")
            told = server.times("J/ RHX$0")
            assert len(told) == 3
            assert told[0] - aborted <= STOP_TIMEOUT + NEXT_LEVEL
            assert all(axis.settled for axis in table.read().axes)

    repeat(trial)


@dataclass
class WatchdogThread:
    """The watchdog's own code with its own connection, in a thread instead of a process."""

    pipe: int
    alive: bool = True
    axis_killed: bool = False

    def stop(self) -> bool:
        return os.write(self.pipe, b"s") == 1


@contextmanager
def watchdog(server: StrictPmac) -> Iterator[Any]:
    heard, pipe = os.pipe()
    signals, poke = os.pipe()
    said: list[str] = []
    motors = f"?motors=1,2,3&counts={COUNTS_PER_TURN}"
    guard = Watchdog(
        f"pmac://127.0.0.1:{server.port}{motors}", 60.0, 1.0, (heard, signals), said.append
    )
    thread = Thread(target=guard.run)
    thread.start()
    end = monotonic() + PATIENCE
    while "ready" not in said:
        assert monotonic() < end, said
        Event().wait(0.01)
    try:
        yield WatchdogThread(pipe)
    finally:
        os.write(pipe, b"q")
        thread.join()
        for descriptor in (heard, pipe, signals, poke):
            os.close(descriptor)


@pytest.mark.parametrize("delay", [0.0, 0.2])
@pytest.mark.slow
def test_where_the_controller_answers_no_stop_the_watchdog_stops_the_table(delay: float):
    def trial() -> None:
        alarms: list[str] = []
        with (
            StrictPmac(delay, ignores_stops) as server,
            turning(server) as table,
            watchdog(server) as guard,
        ):
            driver = TableDriver(table, guard, monotonic, lambda level, words: alarms.append(level))
            driver.read()
            driver.stop([StopCommand()])
            assert rest_within(server, DECELERATION + 1.0)
            failed = server.times("J/ RHX$0", 0)[-1] + STOP_TIMEOUT
            assert server.times("^A", 1)[0] - failed <= NEXT_LEVEL
        assert alarms == ["alarm"]

    repeat(trial)


@pytest.mark.slow
def test_an_answer_to_the_abort_that_is_late_is_not_taken_for_that_of_j_slash():
    # The controller reads J/ only after it has answered ^A: its first reply is no line.
    with StrictPmac(delay=0.4) as server, turning(server) as table:
        with pytest.raises(ProtocolError):
            table.stop()
        assert rest_within(server, DECELERATION + 2.0)
