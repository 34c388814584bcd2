"""What all tables share."""

from collections.abc import Callable
from math import inf, nan, radians
from typing import Any

import pytest
from tests.refusals import refused

from inercal.host.drivers.acutrol import Acutrol, AcutrolAxis
from inercal.host.drivers.motor import Motor
from inercal.host.drivers.pmac import Pmac, PmacAxis
from inercal.host.drivers.rotary_table import AxisLimits, AxisState, RotaryTable
from inercal.host.sim.acutrol import SimulatedAcutrol
from inercal.host.sim.motor import SimulatedMotor
from inercal.host.sim.pmac import SimulatedPmac
from inercal.host.sim.server import SimulatorServer


def _pmac(address: str) -> RotaryTable:
    return Pmac(address, [PmacAxis("table", 1, 3_600_000)], timeout=5.0)


def _acutrol(address: str) -> RotaryTable:
    return Acutrol(address, [AcutrolAxis("table", 1)], timeout=5.0)


def _motor(address: str) -> RotaryTable:
    return Motor(address, AxisLimits(rate=10.0, acceleration=10.0), timeout=5.0)


@pytest.mark.parametrize(
    ("simulated", "opened"),
    [(SimulatedPmac, _pmac), (SimulatedAcutrol, _acutrol), (SimulatedMotor, _motor)],
)
def test_every_driver_is_told_the_same_and_its_table_does_the_same(
    simulated: Callable[[], Any], opened: Callable[[str], RotaryTable]
):
    with SimulatorServer(simulated()) as server, opened(server.address) as table:
        assert table.axes == ("table",)
        table.enable()
        table.home()
        server.advance(60.0)
        table.move("table", radians(40), radians(20), radians(30))
        server.advance(65.0)
        state = table.read().axes[0]
        assert state.settled
        assert state.homed
        assert state.enabled
        assert state.angle == pytest.approx(radians(40), abs=radians(0.02))
        table.spin("table", radians(-15), radians(30))
        server.advance(70.0)
        assert table.read().axes[0].rate == pytest.approx(radians(-15), rel=0.01)
        table.stop()
        server.advance(75.0)
        assert table.read().axes[0].settled


@pytest.mark.parametrize(
    ("period", "reported", "continued"),
    [
        (10.0, [8.0, 9.5, 1.0, 9.0, 2.0], [8.0, 9.5, 11.0, 9.0, 12.0]),  # 9.0 has a wrong digit
        (10.0, [nan, 9.5, 0.5, nan, 1.0], [nan, 9.5, 10.5, nan, 11.0]),
        (10.0, [3.0, 2.0], [3.0, 2.0]),  # the controller has set its clock
        (inf, [8.0, 9.5, 1.0], [8.0, 9.5, 1.0]),
    ],
)
def test_the_time_continues_where_the_clock_wraps(
    period: float, reported: list[float], continued: list[float]
):
    with SimulatorServer(SimulatedMotor()) as server, _motor(server.address) as table:
        table.wrap_period = period
        assert [table.unwrapped_time(time) for time in reported] == pytest.approx(
            continued, nan_ok=True
        )


def test_a_move_is_over_only_in_position_and_with_no_rate_commanded():
    def state(in_position: bool, moving: bool) -> AxisState:
        return AxisState(0.0, 0.0, 0.0, in_position, moving, True, True)

    assert state(True, False).settled
    assert not state(True, True).settled
    assert not state(False, False).settled


@pytest.mark.parametrize(
    ("enabled", "moving", "faults", "words"),
    [
        (True, False, (), "holds"),
        (True, True, (), "turns"),
        (False, True, (), "off"),
        (False, False, ("amplifier fault", "not activated"), "amplifier fault, not activated"),
    ],
)
def test_an_axis_says_its_faults_before_what_it_does(
    enabled: bool, moving: bool, faults: tuple[str, ...], words: str
):
    assert AxisState(0.0, 0.0, 0.0, True, moving, enabled, True, faults).status_text == words


def test_limits_take_what_is_at_them_and_a_spin_to_rest():
    limits = AxisLimits(rate=1.0, acceleration=2.0, low=-1.0, high=1.0)
    limits.check("x", 1.0, 2.0, 1.0)
    limits.check("x", -1.0, 2.0)
    limits.check("x", 0.0, 2.0)
    AxisLimits().check("x", 1.0, 1.0, 1e9)
    with refused(key="rate", names=("x",)):
        limits.check("x", -1.01, 2.0)
    with refused(key="acceleration", names=("x",)):
        AxisLimits().check("x", 1.0, inf, 0.0)
