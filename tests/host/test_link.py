"""Byte links: what they carry, how they end, which addresses they take."""

import os
import pty
import socket
import termios
import tty
from collections.abc import Iterator

import pytest
from tests.refusals import refused

from inercal.host.link import LinkLost, open_link


@pytest.fixture
def terminal() -> Iterator[tuple[int, str]]:
    device, host = pty.openpty()
    tty.setraw(host)
    yield device, os.ttyname(host)
    for end in (device, host):
        os.close(end)


@pytest.fixture
def listener() -> Iterator[socket.socket]:
    with socket.create_server(("127.0.0.1", 0)) as listener:
        yield listener


def _address(listener: socket.socket) -> str:
    return f"tcp://127.0.0.1:{listener.getsockname()[1]}"


def test_tcp_carries_bytes_both_ways_and_says_when_the_other_end_closes(listener: socket.socket):
    with open_link(_address(listener)) as link:
        other, _ = listener.accept()
        with other:
            link.write(b"\x00ask\xff")
            assert other.recv(10) == b"\x00ask\xff"
            assert link.read(10, 0.0) == b""
            other.sendall(b"answer")
            assert link.read(3, 1.0) == b"ans"
            assert link.read(10, 1.0) == b"wer"
        with pytest.raises(LinkLost):
            link.read(10, 1.0)


def test_nobody_there_is_one_line_with_the_address():
    with socket.create_server(("127.0.0.1", 0)) as taken:
        address = _address(taken)
    with pytest.raises(LinkLost):
        open_link(address)


@pytest.mark.parametrize("host", ["a..b", "h" * 70])
def test_a_name_that_no_host_can_have_is_one_line_with_the_address(host: str):
    with pytest.raises(LinkLost) as lost:
        open_link(f"tcp://{host}:1")
    assert host in str(lost.value)


def test_a_pseudo_terminal_is_a_serial_port(terminal: tuple[int, str]):
    device, path = terminal
    with open_link(f"serial:{path}?baud=9600") as link:
        assert link.read(10, 0.0) == b""
        link.write(b"PPO\r")
        assert os.read(device, 10) == b"PPO\r"
        os.write(device, b"12.5\r\n>")
        assert link.read(4, 1.0) + link.read(10, 1.0) == b"12.5\r\n>"


def test_an_unplugged_port_is_a_lost_link():
    device, host = pty.openpty()
    tty.setraw(host)
    with open_link(f"serial:{os.ttyname(host)}") as link:
        os.close(host)
        os.close(device)
        with pytest.raises(LinkLost):
            link.read(10, 1.0)


def test_what_a_terminal_says_that_is_gone_is_a_lost_link(
    terminal: tuple[int, str], monkeypatch: pytest.MonkeyPatch
):
    def gone(*_: object) -> None:
        raise termios.error(5, "Input/output error")

    with open_link(f"serial:{terminal[1]}") as link:
        # Between two looks at a port, setting its time out is what finds that it is gone.
        monkeypatch.setattr(termios, "tcsetattr", gone)
        monkeypatch.setattr(termios, "tcgetattr", gone)
        monkeypatch.setattr("serial.Serial.write", gone)
        monkeypatch.setattr("serial.Serial.read", gone)
        with pytest.raises(LinkLost):
            link.read(10, 0.0)
        with pytest.raises(LinkLost):
            link.write(b"PPO")


def test_a_port_that_is_not_there_is_a_lost_link():
    with pytest.raises(LinkLost):
        open_link("serial:/dev/ttyNONE")


@pytest.mark.parametrize(
    ("address", "key"),
    [
        ("udp://host:1", None),
        ("host:1025", None),
        ("tcp://host", None),
        ("tcp://host:99999", None),
        ("tcp://host:1025?baud=9600", "baud"),
        ("serial:", None),
        ("serial:/dev/null?speed=1", "speed"),
        ("serial:/dev/null?baud=fast", "baud"),
        ("serial:/dev/null?bits=9", "bits"),
        ("serial:/dev/null?parity=mark", "parity"),
    ],
)
def test_a_bad_address_is_refused_with_the_parameter(address: str, key: str | None):
    with refused(key=key):
        open_link(address)
