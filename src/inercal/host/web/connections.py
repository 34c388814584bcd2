"""How many may be connected, and for how long without asking anything."""

import asyncio
from typing import Any

import h11
from uvicorn.protocols.http.h11_impl import H11Protocol

from inercal.host.web.refusal_log import RefusalLog

MAX_CONNECTIONS = 256  # connections, those of viewers with them
_IDLE_TIMEOUT, _REQUEST_TIMEOUT = 10.0, 120.0  # s without a request, and for one with its answer


def limited_protocol(refused: RefusalLog) -> type[H11Protocol]:
    """Return the web server's side of a connection, with these limits."""

    class LimitedProtocol(H11Protocol):
        """A connection of HTTP that may become one of a websocket."""

        def __init__(self, *args: Any, **kwargs: Any):
            super().__init__(*args, **kwargs)
            self._timers: list[asyncio.TimerHandle] = []

        def connection_made(self, transport: asyncio.Transport) -> None:  # pyright: ignore[reportIncompatibleMethodOverride]
            """Take the connection, or close it at once."""
            if len(self.connections) >= MAX_CONNECTIONS:
                self.transport = transport
                refused(
                    transport.get_extra_info("peername"), f"there are {MAX_CONNECTIONS} connections"
                )
                transport.abort()
                return
            super().connection_made(transport)
            self._timers = [
                self.loop.call_later(_IDLE_TIMEOUT, self._require_request),
                self.loop.call_later(
                    _REQUEST_TIMEOUT, self._abort, f"took longer than {_REQUEST_TIMEOUT:g} s"
                ),
            ]

        def connection_lost(self, exc: Exception | None) -> None:
            """Forget the connection."""
            self._cancel_timers()
            super().connection_lost(exc)

        def handle_websocket_upgrade(self, event: h11.Request) -> None:
            """Leave the connection to the websocket."""
            self._cancel_timers()
            super().handle_websocket_upgrade(event)

        def _require_request(self) -> None:
            if self.cycle is None:  # pyright: ignore[reportUnnecessaryComparison]
                self._abort(f"did not ask anything within {_IDLE_TIMEOUT:g} s")

        def _abort(self, words: str) -> None:
            refused(self.client, words)
            self.transport.abort()

        def _cancel_timers(self) -> None:
            for timer in self._timers:
                timer.cancel()

    return LimitedProtocol
