"""Read files that need a parsing library in a separate process with memory and time limits.

Damaged bytes can crash a library or keep it busy forever, and a few bytes can stand for more data
than fits into any memory. Such a file then only ends the reading process (`reading_process`), and
this process continues. The reading process is started for the first file and kept for later ones.

The limits depend on the size of the file. Reading may take 512 MiB of memory plus 32 times its
size, and 4 s of processor time plus 2 s for each MB. An intact file may need more because it is
compressed; `[data] most_values` raises the limit.

Requests and answers are sent through a pipe, and their arrays are sent exactly as they are in
memory. A message consists of the length of its header, the header (the length of the pickled object
and the sizes of its arrays), the object pickled without its arrays, and the arrays (PEP 574).
"""

import atexit
import os
import pickle
import signal
import struct
import subprocess
import sys
from collections.abc import Callable, Generator
from contextlib import suppress
from functools import partial
from io import RawIOBase
from pathlib import Path
from typing import Any, NamedTuple, cast

import numpy as np

from inercal.basics.errors import InputError, require_installed
from inercal.recordings.io.damaged_files import refuse_damage

_LENGTH = struct.Struct("<Q")


def send(pipe: RawIOBase, content: object) -> None:
    """Write an object to a pipe.

    Raises
    ------
    OSError
        The other end of the pipe is closed.
    """
    buffers: list[pickle.PickleBuffer] = []
    pickled = pickle.dumps(content, 5, buffer_callback=buffers.append)
    arrays = [one.raw() for one in buffers]
    head = pickle.dumps((len(pickled), [one.nbytes for one in arrays]))
    for part in (_LENGTH.pack(len(head)) + head + pickled, *arrays):
        view = memoryview(part)
        while view:
            view = view[pipe.write(view) or 0 :]


def receive(pipe: RawIOBase) -> Any:
    """Read the next object from a pipe.

    Raises
    ------
    EOFError
        The pipe is at its end.
    """
    (length,) = _LENGTH.unpack(_read(pipe, _LENGTH.size))
    size, sizes = pickle.loads(_read(pipe, length))
    pickled = _read(pipe, size)
    return pickle.loads(pickled, buffers=[_read(pipe, one) for one in sizes])


def _read(pipe: RawIOBase, size: int) -> memoryview:
    content = np.empty(size, np.uint8).data  # unlike other buffers, not zeroed first
    done = 0
    while done < size:
        got = pipe.readinto(content[done:])
        if not got:
            raise EOFError
        done += got
    return content


MOST_VALUES = 250_000_000  # of 8 bytes: 2 GB, which is 50 hours of seven channels at 200 Hz
MOST_VALUES_KEY = "[data] most_values"
_MOST_STATED = 10**12
_BASE, _BYTES_PER_VALUE = 1 << 29, 32
_SECONDS, _SECONDS_PER_BYTE, _SECONDS_PER_VALUE = 4.0, 2e-6, 2e-5
_WAITED, _WAITED_PER_SECOND = 60, 4  # s; a disk or a busy machine may keep a reader waiting
_ENDS_WITHIN = 5.0  # s
FORKS = sys.platform == "linux" and hasattr(os, "fork")
"""Whether a process forks for each file and can read many, instead of only one."""
_KILL = getattr(signal, "SIGKILL", signal.SIGTERM)
_PROGRAM = """
import sys
sys.path[:] = sys.argv[1:]
from inercal.recordings.io.reading_process import serve
serve()
"""
# Reserved memory counts as used; each thread and pyarrow's own allocators reserve much.
_ENVIRONMENT = {
    "OPENBLAS_NUM_THREADS": "1",
    "OMP_NUM_THREADS": "1",
    "MALLOC_ARENA_MAX": "1",
    "ARROW_DEFAULT_MEMORY_POOL": "system",
}


def file_size(path: Path) -> int:
    """Return the number of bytes of a file."""
    return path.stat().st_size


def _is_not_bounded(path: Path) -> bool:
    return False


class Isolation(NamedTuple):
    """Describes a kind of file that is read in a separate process.

    Parameters
    ----------
    kind : str
        The expected kind of file, "an HDF5 file".
    advice : str
        Advice on what to do if the file is damaged.
    libraries : tuple of str
        Modules that are imported once for all files.
    extra : str
        Name of the extra to install for these modules; empty if they come with inercal.
    key : str
        Key that raises the limits; empty if there is none.
    size : callable
        Function that returns the number of bytes of a file, with others that it names.
    is_bounded : callable
        Function that tells whether a file can be read in this process, because it declares no more
        than it contains and no compiled library parses it.
    """

    kind: str
    advice: str = "write the file again"
    libraries: tuple[str, ...] = ()
    extra: str = ""
    key: str = MOST_VALUES_KEY
    size: Callable[[Path], int] = file_size
    is_bounded: Callable[[Path], bool] = _is_not_bounded


class ReadingLimits(NamedTuple):
    """Limits for reading a file: memory, bytes; processor time and time between results, s."""

    memory: int
    seconds: int
    waited: int


class ReadingRequest(NamedTuple):
    """A call of a function with the path of a file and further arguments."""

    isolation: Isolation
    limits: ReadingLimits
    path: Path
    function: Callable[..., Any]
    arguments: tuple[Any, ...]


def read_isolated(
    isolation: Isolation,
    path: Path,
    function: Callable[..., Any],
    *arguments: Any,
    most_values: int | None = None,
) -> Any:
    """Call a function on a file, unless it is bounded in a process with limits; return its result.

    Parameters
    ----------
    isolation : Isolation
    path : Path
    function : callable
        Module-level function that the process can import; called with the path and the arguments.
    *arguments : object
        Further arguments, which must be picklable.
    most_values : int, optional
        Number of 8-byte values in the file, if stated.

    Raises
    ------
    MissingExtra
        A required library is not installed.
    InputError
        The function raises it, a library raises any other error because the file is damaged, the
        process crashes, or it needs too much memory or time.
    OSError
        The file cannot be read.
    """
    if not isolation.is_bounded(path):
        (result,) = stream_isolated(isolation, path, function, *arguments, most_values=most_values)
        return result
    try:
        with refuse_damage(path, isolation.kind, isolation.advice):
            return function(path, *arguments)
    except MemoryError as error:
        limits = _limits(isolation.size(path), most_values)
        raise _own_error(error, isolation, limits, path) from None


def stream_isolated(
    isolation: Isolation,
    path: Path,
    function: Callable[..., Any],
    *arguments: Any,
    most_values: int | None = None,
) -> Generator[Any]:
    """Call a generator function on a file as in `read_isolated`, and yield its results."""
    if isolation.extra:
        package = isolation.libraries[0].partition(".")[0]
        require_installed(isolation.extra, f"{isolation.kind} needs {package}", (package,))
    size = isolation.size(path)
    limits = _limits(size, most_values)
    process, ended = _idle_process(), False
    try:
        request = ReadingRequest(isolation, limits, path.absolute(), function, arguments)
        send(process.requests, request)
        # Each result comes in a tuple; the last answer is an error or None.
        while isinstance(answer := receive(process.answers), tuple):
            yield answer[0]
        ended = True
        if answer is not None:
            raise _own_error(answer, isolation, limits, path)
    except (EOFError, BrokenPipeError):
        raise _death_error(process.end(), isolation, limits, path) from None
    finally:
        if ended and FORKS:
            _idle.append(process)
        else:
            process.kill()


def _limits(size: int, most_values: int | None) -> ReadingLimits:
    """Return the limits for reading a file with this number of bytes.

    >>> _limits(1_000_000, None).seconds, _limits(1_000_000, 10_000_000).seconds
    (6, 206)
    """
    stated = min(max(most_values or 0, 0), _MOST_STATED)
    values = min(size, MOST_VALUES) if most_values is None else stated
    seconds = _SECONDS + _SECONDS_PER_BYTE * size + _SECONDS_PER_VALUE * stated
    waited = _WAITED + _WAITED_PER_SECOND * seconds
    return ReadingLimits(_BASE + _BYTES_PER_VALUE * values, int(seconds), int(waited))


def _own_error(
    error: Exception, isolation: Isolation, limits: ReadingLimits, path: Path
) -> Exception:
    """Convert an error from the process to the error that is raised here."""
    if isinstance(error, MemoryError):
        more = f"{limits.memory / 1e6:.0f} MB of memory"
        return _limit_error(f"needs more than {more} to be read", isolation, path)
    if isinstance(error, InputError) and error.file == path.absolute():
        error.file = path
    return error


def _limit_error(what: str, isolation: Isolation, path: Path) -> InputError:
    """Return the error for a file that exceeds the limits for its size."""
    more = f"state {isolation.key}, the number of its values" if isolation.key else ""
    return InputError(
        f"{path.name} {what}, the limit for {isolation.kind} of its size: it is damaged or very "
        f"strongly compressed; {' or '.join(filter(None, (isolation.advice, more)))}",
        file=path,
        key=isolation.key or None,
    )


def _death_error(
    status: int, isolation: Isolation, limits: ReadingLimits, path: Path
) -> InputError:
    """Return the error for a file whose reading process died."""
    number = -status if status < 0 else status - 128
    name = signal.Signals(number).name if number in set(signal.Signals) else f"status {status}"
    if name == "SIGXCPU":
        more = f"{limits.seconds} s of processor time"
        return _limit_error(f"needs more than {more} to be read", isolation, path)
    if name == "SIGALRM":
        return _limit_error(f"was not read within {limits.waited} s", isolation, path)
    if name == "SIGKILL":
        what = "the system ended the process that read it, probably because memory ran out"
        return InputError(f"{path.name}: {what}; close other programs and try again", file=path)
    return InputError(
        f"{path.name} crashes the library that reads it ({name}): it is not {isolation.kind} or is "
        f"damaged; {isolation.advice}",
        file=path,
    )


class _Process:
    """A process that reads files, one after another."""

    def __init__(self) -> None:
        self._process = subprocess.Popen(
            [sys.executable, "-c", _PROGRAM, *sys.path],
            bufsize=0,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,  # libraries print diagnostics there
            env={**os.environ, **_ENVIRONMENT},
            start_new_session=True,  # keyboard interrupts do not reach it
        )
        self.requests = cast(RawIOBase, self._process.stdin)
        self.answers = cast(RawIOBase, self._process.stdout)

    @property
    def running(self) -> bool:
        return self._process.poll() is None

    def leave(self) -> None:
        """Detach from the process without ending it."""
        self.requests.close()
        self.answers.close()
        self._process.returncode = 0  # otherwise Python reports that it still runs

    def kill(self) -> None:
        """Kill the process, whatever it is doing."""
        if self.running:
            kill = partial(os.killpg, self._process.pid) if FORKS else self._process.send_signal
            kill(_KILL)
        self.end()

    def end(self) -> int:
        """Close the pipes, wait until the process ends, and return its exit status."""
        self.requests.close()
        self.answers.close()
        try:
            return self._process.wait(_ENDS_WITHIN)
        except subprocess.TimeoutExpired:  # a fork of this program keeps its input open
            self._process.kill()
            return self._process.wait()


_idle: list[_Process] = []


def _idle_process() -> _Process:
    """Return a process that is not reading anything."""
    with suppress(IndexError):  # several threads may take the processes
        while not (process := _idle.pop()).running:
            process.end()
        return process
    return _Process()


@atexit.register
def end_all() -> None:
    """End the processes that wait for files; the next file starts a new one."""
    while _idle:
        _idle.pop().end()


def _leave_all() -> None:
    """Leave the processes to the program from which this one was forked."""
    while _idle:
        _idle.pop().leave()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_leave_all)
