"""The websocket of a viewer: it carries messages about the run, and the viewer's commands."""

import asyncio
import json
from collections import deque
from contextlib import suppress
from time import monotonic

from starlette.responses import Response
from starlette.websockets import WebSocket, WebSocketDisconnect

from inercal.basics.errors import InercalError
from inercal.host.web.access import Access, client_host
from inercal.host.web.hub import Hub
from inercal.host.web.json_objects import RefusalLog, parse_object
from inercal.host.web.viewers import Client, Viewer

_MESSAGE_RATE = 20  # messages per second from a viewer
_HEARTBEAT_INTERVAL = 2.0  # s
_MAX_TAB = 64  # largest number of characters of the key that identifies a page
_CLOSING_TIME = 1.0  # s for the message to a viewer whose place was given to another


class LiveSocket:
    """Serves the websockets of the viewers.

    Parameters
    ----------
    hub : Hub
    access : Access
    refused : RefusalLog
    version : str
        Version of inercal, which each viewer is told first.
    """

    def __init__(self, hub: Hub, access: Access, refused: RefusalLog, version: str):
        self._hub, self._access = hub, access
        self._refusals, self._version = refused, version

    async def serve(self, websocket: WebSocket) -> None:
        """Serve the websocket of a viewer: send messages about the run, and execute commands."""
        who = client_host(websocket.scope)
        shown, answer = self._access.viewer(websocket.headers), Response()
        # A page that was opened before a restart of the server has an old cookie. A program has no
        # cookie.
        browser = shown or self._access.issue_viewer(websocket.headers, answer)
        tab = websocket.query_params.get("tab", "")[:_MAX_TAB] or None
        viewer = self._hub.add_viewer(self._version, browser, tab, Client(who, shown))
        if viewer is None:
            self._refusals(who, "websocket: too many viewers")
            await websocket.close()
            return
        tasks: list[asyncio.Task[None]] = []
        try:
            async with viewer.stay:
                cookies = [pair for pair in answer.raw_headers if pair[0] == b"set-cookie"]
                await websocket.accept(headers=cookies)
                tasks.append(asyncio.create_task(_send_messages(websocket, viewer)))
                tasks.append(asyncio.create_task(_send_heartbeats(viewer)))
                await self._receive_commands(websocket, viewer, who)
        except WebSocketDisconnect:
            pass
        except TimeoutError:
            if not viewer.stay.expired():
                raise
            self._refusals(who, f"viewer {viewer.number}: its place was given to another client")
            with suppress(TimeoutError, RuntimeError, WebSocketDisconnect):
                async with asyncio.timeout(_CLOSING_TIME):
                    await websocket.close(1013, "this client has too many viewers")
        finally:
            self._hub.remove_viewer(viewer)
            for task in tasks:
                task.cancel()
                with suppress(asyncio.CancelledError):
                    await task

    async def _receive_commands(self, websocket: WebSocket, viewer: Viewer, who: str) -> None:
        times: deque[float] = deque(maxlen=_MESSAGE_RATE + 1)
        while True:
            message = await websocket.receive()
            if message["type"] != "websocket.receive":
                return
            times.append(monotonic())
            if len(times) == times.maxlen and times[-1] - times[0] < 1.0:
                self._refusals(
                    who, f"viewer {viewer.number}: more than {_MESSAGE_RATE} messages per second"
                )
                await websocket.close(1008, "too many messages")
                return
            text = message.get("text")
            if text is None:
                self._refusals(who, f"viewer {viewer.number}: the message is not text")
                await websocket.close(1003, "text only")
                return
            try:
                requested = parse_object(text)
                if requested.get("do") == "seen":
                    viewer.acknowledge(requested.get("n"))
                else:
                    await self._hub.execute(viewer, requested)
            except (InercalError, ValueError) as error:
                is_said = isinstance(error, InercalError)
                words = str(error) if is_said else "the message is not a JSON object; send one"
                self._refusals(who, f"viewer {viewer.number}: {words}")
                viewer.send("refused", json.dumps({"kind": "refused", "words": words}))


async def _send_messages(websocket: WebSocket, viewer: Viewer) -> None:
    """Send the messages for a viewer, as fast as the viewer receives them."""
    with suppress(WebSocketDisconnect, RuntimeError):  # disconnected, or about to be
        while True:
            await websocket.send_text(await viewer.next_message())


async def _send_heartbeats(viewer: Viewer) -> None:
    """Send heartbeats; a page can then distinguish a dead connection from a run without news."""
    while True:
        await asyncio.sleep(_HEARTBEAT_INTERVAL)
        viewer.send("beat", '{"kind": "beat"}')
