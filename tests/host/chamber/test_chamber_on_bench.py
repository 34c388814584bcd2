"""A chamber beside a simulated bench, and what `inercal bench devices` says about a chamber."""

import json
from pathlib import Path

import pytest
from tests.host.chamber.simulated_f4t import SimulatedF4t
from tests.refusals import refused
from typer.testing import CliRunner

from inercal.cli.app import app
from inercal.host import devices
from inercal.host.clock import SimulatedClock
from inercal.host.equipment import open_chamber
from inercal.host.sim.bench_simulator import BenchDevice, ClockServer, GrantedClock
from inercal.host.sim.chamber import SimulatedScpiChamber
from inercal.host.sim.server import SimulatorServer
from inercal.host.sim.simulated_errors import draw_errors
from inercal.runfile import read

MIMU = Path(__file__).parents[3] / "examples" / "turntable" / "mimu.toml"


@pytest.mark.slow
def test_the_chamber_of_a_simulated_bench_runs_on_the_time_that_the_host_grants():
    pace = GrantedClock(1e9)
    device = BenchDevice(draw_errors(read(MIMU), 1))
    server = SimulatorServer(device, pace)
    address = ClockServer(server, pace).address
    beside = SimulatorServer(device.chamber, pace, beside=server)
    with server, open_chamber(device.chamber.driver_address(beside.address), 20.0) as chamber:
        clock = SimulatedClock(address)
        chamber.set_temperature(313.15)
        for time in (50.0, 100.0):
            clock.begin(time)
            clock.end()
            assert chamber.read().temperature == pytest.approx(298.15 + 0.05 * time, abs=1e-3)
        with server.lock:
            device.fault("chamber door")
        assert chamber.read().door_open is True
        with refused(key="fault", names=("fire",)):
            device.fault("chamber fire")
        clock.close()


def test_a_chamber_is_queried_without_changing_it():
    device = SimulatedF4t(30)
    device.fault("door")
    device.fault("sensor")
    with SimulatorServer(device) as server:
        before = dict(device.registers)
        address = f"watlow-f4t://127.0.0.1:{server.port}?door=8"
        found = devices.probe_chamber(address, 5.0)
    assert found.door_open is True
    assert "sensor failure" in found.alarms
    assert {register: device.registers[register] for register in before} == before
    (line,) = devices.chamber_lines(address, found)
    assert line.startswith(address)


def test_bench_devices_shows_a_chamber():
    device = SimulatedScpiChamber()
    with SimulatorServer(device) as server:
        address = device.driver_address(server.address)
        shown = CliRunner().invoke(app, ["bench", "devices", "--chamber", address])
        data = CliRunner().invoke(app, ["bench", "devices", "--chamber", address, "--json"])
    assert shown.exit_code == data.exit_code == 0
    assert "25.00 °C" in shown.stdout
    assert json.loads(data.stdout)["chamber"]["state"] == {
        "temperature": pytest.approx(298.15),
        "door_open": False,
        "alarms": [],
    }
