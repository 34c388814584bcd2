"""A table on a Turbo PMAC: the driver against the simulator, in SI."""

from math import inf, nan, radians, tau
from typing import Any

import numpy as np
import pytest
from tests.host.conftest import opened_by
from tests.refusals import refused

from inercal.host.drivers.pmac import Pmac, PmacAxis
from inercal.host.drivers.pmac_codec import CommandRefused
from inercal.host.drivers.pmac_dialogue import PmacDialogue
from inercal.host.drivers.rotary_table import ProtocolError, TableFault
from inercal.host.link import Link, LinkLost, open_link
from inercal.host.sim.pmac import SimulatedPmac
from inercal.host.sim.server import SimulatorServer

Served = SimulatorServer[SimulatedPmac]

COUNTS = 3_600_000
COUNT = tau / COUNTS
INNER = (PmacAxis("inner", 3, COUNTS),)


def _tell(server: Served, line: str) -> None:
    with PmacDialogue(server.address) as dialogue:
        dialogue.ask(line)


def test_a_move_keeps_its_limits_and_ends_in_position(pmac: Served, table: Pmac):
    table.move("inner", radians(90), radians(30), radians(20))
    motion = pmac.device.table.advance(1.0)
    pmac.advance(1.0)
    assert table.read().axes[2].moving
    rest = pmac.device.table.advance(10.0)
    pmac.advance(10.0)
    state = table.read().axes[2]
    assert state.settled
    assert state.angle == pytest.approx(radians(90), abs=2 * COUNT)
    _, rate, turning = np.concatenate([motion, rest])[:, 2].T
    # The servo overshoots a little; the profile itself keeps the limits (test_dynamics).
    assert np.max(np.abs(rate)) == pytest.approx(radians(30), rel=0.02)
    assert np.max(np.abs(turning)) <= 1.3 * radians(20)


def test_a_rate_is_reached_kept_and_read_back(pmac: Served, table: Pmac):
    table.spin("outer", radians(-100), radians(50))
    pmac.advance(5.0)
    state = table.read().axes[0]
    # The controller rounds to 0.1 counts a cycle: 226 counts/s.
    assert state.rate == pytest.approx(radians(-100), abs=0.06 * COUNT / table.period)
    assert state.moving
    assert not state.settled
    assert state.following_error == pytest.approx(0.0, abs=radians(0.2))
    table.spin("outer", 0.0, radians(50))
    pmac.advance(9.0)
    assert table.read().axes[0].settled


def test_time_is_the_servo_clock_of_the_same_cycle_as_the_angle(pmac: Served, table: Pmac):
    table.spin("inner", radians(30), radians(200))
    pmac.advance(2.0)
    first = table.read()
    pmac.advance(3.0)
    second = table.read()
    assert (first.span, second.span) == (0.0, 0.0)
    rate = (second.axes[2].angle - first.axes[2].angle) / (second.time - first.time)
    assert rate == pytest.approx(radians(30), rel=1e-6)
    assert second.time == pytest.approx(3.0, abs=table.period)


def test_time_is_the_controllers_own_whoever_connects_and_when(pmac: Served, table: Pmac):
    pmac.advance(100.0)
    with Pmac(pmac.address, INNER) as other:
        assert other.read().time == table.read().time == pytest.approx(100.0, abs=table.period)
        assert other.wrap_period == (1 << 24) * other.period


def test_a_motor_that_refuses_to_stop_keeps_no_other_from_stopping(scripted: Any):
    simulated = SimulatedPmac()
    feed = simulated.session().feed

    def answer(data: bytes) -> bytes:
        if data.startswith(bytes.fromhex("C0 C4")):  # ^A is not understood
            return b"\x06@"
        return b"\x07ERR012\r" if b"#1J/" in data and b"I119=I115" in data else feed(data)

    axes = (PmacAxis("outer", 1, COUNTS), PmacAxis("inner", 3, COUNTS))
    with opened_by(lambda _: scripted(answer)), Pmac("tcp://x:1", axes) as table:
        table.enable()
        table.spin("outer", 0.2, 1.0)
        table.spin("inner", 1.0, 1.0)
        simulated.advance(2.0)
        with pytest.raises(CommandRefused) as refusal:
            table.stop()
        assert refusal.value.code == 12
        simulated.advance(4.0)
        assert [axis.settled for axis in table.read().axes] == [False, True]


def test_the_servo_clock_goes_on_where_its_24_bits_wrap(pmac: Served, table: Pmac):
    simulated = pmac.device
    simulated.table.cycle = (1 << 24) - 3
    with Pmac(pmac.address, INNER) as other:
        before = other.read().time
        pmac.advance((simulated.table.cycle + 10) * other.period)
        assert other.read().time - before == pytest.approx(10 * other.period, rel=1e-9)


def test_a_reading_over_several_cycles_says_so(scripted: Any):
    feed = SimulatedPmac().session().feed

    def answer(data: bytes) -> bytes:
        reply = feed(data)
        return b"FFFFFE" + reply[1:-3] + b"2\r\x06" if b"RHX$0 #" in data else reply

    with opened_by(lambda _: scripted(answer)), Pmac("tcp://x:1", INNER) as table:
        state = table.read()
    assert state.span == pytest.approx(4 * table.period)
    # From two cycles before the wrap to two behind it.
    assert state.time == pytest.approx(table.wrap_period, rel=1e-12)


@pytest.mark.parametrize("told", ["0F4240 1F4240", "1F4240 0F4240", "F423F F423F", "F4230 F4240"])
def test_a_wrong_digit_of_the_servo_clock_is_no_reading_and_shifts_no_time(
    scripted: Any, told: str
):
    simulated = SimulatedPmac()
    feed = simulated.session().feed
    simulated.table.cycle = 0xF4240
    wrong: list[str] = []

    def answer(data: bytes) -> bytes:
        reply = feed(data)
        if wrong and b"RHX$0 #" in data:
            first, last = wrong.pop().encode().split()
            return b"\r".join([first, *reply.split(b"\r")[1:-2], last, b"\x06"])
        return reply

    with opened_by(lambda _: scripted(answer)), Pmac("tcp://x:1", INNER) as table:
        before = table.read().time
        wrong.append(told)
        with pytest.raises(ProtocolError):
            table.read()
        assert table.read().time == before
        simulated.table.cycle += 10
        assert table.read().time - before == pytest.approx(10 * table.period)


@pytest.mark.parametrize("stood", [0xC00000, 0x300000])
def test_a_controller_that_was_powered_anew_is_read_on_and_its_time_does_not_go_back(
    pmac: Served, table: Pmac, stood: int
):
    pmac.device.table.cycle = stood
    before = table.read().time
    pmac.drop()
    pmac.device.table.cycle = 2000
    with pytest.raises(LinkLost):
        table.read()
    after = table.read().time
    assert after > before
    pmac.device.table.cycle += 1000
    assert table.read().time - after == pytest.approx(1000 * table.period)


def test_a_motor_that_has_not_yet_started_is_not_taken_for_one_that_has_arrived(scripted: Any):
    simulated = SimulatedPmac()
    feed = simulated.session().feed

    def idle(data: bytes) -> bytes:
        return feed(data.replace(b"#3J+", b"    "))

    with opened_by(lambda _: scripted(idle)), Pmac("tcp://x:1", INNER) as table:
        table.enable()
        assert table.read().axes[0].settled
        table.spin("inner", 1.0, 1.0)
        assert not simulated.table.is_moving(2)
        simulated.advance(0.015)
        assert not table.read().axes[0].settled
        simulated.advance(0.03)
        assert table.read().axes[0].settled


def test_limits_are_read_from_the_controller_in_si(pmac: Served):
    _tell(pmac, "I311=$3E80 I313=1800000 I314=-900000 I316=1000 I317=0.5")
    with Pmac(pmac.address, INNER) as table:
        limits = table.limits[0]
        assert limits.high == pytest.approx(tau / 2)
        assert limits.low == pytest.approx(-tau / 4)
        assert limits.rate == pytest.approx(1e6 * COUNT)
        assert limits.acceleration == pytest.approx(5e5 * COUNT)
        assert limits.following_error == pytest.approx(1000 * COUNT)
        table.enable()
        with refused(key="angle", names=("inner",)):
            table.move("inner", radians(181), 0.1, 0.1)


def test_an_axis_counted_backwards_turns_its_soft_limits_round(pmac: Served):
    _tell(pmac, "I313=1800000 I314=-900000")
    with Pmac(pmac.address, [PmacAxis("inner", 3, -COUNTS)]) as table:
        assert (table.limits[0].low, table.limits[0].high) == pytest.approx((-tau / 2, tau / 4))
        table.enable()
        table.move("inner", -1.0, 1.0, 1.0)
        pmac.advance(9.0)
        assert table.read().axes[0].angle == pytest.approx(-1.0, abs=2 * COUNT)
        simulated = pmac.device
        assert simulated.table.reading(2) == pytest.approx(1.0, abs=2 * COUNT)


@pytest.mark.parametrize(
    ("angle", "rate", "acceleration", "key"),
    [
        (0.1, 0.0, 1.0, "rate"),
        (0.1, 1.0, 0.0, "acceleration"),
        (0.1, 100.0, 1.0, "rate"),
        (nan, 1.0, 1.0, "angle"),
        (0.1, nan, 1.0, "rate"),
        (0.1, 1.0, inf, "acceleration"),
    ],
)
def test_a_motion_that_is_not_possible_is_refused_by_what_makes_it_so(
    table: Pmac, angle: float, rate: float, acceleration: float, key: str
):
    with refused(key=key, names=("inner",)):
        table.move("inner", angle, rate, acceleration)


def test_an_axis_that_is_not_there_is_refused_with_those_that_are(table: Pmac):
    with refused(names=("yaw",)):
        table.spin("yaw", 1.0, 1.0)


def test_homing_finds_the_index_and_makes_it_zero(pmac: Served, table: Pmac):
    table.home()
    assert not any(axis.homed for axis in table.read().axes)
    pmac.advance(60.0)
    for axis in table.read().axes:
        assert axis.homed
        assert axis.settled
        assert axis.angle == pytest.approx(0.0, abs=2 * COUNT)
    simulated = pmac.device
    np.testing.assert_allclose(np.remainder(simulated.table.state.angle + 1, tau) - 1, 0, atol=1e-5)


def test_stop_decelerates_at_ixx15_and_holds(pmac: Served, table: Pmac):
    table.spin("middle", radians(100), radians(200))
    pmac.advance(2.0)
    table.stop()
    pmac.advance(2.0 + 100 / 200 + 0.3)  # I215 is 2 counts/ms²: 200 °/s².
    state = table.read().axes[1]
    assert state.settled
    assert state.enabled


def test_stop_is_heard_though_the_connection_was_lost_meanwhile(pmac: Served, table: Pmac):
    table.spin("middle", radians(100), radians(200))
    pmac.advance(2.0)
    pmac.drop()
    table.stop()
    pmac.advance(3.0)
    assert table.read().axes[1].settled


def test_stop_works_where_control_a_is_not_understood(pmac: Served, scripted: Any):
    simulated = SimulatedPmac()
    feed = simulated.session().feed

    def deaf(data: bytes) -> bytes:
        return feed(data.replace(bytes.fromhex("C0 C4 01 00"), bytes.fromhex("C0 C4 00 00")))

    with opened_by(lambda _: scripted(deaf)), Pmac("tcp://x:1", INNER) as table:
        table.enable()
        table.spin("inner", 1.0, 0.5)
        simulated.advance(5.0)
        table.stop()
        simulated.advance(6.0)
        assert table.read().axes[0].settled


def test_kill_is_refused_while_an_axis_turns(pmac: Served, table: Pmac):
    table.spin("outer", 1.0, 1.0)
    pmac.advance(1.0)
    with refused(TableFault, names=("outer",)):
        table.kill()
    assert table.read().axes[0].enabled
    table.kill(coasting=True)
    assert not table.read().axes[0].enabled
    assert table.read().axes[0].rate > 0


def test_a_killed_motor_that_is_jogged_is_refused_in_words(table: Pmac):
    table.kill()
    with pytest.raises(CommandRefused) as refusal:
        table.move("inner", 1.0, 1.0, 1.0)
    assert refusal.value.code == 12


def test_a_soft_limit_stops_the_axis_and_is_told(pmac: Served, table: Pmac):
    _tell(pmac, "I313=360000")
    # Read when the table was opened, the limits do not know: the controller does.
    table.spin("inner", radians(20), radians(100))
    pmac.advance(6.0)
    state = table.read().axes[2]
    assert state.faults == ("stopped at a position limit",)
    assert not state.moving
    assert radians(36) <= state.angle <= radians(38)


def test_an_amplifier_fault_takes_the_axis_off_and_is_told(pmac: Served, table: Pmac):
    table.spin("inner", 1.0, 1.0)
    pmac.advance(2.0)
    pmac.device.fault("amplifier 3")
    pmac.advance(2.1)
    state = table.read().axes[2]
    assert "amplifier fault" in state.faults
    assert not state.enabled
    table.enable()
    pmac.advance(2.2)
    assert not table.read().axes[2].enabled
    pmac.device.fault("amplifier 3 off")
    table.enable()
    pmac.advance(2.3)
    assert table.read().axes[2].enabled


@pytest.mark.parametrize("fault", ["jammed", "frozen"])
def test_an_axis_that_does_not_follow_trips(pmac: Served, table: Pmac, fault: str):
    pmac.device.fault(f"{fault} 2")
    table.spin("middle", radians(20), radians(100))
    pmac.advance(3.0)
    state = table.read().axes[1]
    assert "fatal following error" in state.faults
    assert not state.enabled


def test_motors_that_are_off_or_skip_cycles_are_refused(pmac: Served):
    _tell(pmac, "I360=2")
    with refused(names=("inner",)):
        Pmac(pmac.address, INNER)
    with refused(names=("fourth",)):
        Pmac(pmac.address, [PmacAxis("fourth", 7, COUNTS)])


def test_readings_survive_replies_in_pieces_and_a_dropped_connection(pmac: Served):
    links: list[Link] = []

    def opener(address: str) -> Link:
        links.append(open_link(address))
        return links[-1]

    with opened_by(opener), Pmac(pmac.address, INNER, 5.0) as table:
        table.enable()
        pmac.faults.fragment = 1
        table.move("inner", 0.5, 1.0, 1.0)
        pmac.advance(3.0)
        assert table.read().axes[0].angle == pytest.approx(0.5, abs=2 * COUNT)
        pmac.drop()
        with pytest.raises(LinkLost):
            table.read()
        assert table.read().axes[0].angle == pytest.approx(0.5, abs=2 * COUNT)
    assert len(links) == 2
