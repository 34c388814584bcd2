"""A table whose replies do not come is stopped at once: no stop waits for an answer.

Times are the wall's: they are what the limit is about.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from math import radians
from threading import Event
from time import monotonic
from typing import NamedTuple

import pytest
from tests.host.conftest import opened_by
from tests.host.test_guard import AXES

from inercal.host.drivers import pmac_codec as codec
from inercal.host.drivers.pmac import Pmac
from inercal.host.drivers.pmac_dialogue import PmacDialogue
from inercal.host.guard import Guard
from inercal.host.link import LinkLost
from inercal.host.sim.pmac import SimulatedPmac
from inercal.host.sim.server import ScaledClock, SimulatorServer
from inercal.host.table_driver import READ_TIMEOUT, TableDriver

Served = SimulatorServer[SimulatedPmac]
LIMIT = 0.6  # s from the first reading that is missed to the stop at the controller
PATIENCE = 20.0


class Mute:
    """A link to a controller that takes everything and answers nothing."""

    def __init__(self) -> None:
        self.address, self.written = "tcp://x:1", list[bytes]()

    def read(self, most: int, timeout: float) -> bytes:
        return b""

    def write(self, data: bytes) -> None:
        self.written.append(data)

    def close(self) -> None: ...

    def __enter__(self) -> "Mute":
        return self

    def __exit__(self, *_: object) -> None: ...


def test_a_stop_is_the_first_thing_that_is_sent_on_a_new_connection(
    scripted: Callable[..., object],
):
    mute = Mute()
    links = [scripted(SimulatedPmac().session().feed), mute]
    with opened_by(lambda _: links.pop(0)):
        dialogue = PmacDialogue("tcp://x:1", 0.05)
        dialogue.drop()
        assert not dialogue.control("A")
        assert mute.written[0] == codec.control_request("A")
        with pytest.raises(
            LinkLost
        ):  # what is no stop waits until the controller is known to answer
            dialogue.ask("I10", 1)


def _late(seconds: float) -> Callable[[Served], None]:
    def late(server: Served) -> None:
        server.faults.delay = seconds

    return late


def _garbled(server: Served) -> None:
    server.faults.corrupt = 1


def _half_open(server: Served) -> None:
    """Forget the connections without closing them; new ones are served."""
    for line in list(server._connections):
        server.remove_reader(line.end)


FAULTS = {
    "0.3 s late": _late(0.3),
    "1 s late": _late(1.0),
    "3 s late": _late(3.0),
    "garbled": _garbled,
    "half open": _half_open,
    "silent": _late(1e6),
}


@contextmanager
def halts_of(server: Served) -> Iterator[list[float]]:
    """Yield the times at which the controller began to decelerate an axis, as they come."""
    table, times = server.device.table, list[float]()
    halt = table.halt

    def halted(i: int, abort: bool = False) -> None:
        times.append(monotonic())
        halt(i, abort)

    with server.lock:
        table.halt = halted
    yield times


class Turning(NamedTuple):
    """A table that turns, what drives and watches it, and what the journal is told."""

    server: Served
    driver: TableDriver
    guard: Guard
    said: list[str]


@contextmanager
def turning() -> Iterator[Turning]:
    """Yield a table that turns at 100 °/s."""
    said: list[str] = []
    with SimulatorServer(SimulatedPmac(), ScaledClock(1.0)) as server:
        address = server.address.replace("tcp://", "pmac://") + "?motors=1,2,3&counts=3600000"
        with Pmac(server.address, AXES, READ_TIMEOUT) as table, Guard(address) as guard:
            driver = TableDriver(table, guard, monotonic, lambda _, words: said.append(words))
            table.enable()
            table.spin("inner", radians(100), radians(200))
            while driver.read() is None or driver.at_rest:
                Event().wait(0.005)
            yield Turning(server, driver, guard, said)


def end_faults(server: Served) -> None:
    with server.lock:
        server.faults.delay, server.faults.corrupt = 0.0, 0


@pytest.mark.wall_time
@pytest.mark.parametrize("fault", FAULTS)
@pytest.mark.parametrize(
    "repeat", [0, *(pytest.param(k, marks=pytest.mark.evidence) for k in range(1, 20))]
)
def test_a_table_that_cannot_be_read_is_stopped_at_once(fault: str, repeat: int):
    with turning() as (server, driver, guard, said):
        with halts_of(server) as halts:
            with server.lock:
                FAULTS[fault](server)
            asked = monotonic()
            while driver.read() is not None:
                asked = monotonic()
            end = monotonic() + PATIENCE
            while not halts:
                assert monotonic() < end, said
                driver.read()
            print(f"{fault}: stopped {halts[0] - asked:.3f} s after the reading that failed")
            assert halts[0] - asked < LIMIT
        end_faults(server)
        lines: list[str] = []
        while "at rest" not in lines:
            assert monotonic() < end + PATIENCE, lines
            lines += guard.read_lines()
            Event().wait(0.01)
    assert any("could not be read" in words for words in said)


SEEN = "0.3 s late", "half open"  # by the watchdog, which waits longer and connects anew


@pytest.mark.wall_time
@pytest.mark.slow
@pytest.mark.parametrize(
    "fault", [pytest.param(one, marks=[pytest.mark.evidence] * (one not in SEEN)) for one in FAULTS]
)
def test_of_a_fault_that_lasts_rest_is_seen_or_it_is_said_that_it_was_not(
    fault: str, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr("inercal.host.table_driver._REST_TIMEOUT", 5.0)
    with turning() as (server, driver, _, said):
        with server.lock:
            FAULTS[fault](server)
        with suppress(LinkLost):
            while not any("could not be read" in words for words in said):
                driver.read()
        words = driver.release_to_guard()
        print(f"{fault}: {words or 'rest was seen'}")
        if fault in SEEN:
            assert words is None
        else:
            assert words is not None
            assert words.startswith("rest was not seen")
        with server.lock:
            assert max(abs(server.device.table.state.rate)) < radians(0.01)
        end_faults(server)
