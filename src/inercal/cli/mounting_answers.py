"""An operator who confirms mountings by lines of standard input, where it is no terminal.

A line is `mounted`, or `mounted NAME`; any other line confirms nothing. A line is read when a
mounting is requested, so that a file can hold the answers for all mountings of a run.
"""

import os
import sys
from collections.abc import Generator
from contextlib import contextmanager
from getpass import getuser
from select import select
from threading import Event, Thread
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from inercal.host.bench_run import BenchRun

_POLL_INTERVAL = 0.05  # s
WORD = "mounted"


def operator_name(given: str) -> str:
    """Return the name of who operates: as given, else that of the system's user."""
    try:
        return given or getuser()
    except (KeyError, OSError):  # a user without a name
        return f"user {os.getuid()}"


@contextmanager
def answer_by_lines(run: "BenchRun", operator: str) -> Generator[None]:
    """Confirm the mountings of a run by the lines of standard input."""
    ended = Event()
    thread = Thread(target=_answer, args=(run, operator, ended), daemon=True)
    thread.start()
    try:
        yield
    finally:
        ended.set()
        thread.join()


def _answer(run: "BenchRun", operator: str, ended: Event) -> None:
    buffer, descriptor = b"", sys.stdin.fileno()
    while not ended.wait(_POLL_INTERVAL):
        if (request := run.mounting_request) is None:
            continue
        while b"\n" not in buffer and not ended.is_set():
            # Not by sys.stdin: it buffers all waiting bytes, which select does not see.
            if not select([descriptor], [], [], _POLL_INTERVAL)[0]:
                continue
            data = os.read(descriptor, 4096)
            if not data:
                _say("standard input has ended, and nobody confirms the mounting: the run stops")
                return run.request("stop")
            buffer += data
        line, _, buffer = buffer.partition(b"\n")
        word, _, name = line.decode("utf-8", "replace").strip().partition(" ")
        if word == WORD:
            run.confirm_mounting(request.number, name.strip() or operator)
            while not ended.is_set() and run.mounting_request == request:
                ended.wait(_POLL_INTERVAL)
        elif not ended.is_set():
            _say(f"{word!r} does not confirm that the sensor is mounted as {request.mounting}; "
                 f"type {WORD} or {WORD} NAME")  # fmt: skip


def _say(words: str) -> None:
    print(f"inercal: {words}", file=sys.stderr, flush=True)
