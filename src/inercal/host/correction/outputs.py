"""Where corrected samples go: a descriptor such as standard output, TCP readers, or UDP.

Blocks wait for a slow reader in a queue of limited length. If it is full, the oldest blocks are
dropped, and the reader is told how many samples it lost. A block that is sent in part is kept.
"""

import os
import select
import socket
import stat
from collections import deque
from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import Protocol

from inercal.basics.closeable import Closeable
from inercal.basics.errors import InercalError, InputError
from inercal.host.correction.formats import Format
from inercal.host.correction.sources import bound_socket, listening_place
from inercal.pipeline.live_correction import CorrectedBlock

_PIPE = 4096  # bytes that a pipe takes without blocking if it is writable (PIPE_BUF of Linux)
_DATAGRAM_SAMPLES = 4  # so that a datagram fits into an Ethernet frame


class OutputClosed(InercalError):
    """The only reader has closed the output."""


class Reader:
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
        self.waiting = self.lost = 0
        self._descriptor, self._send, self._format, self._most = descriptor, send, format, most
        self._blocks: deque[tuple[int, bytes]] = deque()
        self._sending = memoryview(format.head)
        self._untold = 0

    def fileno(self) -> int:
        """Return the descriptor that is writable when the reader takes more."""
        return self._descriptor

    @property
    def is_idle(self) -> bool:
        """Whether everything has been sent."""
        return not self._sending and not self._blocks and not self._untold

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
            if not self._sending:
                if self._untold:
                    self._sending, self._untold = memoryview(self._format.lost(self._untold)), 0
                else:
                    samples, data = self._blocks.popleft()
                    self.waiting -= samples
                    self._sending = memoryview(data)
            sent = self._send(self._sending)
            self._sending = self._sending[sent:]
            if not sent:
                return


class Output(Protocol):
    """An output. `lost` is the number of samples that readers lost."""

    readers: Sequence[Reader]
    listeners: Sequence[socket.socket]
    lost: int

    def accept(self) -> None:
        """Accept readers that want to connect."""
        ...

    def put(self, block: CorrectedBlock) -> None:
        """Send samples, or keep them until the readers take them."""
        ...

    def flush(self) -> None:
        """Send what the readers take now."""
        ...

    def close(self) -> None:
        """Close the output."""
        ...


class DescriptorOutput(Closeable):
    """Writes to a descriptor such as 1, standard output, which is not closed at the end.

    Parameters
    ----------
    descriptor : int
    format : Format
    most : int
        Largest number of samples that wait.
    """

    listeners: Sequence[socket.socket] = ()

    def __init__(self, descriptor: int, format: Format, most: int = 10_000):
        self._descriptor, self._format = descriptor, format
        self._poll = select.poll()
        self._poll.register(descriptor, select.POLLOUT)
        mode = os.fstat(descriptor).st_mode
        self._step = None if stat.S_ISREG(mode) else _PIPE
        self.readers = (Reader(descriptor, self._send, format, most),)

    @property
    def lost(self) -> int:
        """Number of samples that the reader lost."""
        return self.readers[0].lost

    def _send(self, data: memoryview) -> int:
        return os.write(self._descriptor, data[: self._step]) if self._poll.poll(0) else 0

    def accept(self) -> None:
        """Do nothing, because there is always one reader."""

    def put(self, block: CorrectedBlock) -> None:
        """See `Output.put`."""
        self.readers[0].put(block.time.size, self._format.block(block))

    def flush(self) -> None:
        """See `Output.flush`.

        Raises
        ------
        OutputClosed
            The reader of a pipe is gone.
        InputError
            The disk is full, or writing fails for another reason.
        """
        try:
            self.readers[0].flush()
        except BrokenPipeError:
            raise OutputClosed("the reader has closed the output") from None
        except OSError as error:
            raise InputError(f"the output cannot be written: {error.strerror}") from None

    def close(self) -> None:
        """Do nothing."""


class TcpOutput(Closeable):
    """Sends to every reader that connects to a TCP port.

    Parameters
    ----------
    address : str
        `tcp://HOST:PORT`; `tcp://:PORT` listens at 127.0.0.1, and port 0 is a free port.
    format : Format
    most : int
        Largest number of samples that wait for each reader.

    Attributes
    ----------
    address : str
        Address with the port that was chosen.

    Raises
    ------
    InputError
        The address is malformed or not free.
    """

    def __init__(self, address: str, format: Format, most: int = 10_000):
        place = listening_place(address)
        self._listener = bound_socket(address, place, socket.SOCK_STREAM)
        self._listener.listen()
        self.address = f"tcp://{place[0]}:{self._listener.getsockname()[1]}"
        self.listeners: Sequence[socket.socket] = (self._listener,)
        self._format, self._most, self._lost_before = format, most, 0
        self._sockets: dict[Reader, socket.socket] = {}

    @property
    def readers(self) -> Sequence[Reader]:
        """The connected readers."""
        return tuple(self._sockets)

    @property
    def lost(self) -> int:
        """Number of samples that readers lost."""
        return self._lost_before + sum(reader.lost for reader in self._sockets)

    def accept(self) -> None:
        """See `Output.accept`."""
        with suppress(BlockingIOError, ConnectionError):
            while True:
                connection, _ = self._listener.accept()
                connection.setblocking(False)
                connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                send = _sender(connection)
                self._sockets[Reader(connection.fileno(), send, self._format, self._most)] = (
                    connection
                )

    def put(self, block: CorrectedBlock) -> None:
        """See `Output.put`."""
        if self._sockets:
            data = self._format.block(block)
            for reader in self._sockets:
                reader.put(block.time.size, data)

    def flush(self) -> None:
        """See `Output.flush`; readers that are gone are forgotten."""
        for reader, connection in list(self._sockets.items()):
            try:
                reader.flush()
            except OSError:
                self._lost_before += reader.lost
                connection.close()
                del self._sockets[reader]

    def close(self) -> None:
        """Close all connections."""
        for one in (self._listener, *self._sockets.values()):
            one.close()


def _sender(connection: socket.socket) -> Callable[[memoryview], int]:
    def send(data: memoryview) -> int:
        try:
            return connection.send(data)
        except BlockingIOError:
            return 0

    return send


class UdpOutput(Closeable):
    """Sends datagrams with up to four samples each, whether somebody receives them or not.

    Parameters
    ----------
    address : str
        `udp://HOST:PORT` of the receiver.
    format : Format

    Raises
    ------
    InputError
        The address is malformed or unknown.
    """

    readers: Sequence[Reader] = ()
    listeners: Sequence[socket.socket] = ()

    def __init__(self, address: str, format: Format):
        self._format, self.lost = format, 0
        place = listening_place(address)
        try:
            family, *_, target = socket.getaddrinfo(*place, type=socket.SOCK_DGRAM)[0]
            self._socket = socket.socket(family, socket.SOCK_DGRAM)
            self._socket.connect(target)
        except (OSError, UnicodeError) as error:
            raise InputError(
                f"{address}: {getattr(error, 'strerror', None) or error}; correct the address"
            ) from None
        self._socket.setblocking(False)

    def accept(self) -> None:
        """Do nothing, because UDP has no connections."""

    def put(self, block: CorrectedBlock) -> None:
        """See `Output.put`."""
        for k in range(0, block.time.size, _DATAGRAM_SAMPLES):
            part = CorrectedBlock(*(column[k : k + _DATAGRAM_SAMPLES] for column in block))
            try:
                self._socket.send(self._format.block(part))
            except ConnectionError:  # the report that nobody received an earlier datagram
                continue
            except BlockingIOError:
                self.lost += part.time.size

    def flush(self) -> None:
        """Do nothing, because no datagram waits."""

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()
