"""The raw log of a run: an append-only file with the bytes from the devices.

The log is readable even if the host was killed. Each frame is written in one call and contains two
checksums:

    A5 'i' | kind, 1 byte | length, uint32 | time, float64 | CRC-32 of these | payload | its CRC-32

All numbers are little-endian; `time` is the run time of the host in s. The head has a separate
checksum, because after a wrong length, the following frames would look like one unfinished frame.
If a host is killed, the file contains complete frames and at most one incomplete frame at the end.
`RunLog` removes and reports this frame when it opens the file again.
"""

import os
import sys
from collections.abc import Generator
from contextlib import contextmanager
from errno import ENOSPC
from functools import partial
from pathlib import Path
from struct import Struct
from time import monotonic, sleep
from typing import Literal, NamedTuple
from zlib import crc32

from inercal.basics.closeable import Closeable, on_failure
from inercal.basics.errors import InputError
from inercal.recordings.io import column_table

if sys.platform != "win32":
    from fcntl import LOCK_EX, LOCK_NB, LOCK_SH, flock

IMU, TABLE, EVENT = 1, 2, 3
FURTHER_IMU = 4  # kind of the first further IMU; the next further IMU has the next number
CHAMBER = "chamber"  # kind of the events with the temperatures of a chamber
_HEAD = Struct("<2sBId")
_CHECK = Struct("<I")
_MAGIC = b"\xa5i"
_LOCK_TIMEOUT, _LOCK_RETRY_INTERVAL = 0.5, 0.01  # s; for a file that another process has locked


class LogFrame(NamedTuple):
    """One piece of the received data.

    Parameters
    ----------
    kind : int
        `IMU`, `TABLE`, `EVENT`, or from `FURTHER_IMU` on, one of the further IMUs.
    time : float
        Run time at which the host received the data, s.
    payload : bytes
    """

    kind: int
    time: float
    payload: bytes


class RunLog(Closeable):
    """A log that is open for appending; it is locked, so only one host can write to it.

    The system releases the lock when the host ends for any reason.

    Parameters
    ----------
    path : path
        Path of the log; the file is created if it does not exist.

    Attributes
    ----------
    incomplete_bytes : int
        Length of an unfinished frame at the end, which was removed when the file was opened.

    Raises
    ------
    InputError
        Another host has opened the file, the file is not writable or is not a log, or it is damaged
        before its end. In the last case, the data after the damage would be lost.
    """

    def __init__(self, path: str | os.PathLike[str]):
        self.path = Path(path)
        with os_errors_as_input_errors(self.path, "written"):
            self._file = os.open(self.path, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o666)
            with on_failure(partial(os.close, self._file)):
                # The file is locked before reading, because a frame that another host is writing
                # would look incomplete.
                lock_file(
                    self._file, self.path, "another host drives this run; stop that host first"
                )
                sound = max((end for _, end in _frames_with_ends(self.path)), default=0)
                self.incomplete_bytes = os.fstat(self._file).st_size - sound
                if self.incomplete_bytes:
                    os.ftruncate(self._file, sound)

    def append(self, kind: int, time: float, payload: bytes) -> None:
        """Write one frame; when this returns, the operating system has received the whole frame.

        Raises
        ------
        InputError
            The disk is full or not available.
        """
        head = _HEAD.pack(_MAGIC, kind, len(payload), time)
        frame = head + _CHECK.pack(crc32(head)) + payload + _CHECK.pack(crc32(payload))
        with os_errors_as_input_errors(self.path, "written"):
            written = os.write(self._file, frame)
            if written < len(frame):
                # Without this, the next frame would follow an incomplete frame when there is space
                # again.
                os.ftruncate(self._file, os.fstat(self._file).st_size - written)
                raise OSError(ENOSPC, "no space left on device")

    def close(self) -> None:
        """Flush all data to the disk and close the file.

        Raises
        ------
        InputError
            Not all data could be written. The file is closed nevertheless.
        """
        with os_errors_as_input_errors(self.path, "written"):
            try:
                os.fsync(self._file)
            finally:
                os.close(self._file)


def read_frames(path: str | os.PathLike[str]) -> Generator[LogFrame]:
    """Yield the intact frames of a log, up to the first damaged frame.

    Raises
    ------
    InputError
        The file cannot be read or is not a log, or there are more frames after a damaged frame.
    """
    for frame, _ in _frames_with_ends(Path(path)):
        yield frame


def file_sha256(path: str | os.PathLike[str]) -> str:
    """Return the SHA-256 hash of a file, in hexadecimal.

    Raises
    ------
    InputError
        The file cannot be read.
    """
    with os_errors_as_input_errors(path, "read"):
        return column_table.file_sha256(Path(path))


def is_locked(path: str | os.PathLike[str]) -> bool:
    """Return whether a host currently has a lock on a log or another file."""
    if sys.platform == "win32":
        return False
    try:
        with open(path, "rb") as file:
            flock(file, LOCK_SH | LOCK_NB)
    except BlockingIOError:
        return True
    except OSError:
        return False
    return False


@contextmanager
def os_errors_as_input_errors(
    path: object, what: Literal["read", "written", "made"]
) -> Generator[None]:
    """Convert an OS error to a one-line `InputError` that says what failed, and why."""
    try:
        yield
    except OSError as error:
        raise InputError(f"{path}: cannot be {what}: {error.strerror}", file=str(path)) from None


def lock_file(file: int, path: Path, held: str) -> None:
    """Lock the file of a descriptor; on a system without file locks, do nothing.

    Raises
    ------
    InputError
        Another process has locked the file. The message consists of `path` and `held`, which says
        who has locked the file and what to do.
    """
    if sys.platform == "win32":
        return
    end = monotonic() + _LOCK_TIMEOUT
    while True:
        try:
            return flock(file, LOCK_EX | LOCK_NB)
        except BlockingIOError:
            # `is_locked` also locks the file for an instant, so only a lasting lock means another
            # host.
            if monotonic() >= end:
                raise InputError(f"{path}: {held}", file=path) from None
        sleep(_LOCK_RETRY_INTERVAL)


def _frames_with_ends(path: Path) -> Generator[tuple[LogFrame, int]]:
    """Yield each complete frame and the position of its end."""
    with os_errors_as_input_errors(path, "read"), path.open("rb") as file:
        at = 0
        while head := file.read(_HEAD.size + _CHECK.size):
            if _MAGIC[: len(head)] != head[:2]:
                what = "is not the log of a run; name another file"
                if at:
                    what = "is damaged; the data before this can be read"
                raise InputError(f"no frame begins at byte {at}: the file {what}").located(path)
            if len(head) < _HEAD.size + _CHECK.size:
                return
            _, kind, length, time = _HEAD.unpack_from(head)
            _require_checksum(_HEAD.size, head, path, at)
            rest = file.read(length + _CHECK.size)
            if len(rest) < length + _CHECK.size:
                return
            _require_checksum(length, rest, path, at)
            at += len(head) + len(rest)
            yield LogFrame(kind, time, rest[:length]), at


def _require_checksum(length: int, checked: bytes, path: Path, at: int) -> None:
    """Raise an error if bytes do not match their checksum."""
    if _CHECK.unpack_from(checked, length)[0] != crc32(checked[:length]):
        raise InputError(
            f"{path} is damaged: the frame at byte {at} does not match its checksum; restore the "
            "file, or begin a new run",
            file=path,
        )
