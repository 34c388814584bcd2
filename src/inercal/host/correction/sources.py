"""Read bytes from standard input, a file, a serial port, or a TCP or UDP address.

A live source does not wait for its reader, and its connection may be lost. A file or standard input
waits until it is read, and it has an end.
"""

import os
import socket
import stat
from contextlib import suppress
from functools import partial
from pathlib import Path
from urllib.parse import urlsplit

from inercal.basics.closeable import Closeable
from inercal.basics.errors import InputError
from inercal.host.addresses import link_of_address
from inercal.host.link import LinkLost, SerialLink, TcpLink, host_and_port, open_link

LOCAL = "127.0.0.1"  # where sockets listen unless another address is stated
_MOST_BYTES = 1 << 17  # bytes at a time
_MOST_DATAGRAMS = 64  # at a time
_ATTEMPT = 1.0  # s; corrected samples wait during an attempt to open a source again
_POSSIBLE = "-, a file, a serial port such as /dev/ttyUSB0, tcp://HOST:PORT or udp://HOST:PORT"


class Source(Closeable):
    """A source of bytes, which is opened by `open`, and again if it is lost.

    Parameters
    ----------
    address : str
        "-" for standard input, the path of a file or serial port, `serial:PATH?baud=…`,
        `tcp://HOST:PORT`, or `udp://HOST:PORT` for the datagrams that arrive at this port. `preset`
        and `layout` after `?` are ignored (`inercal.host.addresses.layout_of_address`).

    Attributes
    ----------
    address : str
        Address without `preset` and `layout`.
    live : bool
        Whether the source does not wait for its reader, and may be lost.
    mid_stream : bool
        Whether the first byte may be in the middle of a line or packet.
    file : Path or None
        The file, if the source is a regular file.

    Raises
    ------
    InputError
        The address is malformed, or there is no such file or port.
    """

    def __init__(self, address: str):
        self.address = link = link_of_address(address)
        self._datagram_end = b"\n" if link == address else b""
        self._kind = link.partition(":")[0].lower()
        self.file: Path | None = None
        self._descriptor, self._close = 0, None
        if address != "-" and self._kind not in ("tcp", "udp"):
            self._find_path(address)
        self.mid_stream = self._kind == "serial"
        self.live = self._kind in ("tcp", "udp", "serial")

    def _find_path(self, address: str) -> None:
        path, _, query = self.address.removeprefix("serial:").partition("?")
        what = "is not a serial port"
        try:
            mode = os.stat(path).st_mode
            if stat.S_ISCHR(mode):
                self._kind = "serial"
                self.address = f"serial:{path}" + (f"?{query}" if query else "")
                return
            if not (query or self._kind == "serial" or stat.S_ISDIR(mode)):
                self._kind, self.file = "file", Path(path) if stat.S_ISREG(mode) else None
                return
        except (OSError, ValueError) as error:
            what = f"cannot be opened: {getattr(error, 'strerror', None) or error}"
        raise InputError(
            f"--stream {address}: {path} {what}; possible: {_POSSIBLE}", key="--stream"
        )

    def open(self) -> None:
        """Open the source.

        Raises
        ------
        InercalError
            It cannot be opened.
        """
        if self._kind == "file":
            try:
                self._descriptor = os.open(self.address, os.O_RDONLY)
            except OSError as error:
                raise InputError(f"{self.address}: cannot be read: {error.strerror}") from None
            self._close = partial(os.close, self._descriptor)
        elif self.live:
            if self._kind == "udp":
                link = bound_socket(self.address, socket.SOCK_DGRAM)
            else:
                link = open_link(self.address, _ATTEMPT)
                if not isinstance(link, TcpLink | SerialLink):
                    link.close()
                    raise InputError(f"{self.address}: a stream needs a serial port, TCP or UDP")
            self._descriptor, self._close = link.fileno(), link.close
            os.set_blocking(self._descriptor, False)

    def fileno(self) -> int:
        """Return the descriptor that is readable when bytes have arrived."""
        return self._descriptor

    def take(self, *, ready: bool = True) -> bytes | None:
        """Return the bytes that have arrived; None at the end.

        `ready` tells whether `select` found that some have arrived.

        Raises
        ------
        LinkLost
            The source is gone.
        """
        if self._kind == "udp":
            return self._datagrams()
        try:
            data = os.read(self._descriptor, _MOST_BYTES)
        except BlockingIOError:
            return b""
        except OSError as error:
            raise LinkLost(f"{self.address}: {error.strerror}") from None
        if data or not ready:  # an open terminal without bytes also reads nothing
            return data
        if self.live:
            raise LinkLost(f"{self.address}: the other end has closed the connection")
        return None

    def _datagrams(self) -> bytes:
        data, end = b"", self._datagram_end
        with suppress(OSError):
            for _ in range(_MOST_DATAGRAMS):
                part = os.read(self._descriptor, _MOST_BYTES)
                data += part if part.endswith(end) else part + end
        return data

    def close(self) -> None:
        """Close the source if it is open."""
        if self._close is not None:
            self._close()
        self._close = None


def place_of(address: str) -> tuple[str, int]:
    """Return host and port of `udp://HOST:PORT`; 127.0.0.1 if there is no host.

    Raises
    ------
    InputError
        The address is malformed.
    """
    parts = urlsplit(address)
    local = parts._replace(netloc=LOCAL + parts.netloc) if parts.netloc[:1] == ":" else parts
    free_port = (parts.hostname or LOCAL, 0) if parts.netloc.endswith(":0") else None
    place = host_and_port(local) or free_port
    if place is None or parts.path not in ("", "/") or parts.query or parts.username:
        raise InputError(
            f"{address!r} is not an address; write it like {parts.scheme or 'tcp'}://{LOCAL}:5000"
        )
    return place


def bound_socket(address: str, kind: socket.SocketKind) -> socket.socket:
    """Return a socket that is bound to an address and does not block.

    Raises
    ------
    InputError
        The address is malformed, not one of this machine, or another program uses it.
    """
    place = place_of(address)
    bound = socket.socket(socket.AF_INET6 if ":" in place[0] else socket.AF_INET, kind)
    try:
        bound.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, kind == socket.SOCK_STREAM)
        bound.bind(place)
    except (OSError, UnicodeError) as error:
        bound.close()
        raise InputError(
            f"{address}: cannot listen: {getattr(error, 'strerror', None) or error}; state an "
            f"address of this machine, such as {LOCAL}, and a free port"
        ) from None
    bound.setblocking(False)
    return bound
