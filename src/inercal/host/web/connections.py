"""How many may be connected, and for how long without asking anything.

The web server itself (uvicorn's `limit_concurrency`) answers requests beyond the number of
connections by 503. It waits without end for the first request of a connection, and for a client
that does not take its answer. So `ConnectionLimits`, as ASGI middleware, notes which clients have
asked for something, and closes the connections of the others when their time is over. Each
connection serves one request, as the answers say, or becomes a websocket.
"""

from asyncio import Transport
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
        self._begun: WeakKeyDictionary[Connection, float] = WeakKeyDictionary()

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Serve one request."""
        client = scope.get("client") or ("", 0)
        self._asked[client[0], client[1]] = scope["type"]
        await self._app(scope, receive, send)

    def close_overdue(self, connections: Collection[Connection]) -> None:
        """Close those that have asked nothing for too long, take too long or are too many."""
        now = monotonic()
        clients = {_client(one) for one in connections}
        self._asked = {who: kind for who, kind in self._asked.items() if who in clients}
        idle: list[Connection] = []
        for one in list(connections):
            age = now - self._begun.setdefault(one, now)
            kind = self._asked.get(_client(one))
            if kind == "http" and age > _REQUEST_TIMEOUT:
                self._close(one, f"took longer than {_REQUEST_TIMEOUT:g} s")
            elif kind is None and age > _IDLE_TIMEOUT:
                self._close(one, f"did not ask anything within {_IDLE_TIMEOUT:g} s")
            elif kind is None:
                idle.append(one)
        idle.sort(key=lambda one: self._begun[one], reverse=True)
        for one in idle[: max(len(connections) - MAX_CONNECTIONS, 0)]:
            self._close(one, f"there are {MAX_CONNECTIONS} connections")

    def _close(self, one: Connection, words: str) -> None:
        self._refusals(_client(one)[0], words)
        one.transport.abort()


def _client(one: Connection) -> _Client:
    """Return address and port at the other end, as a request's scope has them."""
    host, port = (one.transport.get_extra_info("peername") or ("", 0))[:2]
    return str(host), int(port)
