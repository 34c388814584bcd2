"""Sends the true motion from the table's process to the IMU's process, and byte counts back.

The link is a Unix socket (`unix:PATH`), which wakes the other end faster than TCP does. A block
contains servo cycles and the bench time that was reached. The IMU first sends the readings that are
due at this time, and then answers with the total number of bytes that it has sent. If several
IMUs sense the motion, the answer contains the number for each of them.
"""

import socket
from math import nan
from pathlib import Path
from select import select
from struct import Struct
from time import monotonic, sleep
from typing import NamedTuple

import numpy as np

from inercal.basics.arrays import Array

SOCKET_NAME = "motion"  # name of the socket in the folder of the bench
_RETRY_INTERVAL = 0.05  # s
# until, period, temperature, first cycle, cycles, axes, length of the mounting
_HEAD = Struct("<dddqqqq")
_COUNTS = Struct("<q")  # number of the following byte counts, each of the same size


class MotionBlock(NamedTuple):
    """Motion at the ends of some servo cycles: `motion` (n, axes, 3), rad, rad/s, rad/s².

    `mounting` is the name of the sensor's mounting; empty if the sensor was never mounted.
    `temperature` is the temperature of the sensor, K; NaN if the bench has no chamber.
    """

    end_time: float
    period: float
    first_cycle: int
    motion: Array
    mounting: str = ""
    temperature: float = nan


def listen(path: Path) -> tuple[socket.socket, str]:
    """Open the IMU's end of the link, for a later connection; return it and its address."""
    listener = socket.socket(socket.AF_UNIX)
    listener.bind(str(path))
    listener.listen()
    return listener, f"unix:{path}"


def connect(address: str, patience: float) -> socket.socket:
    """Connect the table's end of the link; wait for the IMU for at most `patience` s.

    Raises
    ------
    OSError
        No IMU answers.
    """
    end, until = socket.socket(socket.AF_UNIX), monotonic() + patience
    while True:
        try:
            end.connect(address.removeprefix("unix:"))
            return end
        except OSError as error:
            waits = isinstance(error, (FileNotFoundError, ConnectionRefusedError))
            if not waits or monotonic() > until:  # the IMU may not listen yet
                end.close()
                raise
            sleep(_RETRY_INTERVAL)


def send(end: socket.socket, part: MotionBlock) -> None:
    """Send a block; raises `OSError` if the connection is lost."""
    count, axes, _ = part.motion.shape
    name = part.mounting.encode()
    times = part.end_time, part.period, part.temperature
    head = _HEAD.pack(*times, part.first_cycle, count, axes, len(name))
    end.sendall(head + name + part.motion.tobytes())


def receive(end: socket.socket) -> MotionBlock | None:
    """Wait for a block and return it; None if the connection has ended."""
    head = _receive_exactly(end, _HEAD.size)
    if head is None:
        return None
    until, period, temperature, first, count, axes, size = _HEAD.unpack(head)
    name = _receive_exactly(end, size)
    if name is None:
        return None
    moved = np.empty((count, axes, 3))
    if count and not _fill_buffer(end, moved.data.cast("B")):
        return None
    return MotionBlock(until, period, first, moved, name.decode(), temperature)


def send_byte_counts(end: socket.socket, *sent: int) -> None:
    """Send the total number of bytes that each IMU has sent."""
    end.sendall(b"".join(map(_COUNTS.pack, (len(sent), *sent))))


def receive_byte_counts(end: socket.socket, timeout: float) -> list[int] | None:
    """Return the numbers of bytes that the IMUs have sent; None if no answer arrives in time.

    Raises
    ------
    OSError
        The IMU is gone.
    """
    if not select([end], [], [], timeout)[0]:
        return None
    if head := _receive_exactly(end, _COUNTS.size):
        (number,) = _COUNTS.unpack(head)
        if (data := _receive_exactly(end, number * _COUNTS.size)) is not None:
            return [count for (count,) in _COUNTS.iter_unpack(data)]
    raise ConnectionResetError("the simulated IMU has closed the connection")


def _receive_exactly(end: socket.socket, size: int) -> bytes | None:
    data = bytearray(size)
    return bytes(data) if _fill_buffer(end, memoryview(data)) else None


def _fill_buffer(end: socket.socket, into: memoryview) -> bool:
    """Receive until the buffer is full; return False at the end of the stream."""
    done = 0
    while done < len(into):
        size = end.recv_into(into[done:])
        if not size:
            return False
        done += size
    return True
