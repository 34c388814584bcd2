"""The routes of the page: files, set-up, probe, what runs have left, and the websocket."""

import asyncio
import json
from collections import deque
from contextlib import suppress
from importlib.metadata import version
from importlib.resources import files
from importlib.resources.abc import Traversable
from time import monotonic
from typing import Any

from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import HTMLResponse, JSONResponse, PlainTextResponse, Response
from starlette.routing import Route, WebSocketRoute
from starlette.websockets import WebSocket, WebSocketDisconnect

from inercal.errors import InercalError
from inercal.host.packets import PRESETS, read_layout
from inercal.host.web.access import VIEWER, Access, cookie
from inercal.host.web.gate import Gate, viewer_cookie
from inercal.host.web.hub import Hub
from inercal.host.web.probing import probe
from inercal.host.web.refusal_log import RefusalLog
from inercal.host.web.requests import parsed
from inercal.host.web.viewers import Viewer

_A_SECOND = 20  # messages of a viewer
_BEAT = 2.0  # s
_WAITING = 4  # histories that are asked for while one is drawn
_KINDS = {
    "html": "text/html; charset=utf-8",
    "js": "text/javascript; charset=utf-8",
    "css": "text/css; charset=utf-8",
    "svg": "image/svg+xml",
}
# A report and a history bring their styles and pictures with them, and run nothing.
_ALONE = (
    "default-src 'none'; style-src 'unsafe-inline'; img-src data:; font-src data:; "
    "base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
_NO_PAGE = b"<!doctype html><title>inercal</title><p>The page's own files are not installed."


class Page:
    """The page of one hub.

    Parameters
    ----------
    hub : Hub
    register : str or None
        Address.
    refused : RefusalLog
    """

    def __init__(self, hub: Hub, register: str | None, refused: RefusalLog):
        self._hub, self._register, self._refused = hub, register, refused
        self._version = version("inercal")
        self._files = dict(_static(files("inercal.host.web").joinpath("static")))
        self._looking, self._drawing = asyncio.Lock(), asyncio.Lock()
        self._histories = 0  # that are drawn or wait for it
        self._drawn: tuple[object, str] = None, ""

    def routes(self) -> list[Route | WebSocketRoute]:
        """Return what is served."""
        return [
            Route("/", self.index),
            Route("/static/{name:path}", self.static),
            Route("/api/setup", self.setup),
            Route("/api/probe", self.probe, methods=["POST"]),
            Route("/runs/{name}/{what}", self.made),
            Route("/history/{sensor}", self.history),
            WebSocketRoute("/live", self.live),
        ]

    async def index(self, request: Request) -> Response:
        """Return the page."""
        content, kind = self._files.get("index.html", (_NO_PAGE, _KINDS["html"]))
        answer = Response(content, media_type=kind)
        viewer_cookie(request.headers, answer)
        return answer

    async def static(self, request: Request) -> Response:
        """Return one of the page's files."""
        found = self._files.get(request.path_params["name"])
        if found is None:
            return await self.unknown(request)
        return Response(found[0], media_type=found[1])

    async def setup(self, request: Request) -> Response:
        """Return what there is to choose from."""
        async with self._looking:
            content = await asyncio.to_thread(self._setup)
        return JSONResponse(content)

    async def probe(self, request: Request) -> Response:
        """Ask the devices, for the operator."""
        who = request.client.host if request.client else "somebody"
        if not self._hub.people.is_operators(cookie(request.headers, VIEWER)):
            self._refused(who, "probe: not the operator's browser")
            return JSONResponse({"words": "only the operator may ask the devices"}, 403)
        try:
            asked = parsed(await request.body())
        except ValueError:
            self._refused(who, "probe: no JSON object")
            return JSONResponse({"words": "send a JSON object"}, 400)
        if self._hub.probing.locked():
            return JSONResponse({"words": "the devices are being asked"}, 409)
        async with self._hub.probing:
            try:
                await self._hub.none_goes_on()
            except InercalError as error:
                return JSONResponse({"words": str(error)}, 409)
            plans = await asyncio.to_thread(self._hub.plans.all)
            name = asked.get("plan")
            plan = plans.get(name) if isinstance(name, str) else None
            content = await asyncio.to_thread(probe, self._hub.choice, plan, asked)
        return JSONResponse(content)

    async def made(self, request: Request) -> Response:
        """Return the report or the calibration of a run."""
        runs = await asyncio.to_thread(self._hub.runs.all)
        run = runs.get(request.path_params["name"])
        what = request.path_params["what"]
        kinds = {"report": "report.html", "calibration": "calibration.json"}
        if run is None or what not in kinds:
            return await self.unknown(request)
        try:
            content = await asyncio.to_thread(run.made(kinds[what]).read_bytes)
        except OSError:
            return PlainTextResponse(f"this run has no {what}\n", 404)
        if what == "calibration":
            return Response(content, media_type="application/json")
        return HTMLResponse(content, headers={"content-security-policy": _ALONE})

    async def history(self, request: Request) -> Response:
        """Return the history of a sensor."""
        named: str = request.path_params["sensor"]
        # No register has a number of more digits, and not every database takes one.
        if not (named.isascii() and named.isdigit() and len(named) < 10):
            return await self.unknown(request)
        if self._histories > _WAITING:
            who = request.client.host if request.client else "somebody"
            self._refused(who, f"history: {_WAITING} wait to be drawn")
            return PlainTextResponse("too many histories are asked for; wait a moment\n", 429)
        self._histories += 1
        try:
            # One at a time: figures are drawn with settings of the whole process.
            async with self._drawing:
                content = await asyncio.to_thread(self._history, int(named))
        except InercalError as error:
            return PlainTextResponse(f"{error}\n", 404)
        finally:
            self._histories -= 1
        return HTMLResponse(content, headers={"content-security-policy": _ALONE})

    async def unknown(self, request: Request, error: Exception | None = None) -> Response:
        """Refuse what there is not."""
        who = request.client.host if request.client else "somebody"
        self._refused(who, f"{request.method} {request.scope['path']}: there is no such thing")
        return PlainTextResponse("there is no such thing here\n", 404)

    async def live(self, websocket: WebSocket) -> None:
        """Tell somebody of the run, and do what they ask."""
        who = websocket.client.host if websocket.client else "somebody"
        if self._hub.people.full:
            self._refused(who, "websocket: too many look on")
            await websocket.close()
            return
        await websocket.accept()
        viewer = self._hub.come(self._version, cookie(websocket.headers, VIEWER))
        sending = asyncio.create_task(_send(websocket, viewer))
        beating = asyncio.create_task(_beat(viewer))
        try:
            await self._hear(websocket, viewer, who)
        except WebSocketDisconnect:
            pass
        finally:
            self._hub.go(viewer)
            for task in (beating, sending):
                task.cancel()
                with suppress(asyncio.CancelledError):
                    await task

    async def _hear(self, websocket: WebSocket, viewer: Viewer, who: str) -> None:
        times: deque[float] = deque(maxlen=_A_SECOND + 1)
        while True:
            message = await websocket.receive()
            if message["type"] != "websocket.receive":
                return
            times.append(monotonic())
            if len(times) == times.maxlen and times[-1] - times[0] < 1.0:
                self._refused(
                    who, f"viewer {viewer.number}: more than {_A_SECOND} messages a second"
                )
                await websocket.close(1008, "too many messages")
                return
            text = message.get("text")
            if text is None:
                self._refused(who, f"viewer {viewer.number}: bytes that are no text")
                await websocket.close(1003, "text only")
                return
            try:
                await self._hub.do(viewer, parsed(text))
            except (InercalError, ValueError) as error:
                words = str(error) if isinstance(error, InercalError) else "not a JSON object"
                self._refused(who, f"viewer {viewer.number}: {words}")
                viewer.send("refused", json.dumps({"kind": "refused", "words": words}))

    def _setup(self) -> dict[str, Any]:
        from inercal.store import Register

        hub = self._hub
        hub.choice.look()
        trouble, address = "", ""
        sensors: list[dict[str, Any]] = []
        try:
            with Register(self._register) as register:
                address = register.address
                for one in register.sensors():
                    shown = {"id": one.id, "name": one.name}
                    sensors.append(shown | {"calibrations": one.calibrations, "last": one.last})
        except InercalError as error:
            trouble = str(error)
        return {
            "register": address,
            "trouble": trouble,
            "plans": [plan.shown for plan in hub.plans.all().values()],
            "sensors": sensors,
            "tables": hub.choice.tables(),
            "imus": hub.choice.imus(),
            "presets": [{"name": p, "protection": read_layout(p).protection} for p in PRESETS],
            "runs": [run.shown for run in hub.runs.all().values()],
        }

    def _history(self, sensor: int) -> str:
        from inercal.report import history_page
        from inercal.store import Register

        with Register(self._register) as register:
            history = register.history(sensor)
        # Figures take seconds to draw, and between two runs all look at the same ones.
        shows = history.sensor, history.entries, history.left_out
        if self._drawn[0] != shows:
            self._drawn = shows, history_page(history)
        return self._drawn[1]


def application(hub: Hub, register: str | None, access: Access, refused: RefusalLog) -> Gate:
    """Return the page as an ASGI application, behind its gate."""
    page = Page(hub, register, refused)
    app = Starlette(routes=page.routes(), exception_handlers={404: page.unknown})
    return Gate(app, access, refused)


async def _send(websocket: WebSocket, viewer: Viewer) -> None:
    """Send what there is for a viewer, as fast as it takes it."""
    with suppress(WebSocketDisconnect, RuntimeError):  # gone, or told to go
        while True:
            await websocket.send_text(await viewer.next())


async def _beat(viewer: Viewer) -> None:
    """Have a page see that its connection is alive: a dead one looks like a run without news."""
    while True:
        await asyncio.sleep(_BEAT)
        viewer.send("beat", '{"kind": "beat"}')


def _static(folder: Traversable, prefix: str = "") -> "list[tuple[str, tuple[bytes, str]]]":
    """Return the files of the page, by the names that a request may use."""
    found: list[tuple[str, tuple[bytes, str]]] = []
    if not folder.is_dir():
        return found
    for one in folder.iterdir():
        if one.is_dir():
            found += _static(one, f"{prefix}{one.name}/")
        elif (kind := _KINDS.get(one.name.rpartition(".")[2])) is not None:
            found.append((f"{prefix}{one.name}", (one.read_bytes(), kind)))
    return found
