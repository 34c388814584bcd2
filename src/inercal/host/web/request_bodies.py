"""Bodies of requests, read up to a limit of size and time; few may be slow at once.

The page's own bodies come in one piece with the request. A body that comes in drops occupies a
place, and there are few: where more are waited for, the oldest of the client with the most gives
way. Another client's body, or one that is there at once, is read all the same.
"""

import asyncio
from collections import Counter

from starlette.datastructures import Headers
from starlette.types import Receive

MAX_BODY = 1 << 16  # bytes
_TIMEOUT = 10.0  # s for one
_MAX_WAITING = 16  # bodies that are waited for


class RequestRefused(Exception):
    """A request that is refused: the status of the answer, and why."""

    def __init__(self, status: int, words: str):
        super().__init__(words)
        self.status, self.words = status, words


class BodyReader:
    """Reads the bodies of requests, and gives up those that are too long, too slow or too many."""

    def __init__(self):
        self._waiting: dict[asyncio.Timeout, str] = {}  # the oldest first, with its client

    async def read(self, client: str, headers: Headers, receive: Receive) -> bytes:
        """Return the body of a client's request.

        Raises
        ------
        RequestRefused
            It is too long, or does not come in time.
        """
        # What it says of its length is believed only where that is too much.
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
                f"a body that does not come within {_TIMEOUT:g} s, or is the oldest of more than "
                f"{_MAX_WAITING}",
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
    return RequestRefused(413, f"a body of more than {MAX_BODY} bytes")
