"""Send corrected samples to a descriptor such as standard output, to TCP readers, or by UDP.

Blocks wait for a slow reader in a queue of limited length. If it is full, the oldest blocks are
dropped, and the reader is told how many samples it lost. A block of which a part was already sent
is never dropped.

Corrected samples are written as CSV, JSON lines or MessagePack. Text has nine significant digits,
as the files of `inercal apply`; MessagePack has all digits. A missing value is written as an empty
cell, null or nil.
"""

import json
import os
import select
import socket
import stat
from collections import deque
from collections.abc import Callable, Sequence
from contextlib import suppress
from importlib import import_module
from itertools import chain
from typing import Any, NamedTuple

import numpy as np

from inercal.basics.closeable import Closeable
from inercal.basics.errors import InercalError, InputError, require_extra
from inercal.host.correction.sources import LOCAL, bound_socket, place_of
from inercal.pipeline.correction import SIGNIFICANT
from inercal.pipeline.live_correction import CorrectedBlock

_TIME_DECIMALS = 7


class Format(NamedTuple):
    """A format of the output.

    Parameters
    ----------
    head : bytes
        What a reader gets first.
    block : callable
        Function that returns the bytes of corrected samples.
    lost : callable
        Function that returns the bytes that tell a reader how many samples were lost.
    """

    head: bytes
    block: Callable[[CorrectedBlock], bytes]
    lost: Callable[[int], bytes]


def csv_format(names: Sequence[str]) -> Format:
    """Return the format of comma-separated lines with a header."""
    lines = _TextLines(["", *[","] * len(names), ","], "\n", "")
    head = ",".join(["time", *names, "flags"]) + "\n"
    return Format(head.encode(), lines.format, b"# lost %d samples\n".__mod__)


def json_format(names: Sequence[str]) -> Format:
    """Return the format of one JSON object per line."""
    keys = [json.dumps(name, ensure_ascii=False) + ":" for name in ("time", *names, "flags")]
    lines = _TextLines(["{" + keys[0], *("," + key for key in keys[1:])], "}\n", "null")
    return Format(b"", lines.format, b'{"lost":%d}\n'.__mod__)


def msgpack_format(names: Sequence[str]) -> Format:
    """Return the format of one MessagePack map per sample.

    Raises
    ------
    MissingExtra
        msgpack is not installed.
    """
    with require_extra("stream", "MessagePack needs msgpack; install the extra", ("msgpack",)):
        pack: Callable[[Any], bytes] = import_module("msgpack").Packer().pack
    keys = ("time", *names, "flags")

    def block(samples: CorrectedBlock) -> bytes:
        columns = [samples.time.tolist(), *samples.values.T.tolist(), samples.flags.tolist()]
        if np.isnan(samples.values).any():
            columns = [[None if x != x else x for x in column] for column in columns]
        rows = zip(*columns, strict=True)
        return b"".join([pack(dict(zip(keys, row, strict=True))) for row in rows])

    def lost(count: int) -> bytes:
        return pack({"lost": count})

    return Format(b"", block, lost)


FORMATS: dict[str, Callable[[Sequence[str]], Format]] = {
    "csv": csv_format,
    "json": json_format,
    "msgpack": msgpack_format,
}


class _TextLines:
    """Formats samples as lines: texts before each number, and after the last one."""

    def __init__(self, before: Sequence[str], end: str, missing: str):
        self._missing = missing
        first, *others, last = (text.replace("%", "%%") for text in before)
        time, flags = f"{first}%.{_TIME_DECIMALS}f", f"{last}%d{end.replace('%', '%%')}"
        number, text = ("".join(one + form for one in others) for form in (SIGNIFICANT, "%s"))
        self._numbers, self._texts = time + number + flags, time + text + flags

    def format(self, block: CorrectedBlock) -> bytes:
        """Return the lines of corrected samples."""
        line, n = self._numbers, block.time.size
        columns = [block.time.tolist(), *block.values.T.tolist(), block.flags.tolist()]
        if any(columns[-1]) and np.isnan(block.values).any():
            line = self._texts
            columns[1:-1] = [[self._text(x) for x in column] for column in columns[1:-1]]
        cells = tuple(chain.from_iterable(zip(*columns, strict=True)))
        return (line * n % cells).encode()

    def _text(self, value: float) -> str:
        return SIGNIFICANT % value if value == value else self._missing


MOST_WAITING = 10_000  # samples
_PIPE = 4096  # bytes that a writable pipe takes without blocking (PIPE_BUF of Linux)
_DATAGRAM_SAMPLES = 4  # so that a datagram fits into an Ethernet frame
_LARGEST_BLOCK = 4096  # samples that are formatted at a time


class OutputClosed(InercalError):
    """The only reader has closed the output."""


class WaitingReader:
    """A reader, and the blocks that wait for it.

    Parameters
    ----------
    descriptor : int
    send : callable
        Function that sends some bytes without blocking and returns their number.
    format : Format
    most : int
        Largest number of waiting samples, except those of a single block.

    Attributes
    ----------
    waiting, lost : int
        Numbers of samples.
    """

    def __init__(
        self, descriptor: int, send: Callable[[memoryview], int], format: Format, most: int
    ):
        self.waiting = self.lost = self._untold = 0
        self._descriptor, self._send, self._format, self._most = descriptor, send, format, most
        self._blocks: deque[tuple[int, bytes]] = deque()
        self._sending = memoryview(format.head)

    def fileno(self) -> int:
        """Return the descriptor that is writable when the reader takes more."""
        return self._descriptor

    @property
    def is_idle(self) -> bool:
        """Whether everything has been sent."""
        return not (self._sending or self._blocks or self._untold)

    def put(self, samples: int, data: bytes) -> None:
        """Add a block to the queue, and drop the oldest blocks if it is full."""
        self._blocks.append((samples, data))
        self.waiting += samples
        while self.waiting > self._most and len(self._blocks) > 1:
            dropped, _ = self._blocks.popleft()
            self.waiting -= dropped
            self.lost += dropped
            self._untold += dropped

    def flush(self) -> None:
        """Send what the reader takes now; raises OSError if it is gone."""
        while not self.is_idle:
            if not self._sending and self._untold:
                self._sending, self._untold = memoryview(self._format.lost(self._untold)), 0
            elif not self._sending:
                samples, data = self._blocks.popleft()
                self.waiting -= samples
                self._sending = memoryview(data)
            if not (sent := self._send(self._sending)):
                return
            self._sending = self._sending[sent:]


class Output(Closeable):
    """Sends samples to readers.

    Parameters
    ----------
    format : Format
    descriptor : int or None
        Where a single reader is, such as 1 for standard output.
    most : int
        Largest number of samples that wait for each reader.

    Attributes
    ----------
    readers : list of WaitingReader
    """

    def __init__(self, format: Format, descriptor: int | None = None, most: int = MOST_WAITING):
        self.readers: list[WaitingReader] = []
        self._format, self._most, self._lost_before = format, most, 0
        self._block = _LARGEST_BLOCK
        if descriptor is not None:
            self.readers = [WaitingReader(descriptor, _descriptor_sender(descriptor), format, most)]

    @property
    def lost(self) -> int:
        """Number of samples that readers lost."""
        return self._lost_before + sum(reader.lost for reader in self.readers)

    def put(self, block: CorrectedBlock) -> None:
        """Queue samples for all readers."""
        if not self.readers:
            return
        for k in range(0, block.time.size, self._block):
            some = slice(k, k + self._block)
            part = CorrectedBlock(block.time[some], block.values[some], block.flags[some])
            data = self._format.block(part)
            for reader in self.readers:
                reader.put(part.time.size, data)

    def flush(self) -> None:
        """Send what the readers take now.

        Raises
        ------
        OutputClosed
            The only reader is gone.
        InputError
            The disk is full, or writing fails for another reason.
        """
        for reader in list(self.readers):
            try:
                reader.flush()
            except OSError as error:
                self._drop(reader, error)

    def _drop(self, reader: WaitingReader, error: OSError) -> None:
        if isinstance(error, BrokenPipeError):
            raise OutputClosed("the reader has closed the output") from None
        raise InputError(f"the output cannot be written: {error.strerror}") from None

    def close(self) -> None:
        """Do nothing, because this program does not own standard output."""


class TcpOutput(Output):
    """Sends samples to every reader that connects to `tcp://HOST:PORT`.

    Without host, it listens at 127.0.0.1; with port 0, at a free port.

    Attributes
    ----------
    address : str
        Address with the port that was chosen.
    listener : socket
        Socket that is readable when a reader wants to connect.

    Raises
    ------
    InputError
        The address is malformed or not free.
    """

    def __init__(self, address: str, format: Format, most: int = MOST_WAITING):
        super().__init__(format, most=most)
        self.listener = bound_socket(address, socket.SOCK_STREAM)
        self.listener.listen()
        self.address = "tcp://{}:{}".format(*self.listener.getsockname())
        self._sockets: dict[WaitingReader, socket.socket] = {}

    def accept(self) -> None:
        """Accept a reader that wants to connect."""
        with suppress(BlockingIOError, ConnectionError):
            connection, _ = self.listener.accept()
            connection.setblocking(False)
            connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            sender = _socket_sender(connection)
            reader = WaitingReader(connection.fileno(), sender, self._format, self._most)
            self._sockets[reader] = connection
            self.readers.append(reader)

    def _drop(self, reader: WaitingReader, error: OSError) -> None:
        self._lost_before += reader.lost
        self.readers.remove(reader)
        self._sockets.pop(reader).close()

    def close(self) -> None:
        """Close all connections."""
        for one in (self.listener, *self._sockets.values()):
            one.close()


class UdpOutput(Output):
    """Sends datagrams with up to four samples to `udp://HOST:PORT`, whether they arrive or not.

    Raises
    ------
    InputError
        The address is malformed or unknown.
    """

    def __init__(self, address: str, format: Format):
        super().__init__(format)
        try:
            family, *_, target = socket.getaddrinfo(*place_of(address), type=socket.SOCK_DGRAM)[0]
            self._socket = socket.socket(family, socket.SOCK_DGRAM)
            self._socket.connect(target)
        except (OSError, UnicodeError) as error:
            raise InputError(f"--to {address}: {error}; correct the address", key="--to") from None
        self._socket.setblocking(False)
        self._block = _DATAGRAM_SAMPLES
        sender = _socket_sender(self._socket)
        self.readers = [WaitingReader(self._socket.fileno(), sender, format, self._most)]

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()


def open_output(to: str | None, format: Format) -> Output:
    """Return the output to an address, or to standard output for None.

    Raises
    ------
    InputError
        The address is malformed or cannot be used.
    """
    kind = "" if to is None else to.partition(":")[0].lower()
    if to is None:
        return Output(format, 1)
    if kind in ("tcp", "udp"):
        return TcpOutput(to, format) if kind == "tcp" else UdpOutput(to, format)
    possible = f"tcp://{LOCAL}:5000 or udp://{LOCAL}:5000"
    raise InputError(f"--to {to!r} is not an address; possible: {possible}", key="--to")


def _descriptor_sender(descriptor: int) -> Callable[[memoryview], int]:
    """Return a function that writes to a file, or to a pipe or terminal without blocking."""
    step = None if stat.S_ISREG(os.fstat(descriptor).st_mode) else _PIPE
    poll = select.poll()
    poll.register(descriptor, select.POLLOUT)
    return lambda data: os.write(descriptor, data[:step]) if poll.poll(0) else 0


def _socket_sender(connection: socket.socket) -> Callable[[memoryview], int]:
    """Return a function that sends to a socket without blocking."""

    def send(data: memoryview) -> int:
        try:
            return connection.send(data)
        except BlockingIOError:
            return 0
        except ConnectionRefusedError:  # nobody received an earlier datagram
            return len(data)

    return send
