"""A table on an ACUTROL3000: the driver against the simulator, and the bytes of programs in use."""

from collections.abc import Iterator
from math import isnan, radians
from typing import Any

import pytest
from tests.host.conftest import opened_by
from tests.refusals import refused

from inercal.host.drivers.acutrol import Acutrol, AcutrolAxis
from inercal.host.drivers.rotary_table import ProtocolError, TableFault
from inercal.host.sim.acutrol import SimulatedAcutrol
from inercal.host.sim.server import SimulatorServer

Served = SimulatorServer[SimulatedAcutrol]

AXES = (AcutrolAxis("outer", 1), AcutrolAxis("middle", 2), AcutrolAxis("inner", 3))


@pytest.fixture
def server() -> Iterator[Served]:
    with SimulatorServer(SimulatedAcutrol()) as server:
        yield server


@pytest.fixture
def table(server: Served) -> Iterator[Acutrol]:
    with Acutrol(server.address, AXES, timeout=5.0) as table:
        table.enable()
        yield table


def test_the_simulator_answers_as_programs_in_use_expect():
    session = SimulatedAcutrol().session()
    assert session.feed(b":Interlock:Reset\r\n:mode:off 1\r\n:int:close 1\r\n") == b""
    assert session.feed(b":mode:rate 1\r\n:dem:rate 1,0\r\n:mode? 1\r\n") == b"Rate\n"
    position, rate, acceleration = session.feed(b":read:pos? 1;rate? 1;acc? 1\n").split(b";")
    assert float(position) == pytest.approx(22.918312)
    assert (float(rate), float(acceleration)) == (0.0, 0.0)
    assert session.feed(b":limit:rate pos,1,30\n:limit:rate? pos,1\n") == b"30.000000\n"
    assert session.feed(b"*stb?\n") == b"0\n"
    assert session.feed(b":no:such 1\n*stb?\n") == b"4\n"


def test_a_move_ends_in_position(server: Served, table: Acutrol):
    table.move("inner", radians(-120), radians(60), radians(100))
    server.advance(1.0)
    assert table.read().axes[2].moving
    server.advance(9.0)
    state = table.read()
    assert isnan(state.time)
    assert state.axes[2].settled
    assert state.axes[2].angle == pytest.approx(radians(-120), abs=radians(1e-3))


def test_a_demand_is_sent_before_its_mode_so_that_an_old_one_moves_nothing(scripted: Any):
    links: list[Any] = []

    def opener(_: str) -> Any:
        links.append(scripted(SimulatedAcutrol().session().feed))
        return links[-1]

    with opened_by(opener), Acutrol("tcp://x:1", AXES) as table:
        table.enable()
        table.move("inner", radians(30), radians(20), radians(10))
        table.spin("outer", radians(-5), radians(10))
    assert links[0].written[-2:] == [
        b":limit:rate pos,3,20.0000000;:limit:acc pos,3,10.0000000;"
        b":demand:position 3,30.0000000;:mode:position 3;*stb?\n",
        b":limit:acc rate,1,10.0000000;:demand:rate 1,-5.0000000;:mode:rate 1;*stb?\n",
    ]


def test_a_rate_is_kept_and_stopped(server: Served, table: Acutrol):
    table.spin("middle", radians(-30), radians(60))
    server.advance(3.0)
    assert table.read().axes[1].rate == pytest.approx(radians(-30), rel=1e-4)
    with pytest.raises(TableFault):
        table.kill()
    table.stop()
    server.advance(5.0)
    assert table.read().axes[1].settled
    table.kill()
    assert not table.read().axes[1].enabled


def test_a_killed_axis_and_an_interlock_fault_are_told(server: Served, table: Acutrol):
    table.kill()
    with pytest.raises(TableFault):
        table.spin("inner", 1.0, 1.0)
    server.device.fault("amplifier 3")
    with pytest.raises(TableFault):
        table.enable()
    assert table.read().axes[2].faults == ("interlock fault",)


def test_a_fault_of_one_axis_keeps_no_other_from_stopping(server: Served, table: Acutrol):
    table.spin("inner", radians(30), radians(60))
    server.advance(2.0)
    server.device.fault("amplifier 1")
    with pytest.raises(TableFault):
        table.stop()
    server.advance(4.0)
    assert table.read().axes[2].settled


def test_limits_come_from_the_controller(table: Acutrol):
    with refused(key="rate", names=("inner",)):
        table.spin("inner", radians(401), 1.0)


def test_a_reply_that_comes_too_late_is_never_the_next_one(server: Served):
    with Acutrol(server.address, AXES, timeout=0.3) as table:
        server.faults.delay = 1.0
        with pytest.raises(ProtocolError):
            table.read()
        server.faults.delay = 0.0
        table.enable()
        server.advance(2.0)
        assert table.read().axes[0].enabled


def test_replies_in_pieces_are_the_same(server: Served, table: Acutrol):
    server.faults.fragment = 1
    assert table.read().axes[0].angle == pytest.approx(0.4)


@pytest.mark.parametrize(("rate", "rests"), [(0.04, True), (-0.04, True), (0.06, False)])
def test_a_table_that_stands_is_at_rest_though_the_readout_of_its_rate_is_noisy(
    scripted: Any, rate: float, rests: bool
):
    def answer(line: bytes) -> bytes:
        if b"absolute" in line:
            return b"400,500,1e4,-1e9,1e9,0\n"
        return b"0\n" if b"stb" in line else f"30.0005;{rate};Closed\n".encode()

    with opened_by(lambda _: scripted(answer)), Acutrol("tcp://x:1", AXES[:1]) as table:
        table.stop()
        assert table.read().axes[0].settled == rests
        for goal, near in ((30.0, True), (30.002, False)):
            table.move("outer", radians(goal), 1.0, 1.0)
            assert table.read().axes[0].settled == (rests and near)


@pytest.mark.parametrize("reply", [b"1;2\n", b"a;0;Closed\n", b"1;0;Closed\n;", b"\xff;0;Open\n"])
def test_what_is_no_reading_is_refused(scripted: Any, reply: bytes):
    def answer(line: bytes) -> bytes:
        return b"1,1,1,-1,1,0\n" if b"limit" in line else reply

    with (
        opened_by(lambda _: scripted(answer)),
        Acutrol("tcp://x:1", AXES[:1], 0.01) as table,
        pytest.raises(ProtocolError),
    ):
        table.read()
