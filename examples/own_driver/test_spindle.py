"""The driver of the spindle, against its simulator."""

import pytest
from spindle import Spindle
from spindle_simulator import SimulatedSpindle

from inercal.host.driver_check import check_driver
from inercal.host.drivers.rotary_table import TableFault
from inercal.host.sim.server import SimulatorServer, SteppingClock


def test_the_driver_passes_all_checks():
    """The checks are those of `inercal bench check-driver`."""
    with SimulatorServer(SimulatedSpindle(), SteppingClock()) as server:
        results = check_driver(f"spindle:{server.address}", now=lambda: server.device.time)
    assert [one for one in results if not one.passed] == []


def test_a_drive_with_a_fault_is_reported_and_not_enabled():
    """A drive whose amplifier has tripped."""
    with SimulatorServer(SimulatedSpindle()) as server, Spindle(server.address) as spindle:
        server.device.fault("amplifier 1")
        server.advance(1.0)
        assert spindle.read().axes[0].faults == ("drive fault",)
        with pytest.raises(TableFault):
            spindle.enable()
