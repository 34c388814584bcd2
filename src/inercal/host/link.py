"""Byte links to devices, opened by address: `tcp://10.0.0.5:1025`, `serial:/dev/ttyS0?baud=9600`.

A link transfers bytes, and a codec interprets them. A serial port can be any device that pyserial
opens, including a pseudo-terminal. Modem lines (CTS, DSR) are not read, because a pseudo-terminal
has none (ENOTTY).
"""

import socket
import sys
from collections.abc import Callable
from contextlib import AbstractContextManager
from time import monotonic
from typing import Protocol, Self
from urllib.parse import SplitResult, parse_qsl, urlsplit

from inercal.basics.closeable import Closeable
from inercal.basics.errors import InercalError, InputError, require_extra
from inercal.basics.registry import Registry

# On systems with terminals, a terminal that is gone raises this error, which is not an OSError.
if sys.platform == "win32":
    _TERMINAL_ERRORS: tuple[type[Exception], ...] = ()
else:
    from termios import error as _terminal_error

    _TERMINAL_ERRORS: tuple[type[Exception], ...] = (_terminal_error,)

CONNECT_TIMEOUT = 5.0  # s; a table in a laboratory network answers within milliseconds
_PARITIES = {"none": "N", "even": "E", "odd": "O"}


class LinkLost(InercalError):
    """The other end does not answer or closed the link; `names` contains its address, if known."""

    @classmethod
    def at(cls, address: str, text: str) -> Self:
        """Return the error about the link at an address, which stands before the text."""
        return cls(f"{address}: {text}", names=(address,))


class DeviceConnection(Protocol):
    """A connection to a device, which is closed at the end of its `with` block."""

    def close(self) -> None:
        """Close the connection; a second call does nothing."""
        ...

    def __enter__(self) -> Self: ...

    def __exit__(self, *_: object) -> None: ...


class Link(DeviceConnection, Protocol):
    """A stream of bytes in both directions."""

    address: str

    def read(self, most: int, timeout: float) -> bytes:
        """Return at most `most` bytes that have arrived; b"" if none arrive within `timeout` s.

        Raises `LinkLost` at the end of the stream.
        """
        ...

    def write(self, data: bytes) -> None:
        """Send all bytes; raises `LinkLost` if the other end is gone."""
        ...


class TcpLink(Closeable):
    """A TCP connection without Nagle's delay, which would slow down small requests."""

    def __init__(self, host: str, port: int, connect_timeout: float = CONNECT_TIMEOUT):
        self.address = f"tcp://{host}:{port}"
        self._socket = connect_socket(self.address, (host, port), connect_timeout)

    def read(self, most: int, timeout: float) -> bytes:
        """See `Link.read`."""
        try:
            self._socket.settimeout(max(timeout, 0.0))
            data = self._socket.recv(most)
        except (TimeoutError, BlockingIOError):
            return b""
        except OSError as error:
            raise _lost_connection(self.address, error) from error
        if not data:
            raise LinkLost.at(
                self.address,
                "the device has closed the connection; check its power and that no other program "
                "uses it",
            )
        return data

    def write(self, data: bytes) -> None:
        """See `Link.write`."""
        try:
            self._socket.settimeout(CONNECT_TIMEOUT)
            self._socket.sendall(data)
        except OSError as error:
            raise _lost_connection(self.address, error) from error

    def fileno(self) -> int:
        """Return the descriptor, with which `select` waits for bytes."""
        return self._socket.fileno()

    def close(self) -> None:
        """See `Link.close`."""
        self._socket.close()


class SerialLink(Closeable):
    """A serial port opened by pyserial; `path` is the name of the port, and `baud` is in bit/s."""

    def __init__(
        self, path: str, baud: int = 115200, bits: int = 8, parity: str = "none", stop: int = 1
    ):
        with require_pyserial():
            import serial
        self.address = f"serial:{path}"
        self._broken = (OSError, serial.SerialException, *_TERMINAL_ERRORS)
        try:
            self._port = serial.Serial(path, baud, bits, _PARITIES[parity], stop, timeout=0)
        except (*self._broken, ValueError) as error:
            raise LinkLost.at(
                self.address,
                f"the port cannot be opened: {_reason(error)}; check its name, your rights, and "
                "that no other program uses it",
            ) from error

    def read(self, most: int, timeout: float) -> bytes:
        """See `Link.read`."""
        try:
            waiting = min(self._port.in_waiting, most)
            if not waiting:
                # Setting the timeout reconfigures the port, so it is only set if it changes.
                if self._port.timeout != timeout:
                    self._port.timeout = max(timeout, 0.0)
                waiting = 1
            return bytes(self._port.read(waiting))
        except self._broken as error:
            raise _lost_connection(self.address, error) from error

    def write(self, data: bytes) -> None:
        """See `Link.write`."""
        try:
            self._port.write(data)
        except self._broken as error:
            raise _lost_connection(self.address, error) from error

    def fileno(self) -> int:
        """Return the descriptor, with which `select` waits for bytes."""
        return self._port.fileno()

    def close(self) -> None:
        """See `Link.close`."""
        self._port.close()


def open_link(address: str, opening: float = CONNECT_TIMEOUT) -> Link:
    """Open the link to `address` and return it.

    Parameters
    ----------
    address : str
        `tcp://HOST:PORT`, or `serial:PATH` with `?baud=…&bits=5–8&parity=none|even|odd&stop=1|2`
        (default 115200, 8, none, 1), or an address whose scheme a package registers. The caller
        must first remove parameters that do not belong to
        the link.
    opening : float
        Longest time for a connection to each address of a TCP host, s.

    Raises
    ------
    InputError
        The address is malformed, or has a parameter that does not belong to a link.
    LinkLost
        No device answers, or the port cannot be opened.
    """
    return LINKS.for_address(address, _possible_links)(address, opening)


class ReopenedLink(Closeable):
    """A link that is opened when it is needed, and again after it was closed."""

    def __init__(self, address: str):
        self.address = address
        self._link: Link | None = None

    def _open(self) -> Link:
        """Return the link; if there is none, open it without sending anything."""
        if self._link is None:
            self._link = open_link(self.address)
        return self._link

    def close(self) -> None:
        """Close the link if it is open; the next request opens it again."""
        if self._link is not None:
            self._link.close()
            self._link = None


def open_tcp(address: str, opening: float) -> Link:
    """Open a TCP link; see `open_link`."""
    parts = urlsplit(address)
    _refuse_unknown_parameters(address, _parameters(parts), ())
    place = host_and_port(parts)
    if place is None or parts.path not in ("", "/"):
        raise InputError(f"{address!r} is not a TCP address; possible: tcp://192.168.0.5:1025")
    return TcpLink(*place, opening)


def open_serial(address: str, _: float) -> Link:
    """Open a serial port; see `open_link`."""
    parts = urlsplit(address)
    if not parts.path:
        raise InputError(f"{address!r} names no port; possible: {_possible_links()}")
    given = _parameters(parts)
    _refuse_unknown_parameters(address, given, ("baud", "bits", "parity", "stop"))
    parity = given.get("parity", "none")
    if parity not in _PARITIES:
        raise InputError(
            f"parity={parity!r} in {address!r}; possible: {', '.join(_PARITIES)}", key="parity"
        )
    baud = _integer_parameter(address, given, "baud", 115200, range(50, 4_000_001))
    bits = _integer_parameter(address, given, "bits", 8, range(5, 9))
    stop = _integer_parameter(address, given, "stop", 1, range(1, 3))
    return SerialLink(parts.path, baud, bits, parity, stop)


# Links by the scheme of their address. An entry is a function of the address and of the longest
# time for a connection, s; it raises the errors of `open_link`.
LINKS: Registry[Callable[[str, float], Link]] = Registry(
    "inercal.links",
    "link",
    {"tcp": "inercal.host.link:open_tcp", "serial": "inercal.host.link:open_serial"},
    Callable,
)


def read_until(link: Link, done: Callable[[bytes], bool], timeout: float, most: int = 4096) -> bool:
    """Pass received data to `done` until it returns True; after `timeout` s, return False.

    Data that arrived before the timeout are used, even if this process was suspended meanwhile.
    """
    end = monotonic() + timeout
    while True:
        left = max(end - monotonic(), 0.0)
        data = link.read(most, left)
        if data and done(data):
            return True
        if not left:
            return False


def host_and_port(parts: SplitResult, default: int | None = None) -> tuple[str, int] | None:
    """Return host and port of an address; None if one is missing or the port is invalid."""
    try:
        host, port = parts.hostname, parts.port or default
    except ValueError:
        return None
    return (host, port) if host and port else None


def connect_socket(address: str, place: tuple[str, int], opening: float) -> socket.socket:
    """Open a TCP connection without Nagle's delay, or raise a `LinkLost` that names `address`."""
    try:
        result = socket.create_connection(place, opening)
    except OSError as error:
        why = f"cannot connect: {_reason(error)}; check the address, the cable and the power"
        raise LinkLost.at(address, why) from error
    except UnicodeError as error:  # Python raises this for an invalid host name such as "a..b"
        why = f"cannot connect: {place[0]!r} is not a host name; correct the address"
        raise LinkLost.at(address, why) from error
    result.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    return result


def require_pyserial() -> AbstractContextManager[None]:
    """Return a context manager that raises an `InputError` if pyserial is not installed."""
    return require_extra("host", "serial ports need pyserial; install the extra", ("serial",))


def _possible_links() -> str:
    forms = {"tcp": "tcp://HOST:PORT", "serial": "serial:PATH?baud=115200"}
    return " or ".join(forms.get(name, f"{name}:…") for name in LINKS)


def _parameters(parts: SplitResult) -> dict[str, str]:
    return dict(parse_qsl(parts.query, keep_blank_values=True))


def _refuse_unknown_parameters(address: str, given: dict[str, str], known: tuple[str, ...]) -> None:
    for key in given:
        if key not in known:
            possible = f"possible: {', '.join(known)}" if known else "a TCP address takes none"
            raise InputError(f"unknown parameter {key!r} in {address!r}; {possible}", key=key)


def _integer_parameter(
    address: str, given: dict[str, str], key: str, otherwise: int, within: range
) -> int:
    text = given.get(key, str(otherwise))
    if not (text.isascii() and text.isdigit() and int(text) in within):
        raise InputError(
            f"{key}={text!r} in {address!r}; possible: {within.start} to {within.stop - 1}", key=key
        )
    return int(text)


def _lost_connection(address: str, error: Exception) -> LinkLost:
    why = f"the connection is lost: {_reason(error)}; check the cable and the power"
    return LinkLost.at(address, why)


def _reason(error: Exception) -> str:
    if isinstance(error, _TERMINAL_ERRORS):
        return str(error.args[-1])  # the text follows the error number
    return (isinstance(error, OSError) and error.strerror) or str(error) or type(error).__name__
