"""Read the confirmations of a run's mountings from typed lines, standard input or an answer file.

A line `mounted NAME` or `mounted NAME OPERATOR` confirms that the sensor is mounted as requested.
A line on standard input counts only if it comes after the request. A line in an answer file
confirms one request for its mounting, no matter when the request comes. Any other line confirms
nothing.
"""

import os
import sys
from collections.abc import Callable, Generator, Sequence
from contextlib import contextmanager
from pathlib import Path
from select import select
from threading import Event, Lock, Thread
from typing import TYPE_CHECKING, NamedTuple

from inercal.basics.errors import InputError
from inercal.cli.console import report_line

if TYPE_CHECKING:
    from inercal.host.bench_run import BenchRun
    from inercal.host.spin_sequencer import MountingRequest

_POLL_INTERVAL = 0.05  # s
_CHUNK = 4096  # bytes
WORD = "mounted"
_ENTER, _ERASE, _MAX_LINE = "\r\n", "\b\x7f", 120
_ESCAPE, _BEGINNING = "\x1b", f"{WORD} "


class Answer(NamedTuple):
    """A confirmation: the mounting and the person who confirms it (empty if not stated)."""

    mounting: str
    operator: str


def read_answers(path: Path) -> list[Answer]:
    """Read the confirmations in an answer file.

    Raises
    ------
    InputError
        The file cannot be read, or a line is not a confirmation.
    """
    from inercal.basics.small_files import read_small_file

    text = read_small_file(path, "answer file").decode("utf-8-sig", "replace")
    answers: list[Answer] = []
    for number, line in enumerate(text.splitlines(), 1):
        if not line.strip() or line.lstrip().startswith("#"):
            continue
        if (answer := parse_answer(line)) is None:
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
    """Confirm a run's mountings from an answer file, or else from lines of standard input."""
    ended = Event()
    source = _Lines() if answers is None else _AnswerFile(answers, read_answers(answers))
    run.call_before_request(source.drop_earlier)
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

        def waits(request: "MountingRequest" = request) -> bool:
            return not ended.is_set() and run.mounting_request == request

        if (answer := source.answer(request, waits)) is not None:
            by = f"{answer.operator or operator}{source.origin}"
            run.confirm_mounting(request.number, answer.mounting, by)
            while waits():
                ended.wait(_POLL_INTERVAL)
        elif waits():
            report_line(f"{source.gone}, so nobody can confirm the mounting: the run stops")
            run.request("stop")
            return


class _AnswerFile:
    """The confirmations in an answer file, each of which is used once."""

    def __init__(self, path: Path, answers: Sequence[Answer]):
        self.gone = f"{path} has no further line '{WORD} …' for this mounting"
        self.origin = f" (by {path.name})"
        self._left = list(answers)

    def drop_earlier(self) -> None:
        """Do nothing, because an answer in a file counts no matter when the request comes."""

    def answer(self, request: "MountingRequest", _: Callable[[], bool]) -> Answer | None:
        """Return the next confirmation of the requested mounting; None if there is none."""
        for answer in self._left:
            if answer.mounting == request.mounting:
                self._left.remove(answer)
                return answer
        return None


class _Lines:
    """Confirmations from standard input, which count only if they come after the request."""

    gone, origin = "standard input has ended", ""

    def __init__(self):
        # Not by sys.stdin: it buffers all waiting bytes, which select does not see.
        self._descriptor, self._buffer, self._at_end = sys.stdin.fileno(), b"", False
        # Shared by the reading thread and the run's thread, which discards lines.
        self._lock = Lock()

    def drop_earlier(self) -> None:
        """Discard all input received so far, including an incomplete line."""
        with self._lock:
            while not self._at_end and select([self._descriptor], [], [], 0)[0]:
                self._read()
            dropped, self._buffer = self._buffer, b""
        if count := len(dropped.splitlines()):
            report_line(
                f"lines that came before the mounting was requested were discarded: {count}"
            )

    def answer(self, request: "MountingRequest", waits: Callable[[], bool]) -> Answer | None:
        """Wait for a line that confirms the requested mounting, and return it.

        Return None at the end of the input, or if the request is no longer waiting.
        """
        while waits():
            select([self._descriptor], [], [], 0 if self._at_end else _POLL_INTERVAL)
            with self._lock:
                if not self._at_end and select([self._descriptor], [], [], 0)[0]:
                    self._read()
                if b"\n" not in self._buffer:
                    if self._at_end:
                        return None
                    continue
                data, _, self._buffer = self._buffer.partition(b"\n")
            line = data.decode("utf-8", "replace")
            answer = parse_answer(line)
            if answer is not None and answer.mounting == request.mounting:
                return answer
            report_line(mismatch_text(line, request))
        return None

    def _read(self) -> None:
        data = os.read(self._descriptor, _CHUNK)
        self._at_end = not data
        self._buffer += data


def parse_answer(line: str) -> Answer | None:
    """Return the confirmation stated in a line, or None if there is none."""
    word, *rest = line.split(maxsplit=2)[:3] if line.strip() else [""]
    if word != WORD or not rest:
        return None
    return Answer(rest[0], rest[1].strip() if len(rest) > 1 else "")


def mismatch_text(line: str, request: "MountingRequest") -> str:
    """Return the message about a line that does not confirm the requested mounting."""
    return (
        f"{line.strip()!r} does not confirm that the sensor is mounted as {request.mounting}; type "
        f"{WORD} {request.mounting}"
    )


class TypedConfirmation:
    """Collector for the characters of a line `mounted NAME` or `mounted NAME OPERATOR`.

    The line counts for the request that was published when its first character was typed.

    Attributes
    ----------
    text : str
        Characters typed so far.
    """

    def __init__(self):
        self.text = ""
        self._request: MountingRequest | None = None

    def take(self, character: str, run: "BenchRun", operator: str) -> bool:
        """Add a character, and return False if it does not belong to such a line.

        Parameters
        ----------
        character : str
        run : BenchRun
        operator : str
            Name of the person who confirms if the line contains no name.
        """
        begun = self.text + character
        if character not in _ENTER + _ERASE and not (
            begun.startswith(_BEGINNING) or _BEGINNING.startswith(begun)
        ):
            self.text = ""  # not such a line, for example if a key was pressed twice
        if not self.text:
            if character != _BEGINNING[0]:
                return False
            self._request = run.mounting_request
        if character in _ENTER:
            line, self.text = self.text, ""
            self._confirm(line, run, operator)
        elif character == _ESCAPE:
            self.text = ""
        elif character in _ERASE:
            self.text = self.text[:-1]
        elif character.isprintable() and len(self.text) < _MAX_LINE:
            self.text += character
        return True

    def _confirm(self, line: str, run: "BenchRun", operator: str) -> None:
        request = self._request
        if request is None or run.mounting_request != request:
            report_line(
                f"{line!r} was started before the mounting was requested, so it confirms nothing"
            )
            return
        answer = parse_answer(line)
        if answer is None or answer.mounting != request.mounting:
            report_line(mismatch_text(line, request))
            return
        run.confirm_mounting(request.number, answer.mounting, answer.operator or operator)
