"""The page before a server that says what a test tells it to say, and keeps what it hears."""

import asyncio
import json
import socket
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from pathlib import Path
from threading import Condition, Thread
from time import monotonic
from typing import Any, Self

import uvicorn
from starlette.applications import Starlette
from starlette.middleware import Middleware
from starlette.requests import Request
from starlette.responses import HTMLResponse, JSONResponse, Response
from starlette.routing import Mount, Route, WebSocketRoute
from starlette.staticfiles import StaticFiles
from starlette.types import ASGIApp, Receive, Scope, Send
from starlette.websockets import WebSocket, WebSocketDisconnect
from tests.browser.messages import Message, setup

STATIC = Path(__file__).parents[2] / "src" / "inercal" / "host" / "web" / "static"
PATIENCE = 20.0  # s
BEAT = 2.0  # s
POLICY = b"default-src 'self'"


class ScriptedServer:
    """A server on a thread; a context manager.

    Attributes
    ----------
    address : str
        Of the page.
    setup : dict
        What `/api/setup` says.
    probed : dict
        What the probe answers.
    heard : list of dict
        Commands and probes, in order.
    says : list of dict
        What a client is told that connects, after "hello" and "people".
    away : bool
        Connections are refused.
    hangs : bool
        Connections are neither taken nor refused.
    mute : bool
        No beats are sent, as over a connection that broke without a word.
    operator : str or None
    """

    def __init__(self):
        self._sockets: list[WebSocket] = []
        self._changed = Condition()
        self.forget()
        self._loop: asyncio.AbstractEventLoop | None = None
        routes = [
            Route("/", self._page),
            Route("/api/setup", self._setup),
            Route("/api/probe", self._probe, methods=["POST"]),
            Route("/runs/{run}/{what}", self._file),
            Route("/history/{sensor}", self._file),
            WebSocketRoute("/live", self._live),
            Mount("/static", StaticFiles(directory=STATIC)),
        ]
        app = Starlette(routes=routes, middleware=[Middleware(_PolicyMiddleware)])
        config = uvicorn.Config(app, log_level="critical", ws="websockets-sansio", lifespan="off")
        self._server = uvicorn.Server(config)
        self._listens = socket.create_server(("127.0.0.1", 0))
        self.address = f"http://127.0.0.1:{self._listens.getsockname()[1]}/"
        self._thread = Thread(target=self._server.run, args=([self._listens],), daemon=True)

    def forget(self) -> None:
        """Wait until nobody is connected, and be as at the beginning."""
        end = monotonic() + PATIENCE
        with self._changed:
            while self._sockets:
                assert monotonic() < end, "a page is still connected"
                self._changed.wait(0.01)
        self.setup: dict[str, Any] = setup()
        self.probed: dict[str, Any] = {}
        self.heard: list[dict[str, Any]] = []
        self.says: list[Message] = [{"kind": "idle"}]
        self.away = self.hangs = self.mute = False
        self.operator: str | None = None
        self._operates: WebSocket | None = None
        self._seat = ""  # the page that operates, or may be back

    def tell(self, *messages: Message, kept: bool = True) -> None:
        """Tell all clients, and by default those that will connect later too."""
        if kept:
            self.says.extend(messages)
        self._on_loop(partial(self._send, messages))

    def drop(self) -> None:
        """End all connections."""
        self._on_loop(self._drop)

    def hand_over(self, operator: str) -> None:
        """Have somebody else operate."""
        self.operator, self._operates, self._seat = operator, None, ""

    def people(self) -> None:
        """Tell all clients who operates."""
        self._on_loop(self._people)

    def wait_for(self, wanted: Callable[[dict[str, Any]], bool]) -> dict[str, Any]:
        """Wait for a command, and return it."""
        end = monotonic() + PATIENCE
        with self._changed:
            while True:
                for command in self.heard:
                    if wanted(command):
                        return command
                left = end - monotonic()
                assert left > 0, f"not heard; but {self.heard}"
                self._changed.wait(left)

    def order(self, do: str) -> dict[str, Any]:
        """Wait for a command of that name."""
        return self.wait_for(lambda command: command.get("do") == do)

    def __enter__(self) -> Self:
        self._thread.start()
        end = monotonic() + PATIENCE
        with self._changed:
            while not self._server.started:
                assert monotonic() < end, "the scripted server does not start"
                self._changed.wait(0.01)
        return self

    def __exit__(self, *_: object) -> None:
        self._server.should_exit = self._server.force_exit = True
        self._thread.join(PATIENCE)
        self._listens.close()

    def _on_loop(self, what: Callable[[], Any]) -> None:
        assert self._loop is not None, "nobody has connected yet"
        asyncio.run_coroutine_threadsafe(what(), self._loop).result(PATIENCE)

    def _keep(self, heard: dict[str, Any]) -> None:
        with self._changed:
            self.heard.append(heard)
            self._changed.notify_all()

    async def _send(self, messages: tuple[Message, ...]) -> None:
        for message in messages:
            for one in list(self._sockets):
                with suppress(WebSocketDisconnect):  # one that has just gone
                    await one.send_text(json.dumps(message))

    async def _drop(self) -> None:
        for one in list(self._sockets):
            await one.close(1012)

    async def _people(self) -> None:
        for one in list(self._sockets):
            await self._who(one)

    async def _who(self, one: WebSocket) -> None:
        yours = one is self._operates
        said = {"viewers": len(self._sockets), "operator": self.operator, "yours": yours}
        with suppress(WebSocketDisconnect):
            await one.send_text(json.dumps({"kind": "people", **said}))

    async def _live(self, one: WebSocket) -> None:
        self._loop = asyncio.get_running_loop()
        if self.away:
            return await one.close(1013)
        while self.hangs:
            await asyncio.sleep(0.05)
        await one.accept()
        await one.send_text(json.dumps({"kind": "hello", "version": "0.1.0"}))
        self._sockets.append(one)
        tab = one.query_params.get("tab", "")
        if tab and tab == self._seat:
            self._operates = one
        await self._people()
        for message in list(self.says):
            await one.send_text(json.dumps(message))
        beating = asyncio.create_task(self._beat(one))
        try:
            while True:
                await self._hear(one, json.loads(await one.receive_text()))
        except WebSocketDisconnect:
            pass
        finally:
            beating.cancel()
            self._sockets.remove(one)
            if one is self._operates:
                self._operates = None
            await self._people()

    async def _beat(self, one: WebSocket) -> None:
        with suppress(WebSocketDisconnect, RuntimeError):  # one that has just gone
            while True:
                await asyncio.sleep(BEAT)
                if not self.mute:
                    await one.send_text(json.dumps({"kind": "beat"}))

    async def _hear(self, one: WebSocket, command: dict[str, Any]) -> None:
        match command["do"]:
            case "operate" if self.operator is None:
                self._operates, self.operator = one, command["name"]
                self._seat = one.query_params.get("tab", "")
                await self._people()
            case "operate":
                refused = {"kind": "refused", "words": f"{self.operator} operates"}
                await one.send_text(json.dumps(refused))
            case "leave":
                self._operates, self.operator, self._seat = None, None, ""
                await self._people()
            case _:
                pass
        self._keep(command)

    async def _page(self, _: Request) -> Response:
        return HTMLResponse((STATIC / "index.html").read_text(encoding="utf-8"))

    async def _setup(self, _: Request) -> Response:
        return JSONResponse(self.setup)

    async def _probe(self, request: Request) -> Response:
        self._keep({"probe": await request.json()})
        return JSONResponse(self.probed)

    async def _file(self, request: Request) -> Response:
        icon = '<link rel="icon" href="/static/icon.svg">'
        return HTMLResponse(f"<!DOCTYPE html>{icon}<title>file</title><h1>{request.url.path}</h1>")


class _PolicyMiddleware:
    """Sends the policy that the bench's server sends: nothing from elsewhere, nothing inline."""

    def __init__(self, app: ASGIApp):
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        async def guarded(message: Any) -> None:
            if message["type"] == "http.response.start":
                message["headers"].append((b"content-security-policy", POLICY))
            await send(message)

        await self._app(scope, receive, guarded if scope["type"] == "http" else send)
