"""A rate table turned by a motor's own controller: the driver against the simulator."""

from collections.abc import Iterator
from math import radians, tau
from typing import Any

import pytest
from tests.host.conftest import opened_by
from tests.refusals import refused

from inercal.host.drivers.motor import Motor
from inercal.host.drivers.rotary_table import AxisLimits, ProtocolError, TableFault
from inercal.host.sim.motor import SimulatedMotor
from inercal.host.sim.server import SimulatorServer

Served = SimulatorServer[SimulatedMotor]

LIMITS = AxisLimits(rate=radians(600), acceleration=radians(100))


@pytest.fixture(params=[False, True], ids=["tcp", "terminal"])
def server(request: pytest.FixtureRequest) -> Iterator[Served]:
    with SimulatorServer(SimulatedMotor(), terminal=request.param) as server:
        yield server


@pytest.fixture
def motor(server: Served) -> Iterator[Motor]:
    with Motor(server.address, LIMITS, timeout=5.0) as motor:
        yield motor


def test_lines_end_with_cr_and_replies_with_a_prompt():
    session = SimulatedMotor().session()
    assert session.feed(b"PPO\r") == b"0.0000\r\n>"
    assert session.feed(b"ACL 50\rJOG 36") == b"\r\n>"
    assert session.feed(b"0\r") == b"\r\n>"
    assert session.feed(b"JUMP\r") == b"? command\r\n>"


def test_the_rates_of_the_ship_rig_are_kept(server: Served, motor: Motor):
    motor.enable()
    for number, per_minute in enumerate((20, 46, 86), 1):
        motor.spin("table", per_minute / 60 * tau, radians(100))
        server.advance(10.0 * number)
        assert motor.read().axes[0].rate == pytest.approx(per_minute / 60 * tau, rel=1e-4)
    motor.stop()
    server.advance(40.0)
    assert motor.read().axes[0].settled


def test_homing_and_a_move_end_in_position(server: Served, motor: Motor):
    assert not motor.read().axes[0].homed
    motor.home()
    server.advance(30.0)
    assert motor.read().axes[0].homed
    motor.move("table", radians(45), radians(20), radians(20))
    server.advance(40.0)
    state = motor.read().axes[0]
    assert state.settled
    assert state.angle == pytest.approx(radians(45), abs=radians(0.01))


def test_what_it_cannot_do_is_refused_in_words(server: Served, motor: Motor):
    with refused(key="rate", names=("table",)):
        motor.spin("table", radians(700), 1.0)
    with pytest.raises(TableFault):
        motor.kill()
    server.device.fault("amplifier 1")
    server.advance(1.0)
    with pytest.raises(TableFault):
        motor.spin("table", 1.0, 1.0)


def test_a_late_reply_is_read_away_before_the_next_question(server: Served):
    with Motor(server.address, LIMITS, timeout=0.3) as motor:
        server.faults.delay = 1.0
        with pytest.raises(ProtocolError):
            motor.read()
        server.faults.delay = 0.0
        assert motor.read().axes[0].rate == 0.0


def test_what_is_no_number_is_refused(scripted: Any):
    with (
        opened_by(lambda _: scripted(lambda _: b"12,5\r\n>")),
        Motor("tcp://x:1", LIMITS) as motor,
        pytest.raises(ProtocolError),
    ):
        motor.read()


def test_stop_is_sent_though_bytes_came_unasked(scripted: Any):
    links: list[Any] = []

    def opener(_: str) -> Any:
        links.append(scripted(SimulatedMotor().session().feed))
        return links[-1]

    with opened_by(opener), Motor("tcp://x:1", LIMITS) as motor:
        links[0]._waiting = b"0.0000\r\n>"  # another program asked
        motor.stop()
        assert [link.written for link in links] == [[b"STO\r"], [b"STO\r"]]
        links[1]._waiting = b"0.0000\r\n>"
        with pytest.raises(ProtocolError):
            motor.read()
