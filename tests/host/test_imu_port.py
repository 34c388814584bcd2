"""The IMU's port: every byte once, in order, with its time, whatever the host does meanwhile."""

import os
import pty
import socket
import tty
from collections.abc import Iterator
from itertools import count
from threading import Event
from time import monotonic

import pytest
from tests.refusals import refused

from inercal.basics.errors import InputError
from inercal.host.imu_port import ImuPort
from inercal.host.link import LinkLost, open_link
from inercal.host.packets import read_layout

FIXED = read_layout("fixed")
PATIENCE = 20.0  # s


def _joined(pieces: list[tuple[float, bytes]]) -> bytes:
    return b"".join(data for _, data in pieces)


def _until(port: ImuPort, size: int) -> None:
    end = monotonic() + PATIENCE
    while port.received_bytes < size:
        assert monotonic() < end
        Event().wait(0.002)


@pytest.fixture
def far() -> Iterator[tuple[socket.socket, ImuPort]]:
    """Yield the IMU's end and the port; times are 0, 1, 2, and so on."""
    with socket.create_server(("127.0.0.1", 0)) as listener:
        link = open_link(f"tcp://127.0.0.1:{listener.getsockname()[1]}")
        end, _ = listener.accept()
        times = count()
        with end, ImuPort(link, FIXED, lambda: float(next(times))) as port:
            yield end, port


def test_what_came_is_handed_out_once_and_in_order(far: tuple[socket.socket, ImuPort]):
    end, port = far
    assert port.take() == []
    sent = b""
    for k in range(20):
        data = bytes([k]) * (1 + 100 * k)
        end.sendall(data)
        sent += data
        _until(port, len(sent))
    pieces = port.take()
    assert _joined(pieces) == sent
    times = [time for time, _ in pieces]
    assert times == sorted(times)
    assert port.received_bytes == len(sent)
    assert port.take() == []


def test_exactly_the_bytes_asked_for_are_handed_out(far: tuple[socket.socket, ImuPort]):
    end, port = far
    sent = bytes(range(256)) * 4
    end.sendall(sent)
    taken = b""
    for upto in (0, 1, 1, 7, 300, 1000):
        pieces = port.take(upto)
        taken += _joined(pieces)
        assert taken == sent[:upto]
        assert all(data for _, data in pieces)
    end.sendall(b"more")
    assert _joined(port.take(1028)) == sent[1000:] + b"more"
    assert port.take(5) == []  # long taken


def test_bytes_under_way_are_waited_for_and_missing_ones_told(far: tuple[socket.socket, ImuPort]):
    end, port = far
    end.sendall(b"abc")
    with refused(LinkLost, key="total_bytes", names=(port.address,)):
        port.take(5, timeout=0.05)
    end.sendall(b"de")
    assert _joined(port.take(5, PATIENCE)) == b"abcde"


@pytest.mark.parametrize("upto", [None, 100])
def test_a_link_that_ends_is_told_when_all_before_is_handed_out(
    far: tuple[socket.socket, ImuPort], upto: int | None
):
    end, port = far
    end.sendall(b"the last")
    end.close()
    _until(port, 8)
    assert _joined(port.take(upto, PATIENCE)) == b"the last"
    with pytest.raises(LinkLost):
        port.take(upto if upto else 9, PATIENCE)
    with pytest.raises(LinkLost):
        port.take()


def test_the_port_is_not_overrun_while_nobody_takes():
    device, host = pty.openpty()
    tty.setraw(host)
    with ImuPort(open_link(f"serial:{os.ttyname(host)}"), FIXED, monotonic) as port:
        sent = os.urandom(1 << 16)  # sixteen times what a terminal holds
        for k in range(0, len(sent), 512):
            assert os.write(device, sent[k : k + 512]) == 512
        assert _joined(port.take(len(sent), PATIENCE)) == sent
        os.close(device)
        os.close(host)
        with pytest.raises(LinkLost):
            port.take(len(sent) + 1, PATIENCE)


def test_what_waited_before_the_port_was_opened_is_thrown_away():
    device, host = pty.openpty()
    tty.setraw(host)
    link = open_link(f"serial:{os.ttyname(host)}")
    os.write(device, b"stale" * 100)
    with ImuPort(link, FIXED, monotonic) as port:
        assert port.discarded_bytes == 500
        os.write(device, b"fresh")
        assert _joined(port.take(5, PATIENCE)) == b"fresh"
    port.close()
    for end in (device, host):
        os.close(end)


def test_a_clock_that_is_lost_is_told():
    gone = InputError("the clock is gone")

    def lost() -> float:
        raise gone

    device, host = pty.openpty()
    tty.setraw(host)
    with ImuPort(open_link(f"serial:{os.ttyname(host)}"), FIXED, lost) as port:
        os.write(device, b"abc")
        with refused(LinkLost, names=(port.address,)) as refusal:
            port.take(3, PATIENCE)
        assert refusal.value.__cause__ is gone
    for end in (device, host):
        os.close(end)


@pytest.mark.parametrize(
    "error", [RuntimeError("the port is closed"), TypeError()], ids=["with words", "without"]
)
def test_whatever_the_reader_ends_by_is_told(error: Exception):
    def lost() -> float:
        raise error

    device, host = pty.openpty()
    tty.setraw(host)
    with ImuPort(open_link(f"serial:{os.ttyname(host)}"), FIXED, lost) as port:
        os.write(device, b"abc")
        with refused(LinkLost, names=(port.address,)) as refusal:
            port.take(3, PATIENCE)
        lost_link = refusal.value.__cause__
        assert isinstance(lost_link, LinkLost)
        assert lost_link.__cause__ is error
    for end in (device, host):
        os.close(end)
