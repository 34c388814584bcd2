"""Run the process that reads files for another process (see `isolation`).

On Linux it forks for each file, so imported modules stay loaded and each file gets a fresh process
with all of its memory and time. Forking is safe because nothing else runs in this process. If a
forked process dies, this process ends with an exit status that gives the reason.
"""

import os
import signal
import warnings
from collections.abc import Iterator
from contextlib import suppress
from errno import ENOMEM
from importlib import import_module
from io import FileIO
from typing import Any, cast

from inercal.basics.errors import InercalError
from inercal.recordings.io.damaged_files import refuse_damage
from inercal.recordings.io.isolation import FORKS, ReadingLimits, ReadingRequest, receive, send

_INPUT, _OUTPUT = 0, 1
_SIGNALLED = 128  # plus the signal number, as in shells


def serve() -> None:
    """Answer the requests on standard input until it ends."""
    requests, answers = FileIO(_INPUT, "r"), FileIO(os.dup(_OUTPUT), "w")
    os.dup2(os.open(os.devnull, os.O_WRONLY), _OUTPUT)  # discard what libraries print
    warnings.simplefilter("ignore")
    while True:
        try:
            request: ReadingRequest = receive(requests)
        except EOFError:
            os._exit(0)
        for name in request.isolation.libraries:
            with suppress(Exception):  # the reader reports what is missing
                import_module(name)
        if not FORKS:
            _answer(request, answers)
            os._exit(0)
        if (process := os.fork()) == 0:
            try:
                _answer(request, answers)
                os._exit(0)
            finally:
                os._exit(1)
        status = os.waitstatus_to_exitcode(os.waitpid(process, 0)[1])
        if status:
            os._exit(_SIGNALLED - status if status < 0 else status)


def _answer(request: ReadingRequest, answers: FileIO) -> None:
    """Send the results of a request's function, or the error that it raises."""
    isolation, path = request.isolation, request.path
    _set_limits(request.limits)
    try:
        with refuse_damage(path, isolation.kind, isolation.advice):
            found: Any = request.function(path, *request.arguments)
            results = cast(Iterator[Any], found) if isinstance(found, Iterator) else (found,)
            for result in results:
                _set_alarm(0)
                send(answers, (result,))
                _set_alarm(request.limits.waited)
    except (InercalError, ImportError, OSError, MemoryError) as error:
        _set_alarm(0)
        of_memory = isinstance(error, MemoryError) or getattr(error, "errno", None) == ENOMEM
        send(answers, MemoryError() if of_memory else error)
    else:
        send(answers, None)


def _set_limits(limits: ReadingLimits) -> None:
    """Limit the memory and time of this process, if the system supports it."""
    _set_alarm(limits.waited)
    with suppress(ImportError):
        resource: Any = import_module("resource")
        used = resource.getrusage(resource.RUSAGE_SELF)
        seconds = int(used.ru_utime + used.ru_stime) + limits.seconds
        _set_limit(resource, resource.RLIMIT_CORE, 0)
        _set_limit(resource, resource.RLIMIT_CPU, seconds)
        with suppress(OSError):  # on systems other than Linux, its own size is not known
            with open("/proc/self/statm", encoding="ascii") as file:
                size = int(file.read().split()[0]) * resource.getpagesize()
            _set_limit(resource, resource.RLIMIT_AS, size + limits.memory)


def _set_limit(resource: Any, kind: int, value: int) -> None:
    most = resource.getrlimit(kind)[1]
    resource.setrlimit(kind, (value if most == resource.RLIM_INFINITY else min(value, most), most))


def _set_alarm(seconds: int) -> None:
    """Let the system end this process after this many seconds; 0 cancels the alarm."""
    if hasattr(signal, "alarm"):
        signal.alarm(seconds)
