"""Confirmations of the mountings of a run when standard input is no terminal.

A line `mounted NAME` or `mounted NAME OPERATOR` confirms that the sensor is mounted as requested.
A line of standard input counts only if it comes after the request; one of an answer file confirms
one request for its mounting, whenever that comes. Any other line confirms nothing.
"""

import os
import sys
from collections.abc import Generator, Sequence
from contextlib import contextmanager
from getpass import getuser
from pathlib import Path
from select import select
from threading import Event, Thread
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from inercal.host.bench_run import BenchRun
    from inercal.host.mounting_prompt import MountingRequest

_POLL_INTERVAL = 0.05  # s
_CHUNK = 4096  # bytes
WORD = "mounted"


class Answer(NamedTuple):
    """A confirmation: the mounting, and who confirms it; empty where that is not said."""

    mounting: str
    operator: str


def operator_name(given: str) -> str:
    """Return the name of who operates: as given, else that of the system's user."""
    try:
        return given or getuser()
    except (KeyError, OSError):  # a user without a name
        return f"user {os.getuid()}"


def read_answers(path: Path) -> list[Answer]:
    """Return the confirmations of an answer file.

    Raises
    ------
    InputError
        The file cannot be read, or has a line that is no confirmation.
    """
    from inercal.errors import InputError
    from inercal.small_files import read_small_file

    text = read_small_file(path, "answer file").decode("utf-8-sig", "replace")
    answers: list[Answer] = []
    for number, line in enumerate(text.splitlines(), 1):
        if not line.strip() or line.lstrip().startswith("#"):
            continue
        if (answer := _parse(line)) is None:
            raise InputError(
                f"{path} line {number}: {line.strip()!r} confirms no mounting; write "
                f"'{WORD} NAME' or '{WORD} NAME OPERATOR'",
                file=path,
                line=number,
            )
        answers.append(answer)
    return answers


@contextmanager
def answer_mountings(run: "BenchRun", operator: str, answers: Path | None) -> Generator[None]:
    """Confirm the mountings of a run by an answer file, else by lines of standard input."""
    ended = Event()
    source = _Lines(ended) if answers is None else _AnswerFile(answers, read_answers(answers))
    thread = Thread(target=_answer, args=(run, operator, source, ended), daemon=True)
    thread.start()
    try:
        yield
    finally:
        ended.set()
        thread.join()


def _answer(run: "BenchRun", operator: str, source: "_Lines | _AnswerFile", ended: Event) -> None:
    while not ended.wait(_POLL_INTERVAL):
        if (request := run.mounting_request) is None:
            continue
        answer = source.answer(request)
        if answer is None:
            if not ended.is_set():
                _say(f"{source.gone}, and nobody confirms the mounting: the run stops")
                run.request("stop")
            return
        run.confirm_mounting(request.number, f"{answer.operator or operator}{source.origin}")
        while not ended.is_set() and run.mounting_request == request:
            ended.wait(_POLL_INTERVAL)


class _AnswerFile:
    """The confirmations of a file, each of which is used once."""

    def __init__(self, path: Path, answers: Sequence[Answer]):
        self.gone = f"{path} has no line '{WORD} …' left for this mounting"
        self.origin = f" (by {path.name})"
        self._left = list(answers)

    def answer(self, request: "MountingRequest") -> Answer | None:
        """Return the next confirmation of the requested mounting; None where there is none."""
        for answer in self._left:
            if answer.mounting == request.mounting:
                self._left.remove(answer)
                return answer
        return None


class _Lines:
    """Lines of standard input, each read after the request that it confirms."""

    gone, origin = "standard input has ended", ""

    def __init__(self, ended: Event):
        # Not by sys.stdin: it buffers all waiting bytes, which select does not see.
        self._descriptor, self._buffer, self._ended = sys.stdin.fileno(), b"", ended
        self._at_end = False

    def answer(self, request: "MountingRequest") -> Answer | None:
        """Return the confirmation of the requested mounting; None at the end of the input."""
        self._drop_earlier_lines()
        while (line := self._line()) is not None:
            answer = _parse(line)
            if answer is not None and answer.mounting == request.mounting:
                return answer
            _say(f"{line.strip()!r} does not confirm that the sensor is mounted as "
                 f"{request.mounting}; type {WORD} {request.mounting}")  # fmt: skip
        return None

    def _drop_earlier_lines(self) -> None:
        while not self._at_end and select([self._descriptor], [], [], 0)[0]:
            self._read()
        dropped, self._buffer = self._buffer, b""
        if dropped.strip():
            _say(f"{len(dropped.splitlines())} lines came before the mounting was requested and "
                 "were dropped")  # fmt: skip

    def _line(self) -> str | None:
        while b"\n" not in self._buffer:
            if self._at_end or self._ended.is_set():
                return None
            if select([self._descriptor], [], [], _POLL_INTERVAL)[0]:
                self._read()
        line, _, self._buffer = self._buffer.partition(b"\n")
        return line.decode("utf-8", "replace")

    def _read(self) -> None:
        data = os.read(self._descriptor, _CHUNK)
        self._at_end = not data
        self._buffer += data


def _parse(line: str) -> Answer | None:
    """Return the confirmation that a line states; None if it states none."""
    word, *rest = line.split(maxsplit=2)[:3] if line.strip() else [""]
    if word != WORD or not rest:
        return None
    return Answer(rest[0], rest[1].strip() if len(rest) > 1 else "")


def _say(words: str) -> None:
    print(f"inercal: {words}", file=sys.stderr, flush=True)
