"""What becomes of an IMU's port in a run: lost, and opened again without the run's waiting."""

import socket
from inspect import signature
from itertools import pairwise
from time import monotonic
from typing import Any

import pytest

from inercal.host import imu_port
from inercal.host.addresses import open_imu
from inercal.host.clock import Tick
from inercal.host.guard import Guard
from inercal.host.imu_port import ImuPort, ImuReceiver
from inercal.host.link import LinkLost
from inercal.host.packets import read_layout

# s after which the watchdog stops the table
SILENCE: float = signature(Guard).parameters["silence"].default


def _tick(time: float) -> Tick:
    return Tick(time, None, time)


def test_a_port_is_opened_again_in_less_time_than_the_watchdog_waits(
    monkeypatch: pytest.MonkeyPatch, scripted: Any
):
    now, openings = [100.0], list[float]()
    monkeypatch.setattr(imu_port, "monotonic", lambda: now[0])

    def opener(opening: float) -> ImuPort:
        openings.append(opening)
        if len(openings) > 1:
            now[0] += opening  # nobody answers, and nobody refuses
            raise LinkLost("timed out")
        link = scripted(lambda data: b"")
        port = ImuPort(link, read_layout("fixed"), monotonic, synchronous=True)
        monkeypatch.setattr(link, "read", lost)
        return port

    def lost(most: int, timeout: float) -> bytes:
        raise LinkLost("lost: Connection reset by peer")

    heard = ImuReceiver(opener, _tick(0.0))
    assert heard.take(_tick(0.02)).pieces == []
    assert heard.trouble == "the IMU is gone: lost: Connection reset by peer"
    waited = list[float]()
    for k in range(200):
        before = now[0]
        heard.take(_tick(0.04 + 0.02 * k))
        waited.append(now[0] - before)
        now[0] += 0.02
    assert openings[0] == 5.0
    assert max(openings[1:]) <= SILENCE / 3
    assert sum(waited) > 0
    # Between two tries the run has its ticks.
    assert all(not two for one, two in pairwise(waited) if one)


def test_an_imu_on_tcp_is_waited_for_as_long_as_is_said(monkeypatch: pytest.MonkeyPatch):
    waited = list[float]()

    def nobody(address: tuple[str, int], timeout: float) -> socket.socket:
        waited.append(timeout)
        raise TimeoutError("timed out")

    monkeypatch.setattr(socket, "create_connection", nobody)
    address = "tcp://127.0.0.1:9?preset=fixed"
    for opening in ((), (0.5,)):
        with pytest.raises(LinkLost):
            open_imu(address, monotonic, *opening)
    assert waited == [5.0, 0.5]
