"""Logs refusals on standard error, with one line each and a limited rate."""

import logging
import sys
import traceback
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from time import monotonic

_MAX_BURST, _LINE_RATE = 20.0, 2.0  # lines
_MAX_TEXT = 300  # characters


def escape_control_characters(text: str) -> str:
    r"""Return a text from a client on one line, with control characters escaped.

    >>> escape_control_characters("a\nb\x1b[2J")
    'a\\nb\\x1b[2J'
    """
    result = "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in text)
    return result if len(result) <= _MAX_TEXT else f"{result[:_MAX_TEXT]}…"


class RefusalLog:
    """Logs refusals; if there are too many, only the number of the others is logged.

    Parameters
    ----------
    write : callable, optional
        Function that writes a line; by default, to standard error.
    now : callable, optional
        Function that returns the time, s.
    """

    def __init__(
        self, write: Callable[[str], None] | None = None, now: Callable[[], float] = monotonic
    ):
        self._write, self._now = write or _write_standard_error, now
        self._tokens, self._updated_at = _MAX_BURST, now()
        self._suppressed = 0

    def __call__(self, who: object, words: str) -> None:
        """Log a refusal."""
        at = self._now()
        self._tokens = min(_MAX_BURST, self._tokens + _LINE_RATE * (at - self._updated_at))
        self._updated_at = at
        if self._tokens < 1:
            self._suppressed += 1
            return
        self._tokens -= 1
        if self._suppressed:
            self._write(f"inercal: {self._suppressed} further refusals suppressed (rate limit)")
            self._suppressed = 0
        self._write(
            f"inercal: refused: {escape_control_characters(str(who))}: "
            f"{escape_control_characters(words)}"
        )


class RefusalHandler(logging.Handler):
    """Logs refusals and errors of the web server itself, with one line each."""

    def __init__(self, refused: RefusalLog):
        super().__init__(logging.WARNING)
        self._refusals = refused

    def emit(self, record: logging.LogRecord) -> None:
        """Write one record."""
        words = record.getMessage().strip()
        error = record.exc_info[1] if record.exc_info else None
        if error is not None:
            # Tracebacks are not written, because a client could fill the disk with them.
            frames = traceback.extract_tb(error.__traceback__)
            where = f" ({Path(frames[-1].filename).name}:{frames[-1].lineno})" if frames else ""
            words = f"{words}: {type(error).__name__}{where}: {error}"
        self._refusals("web server", words)


def _write_standard_error(line: str) -> None:
    with suppress(OSError):  # the terminal may be gone
        print(line, file=sys.stderr, flush=True)
