"""The server of the page: where it listens, and how it ends.

To end it while a run goes on is to stop the run: it waits until the table is at rest and the run's
process has ended. A second Ctrl-C leaves at once; the run is stopped all the same.

The web server itself (uvicorn) waits without end for the first request of a connection, and for a
client that does not take its answer. Its own limit of connections would refuse whoever comes last.
So `ConnectionLimits`, as ASGI middleware, notes which clients have asked for something, and closes
the connections of the others when their time is over. Where there are too many, those of the
address with most give way: first the ones that have asked nothing, then requests, always the
oldest, since a request of a page is answered long before it is that; none of them before it was
there for a `CHECK_INTERVAL`. Websockets are viewers, whose number has a limit of its own. Each
connection serves one request, as the answers say, or becomes a websocket.
"""

import asyncio
import logging
import secrets
import socket
import sys
from asyncio import Transport
from collections import defaultdict
from collections.abc import Collection, Iterable
from dataclasses import dataclass
from pathlib import Path
from time import monotonic
from types import FrameType
from typing import Protocol
from urllib.parse import quote
from weakref import WeakKeyDictionary

import uvicorn
from starlette.types import ASGIApp, Receive, Scope, Send

from inercal.basics.errors import InercalError, InputError
from inercal.host.run_log import os_errors_as_input_errors
from inercal.host.tasks import DEFAULT_OPTIONS, RunOptions
from inercal.host.web.access import Access, is_loopback
from inercal.host.web.app import application
from inercal.host.web.device_catalogue import DeviceCatalogue
from inercal.host.web.hub import Hub
from inercal.host.web.plans import Plans
from inercal.host.web.refusal_log import RefusalHandler, RefusalLog
from inercal.host.web.runs import Runs
from inercal.host.web.viewers import MAX_VIEWERS
from inercal.laboratory.store import Register

MAX_CONNECTIONS = 256  # connections, those of viewers with them
CHECK_INTERVAL = 0.1  # s
_IDLE_TIMEOUT, _REQUEST_TIMEOUT = 10.0, 120.0  # s without a request, and for one with its answer

_Client = tuple[str, int]


class Connection(Protocol):
    """The web server's record of one connection."""

    transport: Transport


class ConnectionLimits:
    """An ASGI application that records who sends requests.

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
        """Close connections that have been idle for too long, take too long or are too many."""
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


_MAX_MESSAGE = 4096  # bytes of a message of a page
_SHUTDOWN_TIMEOUT = 2  # s that connections may take to end
_WILDCARD_HOSTS = ("0.0.0.0", "::")


@dataclass(frozen=True)
class ServerOptions:
    """How the page is served.

    Parameters
    ----------
    plans, runs : Path
        Folders.
    register : str or None
        Address of the register.
    table, imu, clock : str
        Addresses of devices to choose beside those that are found.
    run_options : inercal.host.tasks.RunOptions
        Of each run.
    host : str
    port : int
        0 is any that is free.
    token : str or None
        That a browser must show; made where `host` can be reached from other machines.
    """

    plans: Path = Path()
    runs: Path = Path("runs")
    register: str | None = None
    table: str = ""
    imu: str = ""
    clock: str = ""
    run_options: RunOptions = DEFAULT_OPTIONS
    host: str = "127.0.0.1"
    port: int = 8765
    token: str | None = None


_TURNS = 3  # of the event loop


class WebServer(uvicorn.Server):
    """The web server, which ends the run before it ends itself.

    Parameters
    ----------
    config : uvicorn.Config
        Of an application behind `limits`.
    hub : Hub
    limits : ConnectionLimits
    """

    def __init__(self, config: uvicorn.Config, hub: Hub, limits: ConnectionLimits):
        super().__init__(config)
        self._hub, self._limits, self._signal_count = hub, limits, 0
        self._loop: asyncio.AbstractEventLoop | None = None

    async def serve(self, sockets: list[socket.socket] | None = None) -> None:
        """Serve until told to end."""
        self._loop = asyncio.get_running_loop()
        checking = asyncio.create_task(self._check_connections())
        try:
            await super().serve(sockets)
        finally:
            checking.cancel()

    def handle_exit(self, sig: int, frame: FrameType | None) -> None:
        """Handle a signal: the first ends the server in order, the second at once."""
        self._signal_count += 1
        if self._signal_count > 1:
            self.should_exit = self.force_exit = True
        elif self._loop is not None:
            self._loop.call_soon_threadsafe(self.stop_run_and_exit)

    def stop_run_and_exit(self) -> None:
        """Stop the active run, if any, and end when it has ended."""
        run_process = self._hub.run_process
        if run_process is not None and self._hub.is_run_active:
            run_process.stop()
            print_notice(
                "the run is being stopped; this ends when the table is at rest (Ctrl-C again: at "
                "once; the run is stopped all the same)"
            )
        self._exit_task = asyncio.ensure_future(self._exit_when_idle())

    async def _check_connections(self) -> None:
        while True:
            await asyncio.sleep(CHECK_INTERVAL)
            # After a moment in which the loop stood still, requests that have arrived are read
            # and heard in the next turns: until then they would count as connections without one.
            for _ in range(_TURNS):
                await asyncio.sleep(0)
            self._limits.close_overdue(self.server_state.connections)

    async def _exit_when_idle(self) -> None:
        await self._hub.wait_until_idle()
        self.should_exit = True


def serve(options: ServerOptions) -> None:
    """Serve the page until Ctrl-C.

    Raises
    ------
    InputError
        A folder, an address, a token or a port that cannot be used.
    """
    refused = RefusalLog()
    runs = _registered_runs(options)
    with listening_socket(options.host, options.port) as opened:
        port = opened.getsockname()[1]
        token = options.token
        if token is None and not is_loopback(options.host):
            token = secrets.token_urlsafe(24)
        names = {options.host, "localhost", "127.0.0.1", "[::1]"} if token is None else set[str]()
        access = Access(host_header_values(names, port), token)
        choice = DeviceCatalogue(options.table, options.imu, options.clock)
        hub = Hub(Plans(options.plans), runs, choice, options.register, options.run_options)
        server = web_server(hub, options.register, access, refused)
        host = (
            socket.gethostname()
            if options.host in _WILDCARD_HOSTS
            else _bracketed_host(options.host)
        )
        print_notice(
            "the STOP of this page is software and not a safety function; the hardware interlock is"
        )
        print(_page_address_text(f"http://{host}:{port}/", options.token, token), flush=True)
        asyncio.run(server.serve(sockets=[opened]))


def web_server(hub: Hub, register: str | None, access: Access, refused: RefusalLog) -> WebServer:
    """Return a server of a hub's page."""
    logger = logging.getLogger("uvicorn.error")
    logger.handlers[:] = [RefusalHandler(refused)]
    logger.propagate = False
    limits = ConnectionLimits(application(hub, register, access, refused), refused)
    config = uvicorn.Config(
        limits,
        loop="asyncio",
        http="h11",
        ws="websockets-sansio",
        ws_max_size=_MAX_MESSAGE,
        ws_per_message_deflate=False,
        # A viewer whose link broke is known to be gone within 9 s.
        ws_ping_interval=4,
        ws_ping_timeout=5,
        lifespan="off",
        log_config=None,
        log_level="warning",
        access_log=False,
        proxy_headers=False,
        server_header=False,
        backlog=4 * MAX_VIEWERS,
        timeout_graceful_shutdown=_SHUTDOWN_TIMEOUT,
    )
    return WebServer(config, hub, limits)


def listening_socket(host: str, port: int) -> socket.socket:
    """Return a socket that listens there.

    Raises
    ------
    InputError
        It cannot.
    """
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    try:
        return socket.create_server((host, port), family=family)
    except (OSError, OverflowError) as error:
        words = getattr(error, "strerror", None) or str(error)
        raise InputError(
            f"--host {host} --port {port}: the server cannot listen there: {words}; give another "
            "--host or --port"
        ) from None


def host_header_values(names: Iterable[str], port: int) -> frozenset[str]:
    """Return the names by which a browser may call this server in Host."""
    bare = {_bracketed_host(name).lower() for name in names}
    own = {f"{name}:{port}" for name in bare}
    return frozenset(own | bare if port == 80 else own)  # that of http is left out


def print_notice(words: str) -> None:
    """Print a line for the person who started the server."""
    print(f"inercal: {words}", file=sys.stderr, flush=True)


def _page_address_text(address: str, given: str | None, token: str | None) -> str:
    """Print the address of the page, with the token if it was generated here."""
    if token is None:
        return f"the page is at {address}"
    if given is None:
        return f"the page is at {address}?token={quote(token, safe='')}"
    # A log or a screen is no place for a token that may be another server's too.
    return f"the page is at {address} and asks for the token that you gave"


def _registered_runs(options: ServerOptions) -> Runs:
    """Return the runs, once all of them are in the register."""
    if not options.plans.is_dir():
        raise InputError(
            f"--plans {options.plans}: this folder does not exist; give the folder of the plans"
        )
    with os_errors_as_input_errors(f"--runs {options.runs}", "made"):
        options.runs.mkdir(parents=True, exist_ok=True)
    Register(options.register).close()
    runs = Runs(options.runs)
    try:
        troubles = runs.enter(options.register)
    except InercalError as error:
        troubles = [str(error)]
    for words in troubles:
        print_notice(f"not in the register: {words}")
    return runs


def _bracketed_host(host: str) -> str:
    return f"[{host}]" if ":" in host and not host.startswith("[") else host
