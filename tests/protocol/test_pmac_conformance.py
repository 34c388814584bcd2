"""Somebody else's client of the Turbo PMAC on our simulator: Diamond Light Source's dls-pmaclib."""

import warnings
from collections.abc import Iterator
from typing import Any

import pytest

from inercal.host.sim.pmac import SimulatedPmac
from inercal.host.sim.server import SimulatorServer

Served = SimulatorServer[SimulatedPmac]


@pytest.fixture
def server() -> Iterator[Served]:
    with SimulatorServer(SimulatedPmac(counts_per_turn=3_600_000)) as server:
        yield server


@pytest.fixture
def client(server: Served) -> Iterator[Any]:
    with warnings.catch_warnings():
        # It imports telnetlib, and paramiko what cryptography has outlived.
        warnings.simplefilter("ignore", DeprecationWarning)
        pytest.importorskip("telnetlib", reason="dls-pmaclib imports telnetlib, gone in 3.13")
        from dls_pmaclib.dls_pmacremote import PmacEthernetInterface
    client = PmacEthernetInterface(timeout=5.0)
    client.setConnectionParams("127.0.0.1", server.port)
    assert client.connect() is None
    yield client
    client.disconnect()


def _ask(client: Any, line: str) -> str:
    reply, good = client.sendCommand(line)
    assert good
    return reply


@pytest.mark.slow
def test_it_connects_and_knows_the_model(client: Any):
    assert client.getPmacModel() == "Geo Brick (3U Turbo PMAC2)"
    assert client.getNumberOfAxes() == 16


def test_it_reads_and_sets_i_variables(client: Any):
    assert client.getIVars(0, [20, 21, 22, 23]) == ["$78400", "$0", "$0", "$0"]
    client.setAxisSetupIVar(2, 22, 12.5)
    assert client.getAxisSetupIVars(2, [22, 24]) == ["12.5", "$120001"]
    assert _ask(client, "i20..23") == "$78400\r$0\r$0\r$0\r\x06"


def test_it_jogs_and_polls_until_the_motor_is_there(client: Any, server: Served):
    assert client.jogStop(1)[1] == "\x06"
    server.advance(0.1)
    client.jogTo(1, 36000)
    server.advance(0.2)
    # Desired velocity zero is bit 13 of the first word, in position bit 0 of the second.
    status = int(_ask(client, "#1?")[:12], 16)
    assert not status >> 37 & 1
    server.advance(20.0)
    status = int(_ask(client, "#1?")[:12], 16)
    assert status >> 37 & 1
    assert status & 1
    assert abs(float(_ask(client, "#1P").strip("\r\x06")) - 36000) < 1
    client.jogInc(1, "neg", 1000)
    server.advance(40.0)
    assert abs(float(_ask(client, "#1P").strip("\r\x06")) - 35000) < 2


def test_it_jogs_on_and_back_homes_and_stops(client: Any, server: Served):
    client.jogStop(3)
    server.advance(0.1)
    for way, sign in (("pos", 1), ("neg", -1)):
        client.jogContinous(3, way)
        server.advance(server.device.time + 8.0)
        assert float(_ask(client, "#3V").strip("\r\x06")) * sign > 0
    client.homeCommand(3)
    server.advance(server.device.time + 80.0)
    assert int(_ask(client, "#3?")[:12], 16) >> 10 & 1


def test_it_reads_a_reply_of_several_chunks(client: Any):
    assert _ask(client, "I10 " * 60) == "3713707\r" * 60 + "\x06"
    # Its longest line is 255 bytes: a range makes the reply longer than a chunk. It also takes a
    # chunk that ends in CR for the end; seven bytes before zeros make the first end in "0".
    assert _ask(client, "CID I5000..5999") == "603382\r" + "0\r" * 1000 + "\x06"


def test_it_is_told_of_errors(client: Any, server: Served):
    assert _ask(client, "nonsense") == "\x07ERR003\r"
    assert client.jogContinous(2, "pos")[1] == "\x07ERR012\r"
    assert _ask(client, "#9J+") == "\x07ERR013\r"
