"""The routes of the page: files, set-up, device probe, results of runs, and the websocket.

The page's own files are compressed once when the server starts.
"""

import asyncio
import gzip
from collections.abc import Callable
from functools import partial
from importlib.metadata import version
from importlib.resources import files
from importlib.resources.abc import Traversable
from typing import Any

from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import HTMLResponse, JSONResponse, PlainTextResponse, Response
from starlette.routing import Match, Route, WebSocketRoute
from starlette.types import Scope
from starlette.websockets import WebSocket

from inercal.basics.errors import InercalError, InputError
from inercal.host.packets import PRESETS, read_layout
from inercal.host.web import api_answers
from inercal.host.web.access import Access, AccessMiddleware, client_host
from inercal.host.web.device_catalogue import probe_devices
from inercal.host.web.folders import StoredRun, check_filter_changes
from inercal.host.web.hub import Hub
from inercal.host.web.interface import ROUTES, InterfaceRoute, openapi_description
from inercal.host.web.json_objects import RefusalLog, parse_object
from inercal.host.web.live_socket import LiveSocket

_MEDIA_TYPES = {
    "html": "text/html; charset=utf-8",
    "js": "text/javascript; charset=utf-8",
    "css": "text/css; charset=utf-8",
    "svg": "image/svg+xml",
}
_MISSING_PAGE = b"<!doctype html><title>inercal</title><p>The page's own files are not installed."


class StaticFile:
    """A static file of the page; a compressed copy saves 30 s over a link with 4 kB/s."""

    def __init__(self, content: bytes, media_type: str):
        self._content, self._media_type = content, media_type
        self._compressed = gzip.compress(content, mtime=0)

    def response(self, request: Request) -> Response:
        """Return the file in the encoding that the browser accepts."""
        headers = {"vary": "accept-encoding"}
        if "gzip" not in request.headers.get("accept-encoding", ""):
            return Response(self._content, media_type=self._media_type, headers=headers)
        headers["content-encoding"] = "gzip"
        return Response(self._compressed, media_type=self._media_type, headers=headers)


def static_files(folder: Traversable, prefix: str = "") -> list[tuple[str, StaticFile]]:
    """Return the static files, by the names in requests."""
    found: list[tuple[str, StaticFile]] = []
    if not folder.is_dir():
        return found
    for one in folder.iterdir():
        if one.is_dir():
            found += static_files(one, f"{prefix}{one.name}/")
        elif (kind := _MEDIA_TYPES.get(one.name.rpartition(".")[2])) is not None:
            found.append((f"{prefix}{one.name}", StaticFile(one.read_bytes(), kind)))
    return found


MISSING_PAGE = StaticFile(_MISSING_PAGE, _MEDIA_TYPES["html"])


class SharedCall:
    """Calls a slow function in a thread; several waiting callers share one result.

    Parameters
    ----------
    function : callable
    lock : asyncio.Lock
        Lock that is held during a call.
    """

    def __init__(self, function: Callable[[], dict[str, Any]], lock: asyncio.Lock):
        self._function, self._lock = function, lock
        self._next: asyncio.Task[dict[str, Any]] | None = None

    async def __call__(self) -> dict[str, Any]:
        """Return the result of a function call that begins after this request."""
        if self._next is None:
            self._next = asyncio.create_task(self._call())
        # If a caller is cancelled, only its own wait ends, because others still wait for the call.
        return await asyncio.shield(self._next)

    async def _call(self) -> dict[str, Any]:
        async with self._lock:
            self._next = None
            return await asyncio.to_thread(self._function)


_MAX_WAITING = 4  # largest number of waiting histories, and of waiting filter checks
_FILES = {"report": "report.html", "calibration": "calibration.json"}
# A report and a history contain their own styles and pictures and need no scripts.
_STANDALONE_POLICY = (
    "default-src 'none'; style-src 'unsafe-inline'; img-src data:; font-src data:; "
    "base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)


class Page:
    """The web page for a hub.

    Parameters
    ----------
    hub : Hub
    register : str or None
        Address of the register.
    access : Access
    refused : RefusalLog
    """

    def __init__(self, hub: Hub, register: str | None, access: Access, refused: RefusalLog):
        self._hub, self._register, self._refusals = hub, register, refused
        self._access = access
        self._live = LiveSocket(hub, access, refused, version("inercal"))
        self._files = dict(static_files(files("inercal.host.web").joinpath("static")))
        self._setup_lock, self._drawing_lock = asyncio.Lock(), asyncio.Lock()
        self._reading_lock = asyncio.Lock()
        self._list_setup = SharedCall(lambda: self._setup(), self._setup_lock)
        self._list_runs = SharedCall(lambda: api_answers.runs_answer(hub.runs), self._reading_lock)
        self._pending_histories = self._pending_filters = 0  # active or waiting requests
        self._cached_history: tuple[object, str] = None, ""

    def routes(self) -> list[Route | WebSocketRoute]:
        """Return the routes that the server offers."""
        return [
            Route("/", self.index),
            Route("/static/{name:path}", self.static),
            Route("/history/{sensor}", self.history),
            Route("/glossary", self.glossary),
            *map(self.route, ROUTES),
        ]

    def route(self, one: InterfaceRoute) -> Route | WebSocketRoute:
        """Return a route of the interface with its handler."""
        handler = getattr(self, one.handler)
        if one.method == "WEBSOCKET":
            return WebSocketRoute(one.path, handler)
        return Route(one.path, handler, methods=[one.method])

    async def index(self, request: Request) -> Response:
        """Return the page."""
        answer = self._files.get("index.html", MISSING_PAGE).response(request)
        if self._access.viewer(request.headers) is None:
            self._access.issue_viewer(request.headers, answer)
        return answer

    async def static(self, request: Request) -> Response:
        """Return a file that belongs to the page."""
        found = self._files.get(request.path_params["name"])
        if found is None:
            return await self.not_found(request)
        return found.response(request)

    async def setup(self, request: Request) -> Response:
        """Return the choices for the set-up of a run."""
        return JSONResponse(await self._list_setup())

    async def openapi(self, request: Request) -> Response:
        """Return this description."""
        return JSONResponse(openapi_description(Page))

    async def state(self, request: Request) -> Response:
        """Return the state of the run that the page shows."""
        return JSONResponse(api_answers.state_answer(self._hub))

    async def estimates(self, request: Request) -> Response:
        """Return the latest estimates with expanded uncertainties."""
        return JSONResponse(api_answers.estimates_answer(self._hub))

    async def stored_runs(self, request: Request) -> Response:
        """Return the stored runs, latest first."""
        return JSONResponse(await self._list_runs())

    async def journal(self, request: Request) -> Response:
        """Return the journal of a run with its events."""
        after = request.query_params.get("after", "0")
        if not (after.isascii() and after.isdigit() and len(after) < 10):
            return JSONResponse({"words": "after: give the number of an event, such as 0"}, 400)
        return await self._about_run(request, partial(api_answers.journal_answer, after=int(after)))

    async def result(self, request: Request) -> Response:
        """Return the calibration of a run, as `inercal show --json` prints it."""
        return await self._about_run(request, api_answers.result_answer)

    async def _about_run(
        self, request: Request, answer: Callable[[StoredRun], dict[str, Any]]
    ) -> Response:
        try:
            async with self._reading_lock:
                run = await asyncio.to_thread(self._hub.runs.find, request.path_params["name"])
                return JSONResponse(await asyncio.to_thread(answer, run))
        except InercalError as error:
            return JSONResponse({"words": str(error)}, 404)

    async def stop(self, request: Request) -> Response:
        """Stop the table for everyone at the page, even without a websocket or a place."""
        try:
            requested = parse_object(await request.body() or b"{}")
            await self._hub.stop(requested.get("run"))
        except InercalError as error:
            return JSONResponse({"words": str(error)}, 409)
        except ValueError:
            return JSONResponse({"words": "send a JSON object, or an empty body"}, 400)
        return JSONResponse({"words": "STOP was sent"})

    async def probe(self, request: Request) -> Response:
        """Probe the devices at the operator's request."""
        who = client_host(request.scope)
        if not self._hub.people.is_operator_browser(self._access.viewer(request.headers)):
            self._refusals(who, "probe: not the operator's browser")
            return JSONResponse({"words": "only the operator may probe the devices"}, 403)
        try:
            requested = parse_object(await request.body())
        except ValueError:
            self._refusals(who, "probe: the request is not a JSON object")
            return JSONResponse({"words": "the request is not a JSON object; send one"}, 400)
        if self._hub.probe_lock.locked():
            words = "the devices are still being probed; try again when the probe has ended"
            return JSONResponse({"words": words}, 409)
        async with self._hub.probe_lock:
            try:
                await self._hub.require_no_active_run()
            except InercalError as error:
                return JSONResponse({"words": str(error)}, 409)
            plan = await asyncio.to_thread(self._hub.plans.get, requested.get("plan"))
            content = await asyncio.to_thread(probe_devices, self._hub.choice, plan, requested)
        return JSONResponse(content)

    async def check_filter(self, request: Request) -> Response:
        """Check changed filter parameters of a plan, but do not store them."""
        try:
            requested = parse_object(await request.body())
        except ValueError:
            self._refusals(client_host(request.scope), "filter: the request is not a JSON object")
            return JSONResponse({"words": "send a JSON object"}, 400)
        if self._pending_filters > _MAX_WAITING:
            words = "too many filters are being checked; wait a moment"
            return JSONResponse({"words": words}, 429)
        self._pending_filters += 1
        try:
            async with self._setup_lock:
                plan = await asyncio.to_thread(self._hub.plans.get, requested.get("plan"))
                wrong = await asyncio.to_thread(check_filter_changes, plan, requested)
        except InercalError as error:
            return JSONResponse({"words": str(error)}, 400)
        finally:
            self._pending_filters -= 1
        return JSONResponse({"errors": wrong})

    async def output_file(self, request: Request) -> Response:
        """Return the report or the calibration file of a run."""
        what = request.path_params["what"]
        try:
            run = await asyncio.to_thread(self._hub.runs.find, request.path_params["name"])
            content = await asyncio.to_thread(run.output_file(_FILES[what]).read_bytes)
        except (InputError, KeyError):
            return await self.not_found(request)
        except OSError:
            return PlainTextResponse(f"this run has no {what}\n", 404)
        if what == "calibration":
            return Response(content, media_type="application/json")
        return HTMLResponse(content, headers={"content-security-policy": _STANDALONE_POLICY})

    async def history(self, request: Request) -> Response:
        """Return the history of a sensor."""
        named: str = request.path_params["sensor"]
        # Registers do not have longer numbers, and not every database accepts them.
        if not (named.isascii() and named.isdigit() and len(named) < 10):
            return await self.not_found(request)
        if self._pending_histories > _MAX_WAITING:
            self._refusals(client_host(request.scope), f"history: {_MAX_WAITING} already wait")
            return PlainTextResponse("too many histories are being drawn; wait a moment\n", 429)
        self._pending_histories += 1
        try:
            # Histories are drawn one at a time, because figures use settings of the whole process.
            async with self._drawing_lock:
                content = await asyncio.to_thread(self._history, int(named))
        except InercalError as error:
            return PlainTextResponse(f"{error}\n", 404)
        finally:
            self._pending_histories -= 1
        return HTMLResponse(content, headers={"content-security-policy": _STANDALONE_POLICY})

    async def glossary(self, request: Request) -> Response:
        """Return the glossary page."""
        from inercal.report.templates import glossary_page

        content = await asyncio.to_thread(glossary_page)
        return HTMLResponse(content, headers={"content-security-policy": _STANDALONE_POLICY})

    async def not_found(self, request: Request, error: Exception | None = None) -> Response:
        """Answer a request for an address that does not exist."""
        self._refusals(
            client_host(request.scope),
            f"{request.method} {request.scope['path']}: nothing exists at this address",
        )
        return PlainTextResponse("nothing exists at this address\n", 404)

    async def live(self, websocket: WebSocket) -> None:
        """Open the websocket of a viewer: messages about the run, and commands."""
        await self._live.serve(websocket)

    def _setup(self) -> dict[str, Any]:
        from inercal.laboratory.store import Register

        hub = self._hub
        hub.choice.refresh()
        trouble, address = "", ""
        sensors: list[dict[str, Any]] = []
        try:
            with Register(self._register) as register:
                address = register.address
                for one in register.sensors():
                    summary = {"id": one.id, "name": one.name}
                    sensors.append(summary | {"calibrations": one.calibrations, "last": one.last})
        except InercalError as error:
            trouble = str(error)
        return {
            "register": address,
            "trouble": trouble,
            "plans": [plan.summary for plan in hub.plans.all().values()],
            "sensors": sensors,
            "tables": hub.choice.tables(),
            "imus": hub.choice.imus(),
            "presets": [{"name": p, "protection": read_layout(p).protection} for p in PRESETS],
            "free": hub.runs.free_space(),
            "runs": [run.summary for run in hub.runs.all().values()],
        }

    def _history(self, sensor: int) -> str:
        from inercal.laboratory.store import Register
        from inercal.report import history_page, noise_history_page

        with Register(self._register) as register:
            entry, noise = register.sensor(sensor), register.noise_history(sensor)
            alone = noise and not entry.calibrations
            history = None if alone else register.history(sensor)
        # Drawing takes seconds, and all viewers see the same figures between two runs.
        shows: object = entry, noise
        if history is not None:
            shows = history.sensor, history.entries, history.exclusions, noise
        if self._cached_history[0] != shows:
            page = (
                noise_history_page(entry, noise)
                if history is None
                else history_page(history, noise=noise)
            )
            self._cached_history = shows, page
        return self._cached_history[1]


def application(
    hub: Hub, register: str | None, access: Access, refused: RefusalLog
) -> AccessMiddleware:
    """Return the page as an ASGI application behind its access checks."""
    page = Page(hub, register, access, refused)
    reading = [page.route(one) for one in ROUTES if one.reads]

    def is_readable(scope: Scope) -> bool:
        return any(one.matches(scope)[0] is Match.FULL for one in reading)

    app = Starlette(routes=page.routes(), exception_handlers={404: page.not_found})
    return AccessMiddleware(app, access, refused, is_readable)
