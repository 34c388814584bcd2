"""What is connected, as `inercal bench devices` tells it."""

import socket
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from math import inf, radians
from threading import Event, Thread
from typing import Any

import numpy as np
import pytest
from tests.refusals import refused

from inercal.host import devices
from inercal.host.link import LinkLost
from inercal.host.packets import PRESETS, encode, read_layout
from inercal.host.sim.acutrol import SimulatedAcutrol
from inercal.host.sim.motor import SimulatedMotor
from inercal.host.sim.pmac import SimulatedPmac
from inercal.host.sim.server import SimulatorServer

RATE = 200.0


@contextmanager
def _sending(data: bytes, over: bool = True) -> Iterator[str]:
    """Send bytes to who connects, and close unless told otherwise."""
    done = Event()

    def send(listener: socket.socket) -> None:
        end, _ = listener.accept()
        with end:
            end.sendall(data)
            if not over:
                done.wait(20.0)

    with socket.create_server(("127.0.0.1", 0)) as listener:
        thread = Thread(target=send, args=(listener,))
        thread.start()
        yield f"tcp://127.0.0.1:{listener.getsockname()[1]}"
        done.set()
        thread.join()


def _packets(preset: str, lost: int = 0) -> bytes:
    n = 400
    rng = np.random.default_rng(3)
    readings = rng.normal(0, 1, (n, 6))
    kept = np.arange(n) != lost if lost else np.ones(n, np.bool_)
    return encode(
        read_layout(preset),
        readings[kept],
        counter=np.arange(n)[kept],
        time=np.arange(n)[kept] / RATE,
        temperature=np.full(n, 300.0)[kept],
    )


@pytest.mark.parametrize("preset", PRESETS)
def test_the_preset_that_reads_an_imu_is_found(preset: str):
    data = _packets(preset)
    with _sending(data[7:-3]) as address:
        found = devices.probe_imu(address, 20.0)
    assert found.size == len(data) - 10
    assert found.seconds < 20.0
    assert [sender.layout.name for sender in found.decodings] == [preset]
    (sender,) = found.decodings
    assert 398 <= sender.counts.packets <= 399
    assert sender.decoded_fraction > 0.98
    if preset not in ("fixed", "witmotion"):  # they tell no time
        assert sender.rate_hz == pytest.approx(RATE, rel=1e-6)


def test_lost_packets_are_told_and_change_no_rate():
    with _sending(_packets("vn100", lost=50)) as address:
        (sender,) = devices.probe_imu(f"{address}?preset=vn100", 20.0).decodings
    assert sender.rate_hz == pytest.approx(RATE, rel=1e-6)
    assert (sender.counts.packets, sender.counts.lost) == (399, 1)
    with _sending(_packets("xsens", lost=50)) as address:
        (sender,) = devices.probe_imu(f"{address}?preset=xsens", 20.0).decodings
    assert (sender.counts.packets, sender.counts.lost) == (399, 1)
    assert sender.rate_hz == pytest.approx(RATE, rel=1e-6)
    assert sender.layout.protection.startswith("sum of 8 bits")


def test_an_imu_that_goes_on_is_listened_to_for_so_long():
    with _sending(_packets("fixed"), over=False) as address:
        found = devices.probe_imu(address, 0.2)
    assert found.seconds == pytest.approx(0.2, abs=0.15)
    assert [sender.layout.name for sender in found.decodings] == ["fixed"]


@pytest.mark.parametrize("data", [b"", b"\x00" * 5000, bytes(range(256)) * 20])
def test_what_no_preset_reads_is_told_as_bytes_alone(data: bytes):
    with _sending(data) as address:
        found = devices.probe_imu(address, 20.0)
    assert (found.size, found.decodings) == (len(data), ())


def test_an_imu_that_is_not_there_is_a_lost_link():
    with refused(LinkLost, names=("serial:/dev/ttyNONE",)):
        devices.probe_imu("serial:/dev/ttyNONE")


def _at(scheme: str, server: SimulatorServer[Any], query: str) -> str:
    return f"{server.address.replace('tcp', scheme, 1)}?{query}"


def test_a_pmac_says_what_it_is_and_how_it_is_set(pmac: SimulatorServer[SimulatedPmac]):
    pmac.advance(5.0)
    found = devices.probe_table(_at("pmac", pmac, "motors=1,2,3&counts=3600000"))
    assert found.identity == "Turbo PMAC TURBO2, X4, firmware 1.947"
    assert found.axes == ("1", "2", "3")
    assert found.limits[2].rate == pytest.approx(radians(400))
    assert found.wrap_period == pytest.approx(7427.4, abs=0.1)
    assert found.state.time == pytest.approx(5.0, abs=1e-3)
    assert not any(axis.enabled for axis in found.state.axes)
    limit = replace(found.limits[0], following_error=radians(2.5))
    (_, line, *_) = devices.table_lines(replace(found, limits=(limit, *found.limits[1:])))
    assert line.endswith("following error 2.5 °")


def test_an_acutrol_and_a_motor_say_what_they_can():
    with SimulatorServer(SimulatedAcutrol()) as server:
        found = devices.probe_table(_at("acutrol", server, "axes=1,2"), timeout=5.0)
    assert found.identity == "inercal,simulated ACUTROL3000"
    assert found.wrap_period == inf
    with SimulatorServer(SimulatedMotor()) as server:
        found = devices.probe_table(f"motor:{server.address}", timeout=5.0)
    assert found.identity == ""
    assert found.limits[0].rate == inf
    (_, line) = devices.table_lines(found)
    assert line.endswith("no soft limits")


def test_ports_are_those_of_the_system(monkeypatch: pytest.MonkeyPatch):
    class Seen:
        device, description = "/dev/ttyUSB7", "FT232R"

    monkeypatch.setattr("serial.tools.list_ports.comports", lambda: [Seen()])
    assert devices.list_serial_ports() == (devices.SerialPort("serial:/dev/ttyUSB7", "FT232R"),)
