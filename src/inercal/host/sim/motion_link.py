"""The true motion on its way from the table's process to the IMU's, and what comes back.

The link is a socket of the system (`unix:PATH`), which wakes the other end sooner than TCP does. A
part holds servo cycles and up to when the bench has gone on; it is answered by how many bytes the
IMU has sent in all, once the readings due by then are sent.
"""

import socket
from pathlib import Path
from select import select
from struct import Struct
from time import monotonic, sleep
from typing import NamedTuple

import numpy as np

from inercal.basics.arrays import Array

SOCKET_NAME = "motion"  # of the socket, in the bench's folder
_RETRY_INTERVAL = 0.05  # s
_HEAD = Struct("<ddqqqq")  # until, period, first cycle, cycles, axes, bytes of the mounting
_BYTE_COUNT = Struct("<q")


class MotionBlock(NamedTuple):
    """Motion of some servo cycles: `motion` (n, axes, 3) rad, rad/s, rad/s² at their ends.

    `mounting` is the name of how the sensor is mounted; empty where it never was.
    """

    end_time: float
    period: float
    first_cycle: int
    motion: Array
    mounting: str = ""


def listen(path: Path) -> tuple[socket.socket, str]:
    """Return the IMU's end before anybody is there, and its address."""
    listener = socket.socket(socket.AF_UNIX)
    listener.bind(str(path))
    listener.listen()
    return listener, f"unix:{path}"


def connect(address: str, patience: float) -> socket.socket:
    """Return the table's end, which waits for the other `patience` s at most.

    Raises
    ------
    OSError
        No IMU is there.
    """
    end, until = socket.socket(socket.AF_UNIX), monotonic() + patience
    try:
        while True:
            try:
                end.connect(address.removeprefix("unix:"))
                return end
            except (FileNotFoundError, ConnectionRefusedError):  # it does not listen yet
                if monotonic() > until:
                    raise
                sleep(_RETRY_INTERVAL)
    except OSError:
        end.close()
        raise


def send(end: socket.socket, part: MotionBlock) -> None:
    """Send a part; raises `OSError` where nobody takes it."""
    count, axes, _ = part.motion.shape
    name = part.mounting.encode()
    head = _HEAD.pack(part.end_time, part.period, part.first_cycle, count, axes, len(name))
    end.sendall(head + name + part.motion.tobytes())


def receive(end: socket.socket) -> MotionBlock | None:
    """Wait for a part; None at the end."""
    head = _receive_exactly(end, _HEAD.size)
    if head is None:
        return None
    until, period, first, count, axes, size = _HEAD.unpack(head)
    name = _receive_exactly(end, size)
    if name is None:
        return None
    moved = np.empty((count, axes, 3))
    if count and not _fill_buffer(end, moved.data.cast("B")):
        return None
    return MotionBlock(until, period, first, moved, name.decode())


def send_byte_count(end: socket.socket, sent: int) -> None:
    """Say how many bytes the IMU has sent."""
    end.sendall(_BYTE_COUNT.pack(sent))


def receive_byte_count(end: socket.socket, timeout: float) -> int | None:
    """Return how many bytes the IMU has sent; None where it does not answer within `timeout` s.

    Raises
    ------
    OSError
        The IMU is gone.
    """
    if not select([end], [], [], timeout)[0]:
        return None
    data = _receive_exactly(end, _BYTE_COUNT.size)
    if data is None:
        raise ConnectionResetError("the simulated IMU has closed the connection")
    return int(_BYTE_COUNT.unpack(data)[0])


def _receive_exactly(end: socket.socket, size: int) -> bytes | None:
    data = bytearray(size)
    return bytes(data) if _fill_buffer(end, memoryview(data)) else None


def _fill_buffer(end: socket.socket, into: memoryview) -> bool:
    """Receive until all is full; False at the end of the stream."""
    done = 0
    while done < len(into):
        size = end.recv_into(into[done:])
        if not size:
            return False
        done += size
    return True
