"""How many may be connected, and for how long without asking anything.

The web server itself (uvicorn) waits without end for the first request of a connection, and for a
client that does not take its answer. Its own limit of connections would refuse whoever comes last.
So `ConnectionLimits`, as ASGI middleware, notes which clients have asked for something, and closes
the connections of the others when their time is over. Where there are too many, those of the
address with most give way: first the ones that have asked nothing, then requests, always the
oldest, since a request of a page is answered long before it is that; none of them before it was
there for a `CHECK_INTERVAL`. Websockets are viewers, whose
number has a limit of its own. Each connection serves one request, as the answers say, or becomes a
websocket.
"""

from asyncio import Transport
from collections import defaultdict
from collections.abc import Collection
from time import monotonic
from typing import Protocol
from weakref import WeakKeyDictionary

from starlette.types import ASGIApp, Receive, Scope, Send

from inercal.host.web.refusal_log import RefusalLog

MAX_CONNECTIONS = 256  # connections, those of viewers with them
CHECK_INTERVAL = 0.1  # s
_IDLE_TIMEOUT, _REQUEST_TIMEOUT = 10.0, 120.0  # s without a request, and for one with its answer

_Client = tuple[str, int]


class Connection(Protocol):
    """What the web server has of one connection."""

    transport: Transport


class ConnectionLimits:
    """An ASGI application that knows who has asked for something.

    Parameters
    ----------
    app : ASGI application
    refused : RefusalLog
    """

    def __init__(self, app: ASGIApp, refused: RefusalLog):
        self._app, self._refusals = app, refused
        self._asked: dict[_Client, str] = {}  # and whether by "http" or "websocket"
        self._ended: dict[_Client, float] = {}  # when a websocket was
        self._begun: WeakKeyDictionary[Connection, float] = WeakKeyDictionary()

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Serve one request."""
        host, port = scope.get("client") or ("", 0)
        self._asked[host, port] = scope["type"]
        try:
            await self._app(scope, receive, send)
        finally:
            if scope["type"] == "websocket":
                self._ended[host, port] = monotonic()

    def close_overdue(self, connections: Collection[Connection]) -> None:
        """Close those that have asked nothing for too long, take too long or are too many."""
        now = monotonic()
        clients = {_client(one) for one in connections}
        self._asked = {who: kind for who, kind in self._asked.items() if who in clients}
        self._ended = {who: at for who, at in self._ended.items() if who in clients}
        waiting: defaultdict[str, list[Connection]] = defaultdict(list)
        for one in list(connections):
            who = _client(one)
            age = now - self._begun.setdefault(one, now)
            kind = self._asked.get(who)
            if kind == "http" and age > _REQUEST_TIMEOUT:
                self._close(one, f"took longer than {_REQUEST_TIMEOUT:g} s")
            elif kind is None and age > _IDLE_TIMEOUT:
                self._close(one, f"did not ask anything within {_IDLE_TIMEOUT:g} s")
            elif kind == "websocket" and now - self._ended.get(who, now) > _IDLE_TIMEOUT:
                self._close(one, f"does not close its websocket within {_IDLE_TIMEOUT:g} s")
            elif kind != "websocket" and age:  # those of this moment may ask or be answered yet
                waiting[who[0]].append(one)
        for those in waiting.values():  # who gives way first stands last
            those.sort(key=lambda one: (self._asked.get(_client(one)) is None, -self._begun[one]))
        surplus = min(len(connections) - MAX_CONNECTIONS, sum(map(len, waiting.values())))
        for _ in range(surplus):
            most = max(waiting.values(), key=len)
            self._close(most.pop(), f"there are {MAX_CONNECTIONS} connections")

    def _close(self, one: Connection, words: str) -> None:
        self._refusals(_client(one)[0], words)
        one.transport.abort()


def _client(one: Connection) -> _Client:
    """Return address and port at the other end, as a request's scope has them."""
    host, port = (one.transport.get_extra_info("peername") or ("", 0))[:2]
    return str(host), int(port)
