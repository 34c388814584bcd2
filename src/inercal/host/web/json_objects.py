"""Reads requests from a page, with limits on size and time: JSON objects that are not trusted.

Refusals are logged on standard error, with one line each and a limited rate.

The bodies from the page arrive in one piece with the request. A body that arrives slowly occupies
one of a few places. If there are too many slow bodies, the oldest body of the client with the most
slow bodies is dropped. Bodies from other clients, and bodies that arrive at once, are still read.
"""

import asyncio
import json
import logging
import sys
import traceback
from collections import Counter
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path
from time import monotonic
from typing import Any, cast

from starlette.datastructures import Headers
from starlette.types import Receive

from inercal.basics.errors import InputError

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


JsonObject = Mapping[str, Any]
_AMBIENT_RANGE = (-90.0, 100.0)  # °C


def parse_object(text: str | bytes) -> JsonObject:
    """Convert a text to a JSON object.

    Raises
    ------
    ValueError
        The text is not a JSON object.
    """
    try:
        result = object_or_none(json.loads(text))
    except RecursionError:
        result = None
    if result is None:
        raise ValueError("the message is not a JSON object; send one")
    # JSON can contain half of a surrogate pair, which files, databases and replies cannot
    # represent.
    json.dumps(result, ensure_ascii=False).encode()
    return result


def object_or_none(value: object) -> JsonObject | None:
    """Return a value if it is a JSON object, and None otherwise."""
    return cast("JsonObject", value) if isinstance(value, Mapping) else None


def printable_line(text: object, most: int) -> str | None:
    """Return a typed text without outer spaces; None if it is not a printable line."""
    if not isinstance(text, str) or not text.isprintable():
        return None
    return text.strip() if 0 < len(text.strip()) <= most else None


def ambient_temperature(asked: object) -> float | None:
    """Return the room temperature that the operator typed, °C; None if the field is empty.

    Raises
    ------
    InputError
        The value is not a possible temperature.
    """
    low, high = _AMBIENT_RANGE
    if asked is None:
        return None
    if not isinstance(asked, (int, float)) or isinstance(asked, bool) or not low <= asked <= high:
        raise InputError(
            f"the ambient temperature {str(asked)[:40]!r} is not possible; give a number from "
            f"{low:g} to {high:g} °C",
            key="ambient",
        )
    return float(asked)


MAX_BODY = 1 << 16  # bytes
_TIMEOUT = 10.0  # s for one body
_MAX_WAITING = 16  # largest number of incomplete bodies at a time


class RequestRefused(Exception):
    """A refused request, with the status code of the answer and the reason."""

    def __init__(self, status: int, words: str):
        super().__init__(words)
        self.status, self.words = status, words


class BodyReader:
    """Reads the bodies of requests, and drops bodies that are too long, slow or numerous."""

    def __init__(self):
        self._waiting: dict[asyncio.Timeout, str] = {}  # client of each body, oldest first

    async def read(self, client: str, headers: Headers, receive: Receive) -> bytes:
        """Return the body of a client's request.

        Raises
        ------
        RequestRefused
            The body is too long, or does not arrive in time.
        """
        # The stated length is only used to refuse a body that is too long.
        said = headers.get("content-length", "0")
        if not said.isdecimal() or len(said) > 9 or int(said) > MAX_BODY:
            raise _too_long()
        limit = asyncio.timeout(_TIMEOUT)
        try:
            async with limit:
                self._waiting[limit] = client
                self._make_room()
                return await _read(receive)
        except TimeoutError:
            raise RequestRefused(
                408,
                f"the body did not arrive within {_TIMEOUT:g} s, or it was the oldest of more than "
                f"{_MAX_WAITING} incomplete ones",
            ) from None
        finally:
            self._waiting.pop(limit, None)

    def _make_room(self) -> None:
        if len(self._waiting) <= _MAX_WAITING:
            return
        ((client, _),) = Counter(self._waiting.values()).most_common(1)
        oldest = next(limit for limit, who in self._waiting.items() if who == client)
        del self._waiting[oldest]
        oldest.reschedule(asyncio.get_running_loop().time())


async def _read(receive: Receive) -> bytes:
    body, more = b"", True
    while more:
        message = await receive()
        if message["type"] == "http.disconnect":
            return body
        body += message.get("body", b"")
        more = message.get("more_body", False)
        if len(body) > MAX_BODY:
            raise _too_long()
    return body


def _too_long() -> RequestRefused:
    return RequestRefused(413, f"the body is longer than {MAX_BODY} bytes")
