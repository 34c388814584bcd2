"""What a table's driver does with one axis alone leaves the others as they are."""

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager
from math import radians
from typing import Any

import pytest
from tests.host.conftest import opened_by
from tests.refusals import refused

from inercal.host.drivers.acutrol import Acutrol, AcutrolAxis
from inercal.host.drivers.motor import Motor
from inercal.host.drivers.pmac import Pmac, PmacAxis
from inercal.host.drivers.rotary_table import AxisLimits, RotaryTable, TableFault
from inercal.host.sim.acutrol import SimulatedAcutrol
from inercal.host.sim.motor import SimulatedMotor
from inercal.host.sim.pmac import SimulatedPmac
from inercal.host.sim.server import SimulatorServer

NAMES = ("outer", "middle", "inner")
COUNTS = 3_600_000
Opened = tuple[SimulatorServer[Any], RotaryTable]


@contextmanager
def opened(device: Any, driver: Callable[[str], RotaryTable]) -> Iterator[Opened]:
    with ExitStack() as stack:
        server = stack.enter_context(SimulatorServer(device))
        yield server, stack.enter_context(driver(server.address))


def pmac() -> AbstractContextManager[Opened]:
    axes = [PmacAxis(name, i, COUNTS) for i, name in enumerate(NAMES, 1)]
    return opened(SimulatedPmac(), lambda address: Pmac(address, axes))


def acutrol() -> AbstractContextManager[Opened]:
    axes = [AcutrolAxis(name, i) for i, name in enumerate(NAMES, 1)]
    return opened(SimulatedAcutrol(), lambda address: Acutrol(address, axes, timeout=5.0))


def motor() -> AbstractContextManager[Opened]:
    limits = AxisLimits(radians(100), radians(100))
    return opened(SimulatedMotor(), lambda address: Motor(address, limits, timeout=5.0))


def enabled(table: RotaryTable) -> list[bool]:
    return [axis.enabled for axis in table.read().axes]


@pytest.mark.parametrize("make", [pmac, acutrol])
def test_a_servo_goes_on_and_off_by_axis(make: Callable[[], AbstractContextManager[Opened]]):
    with make() as (server, table):
        table.enable("middle")
        server.advance(0.5)
        assert enabled(table) == [False, True, False]
        table.enable("inner")
        table.spin("inner", radians(20), radians(50))
        server.advance(2.0)
        with pytest.raises(TableFault):
            table.kill("inner")
        table.kill("middle")  # though another axis turns
        assert enabled(table) == [False, False, True]
        assert table.read().axes[2].rate == pytest.approx(radians(20), rel=1e-2)


def test_one_axis_of_a_pmac_is_homed():
    with pmac() as (server, table):
        table.enable()
        table.home("middle")
        server.advance(60.0)
        assert [axis.homed for axis in table.read().axes] == [False, True, False]
        assert not table.unsupported


def test_the_axis_of_a_motor_is_homed_and_its_servo_stays_on_with_a_reason():
    with motor() as (server, table):
        table.home("table")
        server.advance(30.0)
        assert table.read().axes[0].homed
        with pytest.raises(TableFault) as refusal:
            table.kill("table")
        assert table.unsupported == {"servo": str(refusal.value)}


def test_encoders_of_an_acutrol_are_absolute_which_is_why_no_axis_is_homed():
    with acutrol() as (server, table):
        table.home("inner")
        server.advance(1.0)
        assert all(axis.homed for axis in table.read().axes)
        assert "absolute" in table.unsupported["home"]


@pytest.mark.parametrize("make", [pmac, acutrol, motor])
def test_an_axis_that_is_not_there_is_refused(
    make: Callable[[], AbstractContextManager[Opened]],
):
    with make() as (_, table):
        for act in (table.enable, table.home, table.kill):
            if act == table.home and "home" in table.unsupported:
                continue
            with refused(names=("yaw",)):
                act("yaw")


@pytest.mark.parametrize("counts", [COUNTS, -COUNTS])
def test_a_limit_switch_of_a_pmac_is_at_the_end_that_the_axis_has_there(counts: int, scripted: Any):
    feed = SimulatedPmac().session().feed
    positive = 1 << 21

    def answer(data: bytes) -> bytes:
        said = feed(data)
        lines = said.split(b"\r")
        for i, line in enumerate(lines):
            if len(line) == 12:
                lines[i] = f"{int(line, 16) | positive << 24:012X}".encode()
        return b"\r".join(lines)

    axes = [PmacAxis("inner", 3, counts)]
    with opened_by(lambda _: scripted(answer)), Pmac("tcp://x:1", axes) as table:
        state = table.read().axes[0]
    assert (state.at_low, state.at_high) == ((False, True) if counts > 0 else (True, False))
