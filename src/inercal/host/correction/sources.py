"""Sources of bytes: standard input, a file, a serial port, and TCP and UDP addresses.

A live source does not wait for its reader, and it may be lost. A file and standard input wait, and
they end.
"""

import os
import socket
import stat
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple, Protocol
from urllib.parse import urlsplit

from inercal.basics.closeable import Closeable
from inercal.basics.errors import InputError
from inercal.host.addresses import link_of_address
from inercal.host.link import LinkLost, host_and_port, open_link

_MOST_BYTES = 1 << 17  # bytes at a time
_MOST_DATAGRAMS = 64  # at a time
_ATTEMPT = 1.0  # s; corrected samples wait during an attempt to open a source again
LOCAL = "127.0.0.1"  # where sockets listen unless another address is stated
_POSSIBLE = "-, a file, a serial port such as /dev/ttyUSB0, tcp://HOST:PORT or udp://HOST:PORT"


class OpenSource(Protocol):
    """An open source."""

    def fileno(self) -> int:
        """Return the descriptor that is readable when bytes have arrived."""
        ...

    def take(self, *, ready: bool = True) -> bytes | None:
        """Return the bytes that have arrived; None at the end. Raises `LinkLost`.

        A live source does not wait for bytes. `ready` tells whether `select` said that it has some.
        """
        ...

    def close(self) -> None:
        """Close the source."""
        ...


class Source(NamedTuple):
    """How to open a source.

    Parameters
    ----------
    address : str
    open : callable
        Function that opens the source, or raises an `InercalError`.
    live : bool
        Whether the source does not wait for its reader, and is opened again if it is lost.
    mid_stream : bool
        Whether its first byte may be in the middle of a line or packet.
    file : Path or None
        The file, if the source is a regular file.
    """

    address: str
    open: Callable[[], OpenSource]
    live: bool = False
    mid_stream: bool = False
    file: Path | None = None


def find_source(address: str) -> Source:
    """Return the source with this address.

    Parameters
    ----------
    address : str
        "-" for standard input, the path of a file or serial port, `serial:PATH?baud=…`,
        `tcp://HOST:PORT`, or `udp://HOST:PORT` for the datagrams that arrive at this port. `preset`
        and `layout` after `?` are ignored (`inercal.host.addresses.layout_of_address`).

    Raises
    ------
    InputError
        The address is malformed, or there is no such file or port.
    """
    link = link_of_address(address)
    kind = link.partition(":")[0].lower()
    if address == "-":
        return Source("standard input", lambda: _Descriptor(0, "standard input"))
    if kind == "udp":
        place = listening_place(link)
        return Source(link, lambda: _Datagrams(link, place, lines=link == address), live=True)
    if kind == "tcp":
        return Source(link, lambda: _LinkSource(link), live=True)
    path, _, query = link.removeprefix("serial:").partition("?")
    try:
        mode = os.stat(path).st_mode
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise InputError(
            f"{address}: cannot be opened: {reason}; possible: {_POSSIBLE}", key="--stream"
        ) from None
    if stat.S_ISCHR(mode):
        port = f"serial:{path}" + (f"?{query}" if query else "")
        return Source(port, lambda: _LinkSource(port), live=True, mid_stream=True)
    if stat.S_ISDIR(mode) or query or kind == "serial":
        what = "a folder" if stat.S_ISDIR(mode) else "not a serial port"
        raise InputError(f"{address}: {path} is {what}; possible: {_POSSIBLE}", key="--stream")
    file = Path(path) if stat.S_ISREG(mode) else None
    return Source(path, lambda: _Descriptor(_open_file(path), path), file=file)


def listening_place(address: str) -> tuple[str, int]:
    """Return host and port on which to listen, from `udp://:5000`; without host, 127.0.0.1.

    Raises
    ------
    InputError
        The address is malformed.
    """
    parts = urlsplit(address)
    local = parts._replace(netloc=LOCAL + parts.netloc) if parts.netloc[:1] == ":" else parts
    place = host_and_port(local)
    if place is None or parts.path not in ("", "/") or parts.query or parts.username:
        scheme = parts.scheme or "tcp"
        raise InputError(f"{address!r} is not an address; possible: {scheme}://{LOCAL}:5000")
    return place


def bound_socket(address: str, place: tuple[str, int], kind: socket.SocketKind) -> socket.socket:
    """Return a socket that is bound to a place and does not block.

    Raises
    ------
    InputError
        The address is not one of this machine, or another program uses it.
    """
    family = socket.AF_INET6 if ":" in place[0] else socket.AF_INET
    bound = socket.socket(family, kind)
    try:
        bound.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, kind == socket.SOCK_STREAM)
        bound.bind(place)
    except (OSError, UnicodeError, OverflowError) as error:
        bound.close()
        raise InputError(
            f"{address}: cannot listen: {getattr(error, 'strerror', None) or error}; state an "
            f"address of this machine, such as {LOCAL}, and a free port"
        ) from None
    bound.setblocking(False)
    return bound


def _open_file(path: str) -> int:
    try:
        return os.open(path, os.O_RDONLY)
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}", file=path) from None


class _Descriptor(Closeable):
    """A file, a pipe or standard input."""

    def __init__(self, descriptor: int, name: str):
        self._descriptor, self._name = descriptor, name

    def fileno(self) -> int:
        return self._descriptor

    def take(self, *, ready: bool = True) -> bytes | None:
        try:
            return os.read(self._descriptor, _MOST_BYTES) or None
        except OSError as error:
            raise InputError(f"{self._name}: cannot be read: {error.strerror}") from None

    def close(self) -> None:
        if self._descriptor > 2:
            os.close(self._descriptor)


class _LinkSource(Closeable):
    """A serial port or a TCP connection, read directly because it is read very often."""

    def __init__(self, address: str):
        self._link = open_link(address, _ATTEMPT)
        os.set_blocking(self._link.fileno(), False)

    def fileno(self) -> int:
        return self._link.fileno()

    def take(self, *, ready: bool = True) -> bytes | None:
        try:
            data = os.read(self._link.fileno(), _MOST_BYTES)
        except BlockingIOError:
            return b""
        except OSError as error:
            raise LinkLost(f"{self._link.address}: {error.strerror}") from None
        if not data and ready:  # an open terminal without bytes also reads nothing
            raise LinkLost(f"{self._link.address}: the other end has closed the connection")
        return data

    def close(self) -> None:
        self._link.close()


class _Datagrams(Closeable):
    """Datagrams that arrive at a port; each contains whole lines or packets."""

    def __init__(self, address: str, place: tuple[str, int], *, lines: bool):
        self._end = b"\n" if lines else b""  # which may be missing after the last line
        self._socket = bound_socket(address, place, socket.SOCK_DGRAM)

    def fileno(self) -> int:
        return self._socket.fileno()

    def take(self, *, ready: bool = True) -> bytes | None:
        found: list[bytes] = []
        with suppress(BlockingIOError, ConnectionError):
            while len(found) < _MOST_DATAGRAMS:
                data = self._socket.recv(1 << 16)
                found.append(data if data.endswith(self._end) else data + self._end)
        return b"".join(found)

    def close(self) -> None:
        self._socket.close()
