"""How many may be connected, and for how long without asking anything."""

import asyncio
from typing import Any

import h11
from uvicorn.protocols.http.h11_impl import H11Protocol

from inercal.host.web.refusal_log import RefusalLog

MOST = 256  # connections, those of viewers with them
_SILENT, _LONGEST = 10.0, 120.0  # s without a request, and for one with its answer


def limited(refused: RefusalLog) -> type[H11Protocol]:
    """Return the web server's side of a connection, with these limits."""

    class Limited(H11Protocol):
        """A connection of HTTP that may become one of a websocket."""

        def __init__(self, *args: Any, **kwargs: Any):
            super().__init__(*args, **kwargs)
            self._timers: list[asyncio.TimerHandle] = []

        def connection_made(self, transport: asyncio.Transport) -> None:  # pyright: ignore[reportIncompatibleMethodOverride]
            """Take the connection, or close it at once."""
            if len(self.connections) >= MOST:
                self.transport = transport
                refused(transport.get_extra_info("peername"), f"there are {MOST} connections")
                transport.abort()
                return
            super().connection_made(transport)
            self._timers = [
                self.loop.call_later(_SILENT, self._see_request),
                self.loop.call_later(_LONGEST, self._end, f"took longer than {_LONGEST:g} s"),
            ]

        def connection_lost(self, exc: Exception | None) -> None:
            """Forget the connection."""
            self._let_be()
            super().connection_lost(exc)

        def handle_websocket_upgrade(self, event: h11.Request) -> None:
            """Leave the connection to the websocket."""
            self._let_be()
            super().handle_websocket_upgrade(event)

        def _see_request(self) -> None:
            if self.cycle is None:  # pyright: ignore[reportUnnecessaryComparison]
                self._end(f"did not ask anything within {_SILENT:g} s")

        def _end(self, words: str) -> None:
            refused(self.client, words)
            self.transport.abort()

        def _let_be(self) -> None:
            for timer in self._timers:
                timer.cancel()

    return Limited
