"""Reads the bodies of requests with limits on size and time.

The bodies from the page arrive in one piece with the request. A body that arrives slowly occupies
one of a few places. If there are too many slow bodies, the oldest body of the client with the most
slow bodies is dropped. Bodies from other clients, and bodies that arrive at once, are still read.
"""

import asyncio
from collections import Counter

from starlette.datastructures import Headers
from starlette.types import Receive

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
