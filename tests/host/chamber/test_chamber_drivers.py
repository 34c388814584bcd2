"""The drivers of chambers, each against a simulator that shares no code with it."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from math import isnan
from struct import pack, unpack
from typing import Any

import pytest
from tests.host.chamber.simulated_f4t import EVENT_1, MODE, SET_POINT, SimulatedF4t
from tests.refusals import refused

from inercal.host.drivers.rotary_table import ProtocolError
from inercal.host.equipment import Chamber, open_chamber
from inercal.host.link import LINKS, LinkLost
from inercal.host.sim.chamber import SimulatedScpiChamber
from inercal.host.sim.server import SimulatorServer

START = 298.15


def scpi() -> SimulatedScpiChamber:
    return SimulatedScpiChamber()


def celsius() -> SimulatedF4t:
    return SimulatedF4t(15)


def fahrenheit() -> SimulatedF4t:
    return SimulatedF4t(30)


@contextmanager
def opened(
    device: Any, parameters: str = "event=1&door=8", timeout: float = 5.0
) -> Iterator[tuple[SimulatorServer[Any], Chamber]]:
    with SimulatorServer(device) as server:
        if isinstance(device, SimulatedF4t):
            address = f"watlow-f4t://127.0.0.1:{server.port}?{parameters}"
        else:
            address = device.driver_address(server.address)
        with open_chamber(address, timeout) as chamber:
            yield server, chamber


every_driver = pytest.mark.parametrize("make", [scpi, celsius, fahrenheit])


@every_driver
def test_a_chamber_goes_to_its_set_point_and_ends_there(make: Callable[[], Any]):
    with opened(make()) as (server, chamber):
        assert chamber.read().temperature == pytest.approx(START, abs=1e-4)
        assert chamber.read().alarms == ()
        assert chamber.read().door_open is False
        for time, goal in ((3000.0, 343.15), (8000.0, 233.15)):
            chamber.set_temperature(goal)
            server.advance(time)
            assert chamber.read().temperature == pytest.approx(goal, abs=2e-3)
        chamber.stop()
        server.advance(20_000.0)
        assert chamber.read().temperature == pytest.approx(START, abs=2e-3)


@every_driver
def test_door_and_alarms_are_reported(make: Callable[[], Any]):
    device = make()
    with opened(device) as (server, chamber):
        device.fault("door")
        assert chamber.read().door_open is True
        device.fault("door off")
        device.fault("overtemperature")
        server.advance(3000.0)
        assert len(chamber.read().alarms) == 1
        device.fault("overtemperature off")
        assert chamber.read().alarms == ()
        device.fault("sensor")
        state = chamber.read()
        assert isnan(state.temperature)
        assert "sensor failure" in state.alarms


@every_driver
def test_an_unreachable_set_point_is_refused_before_anything_is_sent(make: Callable[[], Any]):
    device = make()
    with opened(device) as (_, chamber):
        device.fault("silent")  # a request would fail in another way
        for kelvin in (203.0, 423.3, 0.0, float("nan"), float("inf")):
            with refused(key="temperature"):
                chamber.set_temperature(kelvin)


@every_driver
def test_a_silent_chamber_is_an_error_and_can_be_used_afterwards(make: Callable[[], Any]):
    device = make()
    with opened(device, timeout=0.1) as (_, chamber):
        device.fault("silent")
        for act in (chamber.read, chamber.stop, lambda: chamber.set_temperature(300.0)):
            with pytest.raises((LinkLost, ProtocolError)):
                act()
        device.fault("silent off")
        assert chamber.read().temperature == pytest.approx(START, abs=1e-4)


def test_the_scpi_driver_asks_for_celsius_each_time():
    device = scpi()
    with opened(device) as (_, chamber):
        other = device.session()
        for act in (chamber.read, lambda: chamber.set_temperature(313.15)):
            other.feed(b":UNIT:TEMPERATURE F\n")
            act()
            assert other.feed(b":UNIT:TEMPERATURE?\n") == b"C\n"
        assert device.set_point == pytest.approx(313.15)


def test_the_scpi_commands_are_those_of_the_manual(scripted: Any):
    sent: list[bytes] = []

    def answer(data: bytes) -> bytes:
        sent.append(data)
        return scpi_device.session().feed(data)

    scpi_device = scpi()
    with (
        LINKS.with_("wire", lambda *_: scripted(answer)),
        open_chamber("scpi-chamber:wire:1?output=1&low=-40&high=130") as chamber,
    ):
        chamber.set_temperature(323.15)
        assert chamber.read().door_open is None
        chamber.stop()
    lines = b"".join(sent).decode().splitlines()
    assert list(dict.fromkeys(lines)) == [
        ":UNIT:TEMPERATURE C",
        ":UNIT:TEMPERATURE?",
        ":SOURCE:CLOOP1:SPOINT 50.000",
        ":OUTPUT1:STATE ON",
        ":OUTPUT1:STATE?",
        ":SOURCE:CLOOP1:ERROR?",
        ":SOURCE:CLOOP1:PVALUE?",
        ":OUTPUT1:STATE OFF",
    ]


@pytest.mark.parametrize("reply", [b"F\n", b"\n", b"Inbound SCPI ERROR: -113\n", b"C\nC\n"])
def test_an_unexpected_reply_is_a_protocol_error(reply: bytes, scripted: Any):
    with (
        LINKS.with_("wire", lambda *_: scripted(lambda _: reply)),
        refused(ProtocolError),
    ):
        open_chamber("scpi-chamber:wire:1?output=1&low=-40&high=130", 0.1)


@pytest.mark.parametrize(
    "address",
    [
        "scpi-chamber://h",
        "scpi-chamber://h?output=1&low=-40",
        "scpi-chamber://h?output=0&low=-40&high=130",
        "scpi-chamber://h?output=1&low=cold&high=130",
        "scpi-chamber://h?output=1&low=-40&high=inf",
        "scpi-chamber://h?output=1&low=-40&high=130&door=x",
        "scpi-chamber://h?output=1&low=-40&high=130&humidity=2",
        "scpi-chamber://h?output=1&low=-40&high=130&dialect=espec",
        "watlow-f4t://",
        "watlow-f4t://h?event=9",
        "watlow-f4t://h?alarms=15",
        "watlow-f4t:serial:/dev/ttyS0",
        "watlow-f4t://h?loop=2",
    ],
)
def test_a_malformed_address_is_refused(address: str):
    with refused():
        open_chamber(address, 0.1)


@pytest.mark.parametrize("scheme", ["scpi-chamber", "watlow-f4t"])
def test_a_chamber_that_is_not_there_is_a_lost_link(scheme: str):
    parameters = "?output=1&low=-40&high=130" if scheme == "scpi-chamber" else ""
    with SimulatorServer(scpi()) as server:
        port = server.port
    with refused(LinkLost):
        open_chamber(f"{scheme}://127.0.0.1:{port}{parameters}", 0.1)


def test_a_set_point_is_written_as_a_float_whose_first_register_is_the_low_word():
    device = celsius()
    with opened(device) as (_, chamber):
        chamber.set_temperature(-40.25 + 273.15)
        words = device.registers[SET_POINT + 1], device.registers[SET_POINT]
        assert unpack(">f", pack(">HH", *words))[0] == pytest.approx(-40.25)
        assert device.registers[SET_POINT + 1] == 0xC221  # sign and exponent of −40.25
        assert (device.registers[MODE], device.registers[EVENT_1]) == (10, 63)
        chamber.stop()
        assert (device.registers[MODE], device.registers[EVENT_1]) == (62, 62)


def test_the_limits_of_the_f4t_are_those_of_its_controller():
    device = fahrenheit()
    device.registers[2776], device.registers[2777] = 0, 0x4348  # 200 °F
    with opened(device) as (_, chamber):
        chamber.set_temperature(366.4)
        with refused(key="temperature"):
            chamber.set_temperature(366.6)


@pytest.mark.parametrize("unit", [0, 16])
def test_an_unknown_unit_is_a_protocol_error(unit: int):
    device = celsius()
    device.registers[6730] = unit
    with refused(ProtocolError), opened(device):
        pass


def test_an_alarm_that_the_f4t_does_not_have_is_a_protocol_error():
    with opened(celsius(), "alarms=7") as (_, chamber), refused(ProtocolError):
        chamber.read()


def test_without_event_and_door_only_the_loop_is_switched():
    device = celsius()
    with opened(device, "alarms=3") as (_, chamber):
        chamber.set_temperature(300.0)
        assert (device.registers[MODE], device.registers[EVENT_1]) == (10, 62)
        assert chamber.read().door_open is None
