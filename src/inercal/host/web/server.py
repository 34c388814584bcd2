"""Runs the web server of the page: it listens, limits connections and shuts down.

If the server is ended during a run, the run is stopped. The server waits until the table is at rest
and the process of the run has ended. A second Ctrl-C ends the server at once, but the run is still
stopped.

The web server itself (uvicorn) waits without limit for the first request on a connection, and for a
client that does not read its answer. Its own limit on connections would refuse the latest client.
`ConnectionLimits`, an ASGI middleware, therefore records which clients have sent a request, and
closes the other connections after a timeout. If there are too many connections, it closes
connections of the address that has the most: first connections without a request, and then
connections with a request. The oldest connections are closed first, because the page's own requests
are answered quickly. A connection is not closed within its first `CHECK_INTERVAL`. Websockets
belong to viewers, whose number has a separate limit. According to the headers of the answer, each
connection serves only one request or becomes a websocket.
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
from inercal.host.web.folders import Plans, Runs
from inercal.host.web.hub import Hub
from inercal.host.web.json_objects import RefusalHandler, RefusalLog
from inercal.host.web.viewers import MAX_VIEWERS
from inercal.laboratory.store import Register

MAX_CONNECTIONS = 256  # connections, including the viewers' connections
CHECK_INTERVAL = 0.1  # s
_IDLE_TIMEOUT, _REQUEST_TIMEOUT = 10.0, 120.0  # s before a request, and for request and answer

_Client = tuple[str, int]


class Connection(Protocol):
    """A connection, as the web server records it."""

    transport: Transport


class ConnectionLimits:
    """ASGI middleware that records which clients send requests, and limits connections.

    Parameters
    ----------
    app : ASGI application
    refused : RefusalLog
    """

    def __init__(self, app: ASGIApp, refused: RefusalLog):
        self._app, self._refusals = app, refused
        self._asked: dict[_Client, str] = {}  # clients with a request, and the kind of the request
        self._ended: dict[_Client, float] = {}  # end time of the websocket of a client
        self._begun: WeakKeyDictionary[Connection, float] = WeakKeyDictionary()

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Serve one request and record its client."""
        host, port = scope.get("client") or ("", 0)
        self._asked[host, port] = scope["type"]
        try:
            await self._app(scope, receive, send)
        finally:
            if scope["type"] == "websocket":
                self._ended[host, port] = monotonic()

    def close_overdue(self, connections: Collection[Connection]) -> None:
        """Close connections that are idle for too long, take too long or are too numerous."""
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
                self._close(one, f"did not close its websocket within {_IDLE_TIMEOUT:g} s")
            elif kind != "websocket" and age:  # new connections are kept for some time
                waiting[who[0]].append(one)
        for those in waiting.values():  # the next connection to close is last in the list
            those.sort(key=lambda one: (self._asked.get(_client(one)) is None, -self._begun[one]))
        surplus = min(len(connections) - MAX_CONNECTIONS, sum(map(len, waiting.values())))
        for _ in range(surplus):
            most = max(waiting.values(), key=len)
            self._close(most.pop(), f"there are more than {MAX_CONNECTIONS} connections")

    def _close(self, one: Connection, words: str) -> None:
        self._refusals(_client(one)[0], words)
        one.transport.abort()


def _client(one: Connection) -> _Client:
    """Return the client's address and port, in the same form as the scope of a request."""
    host, port = (one.transport.get_extra_info("peername") or ("", 0))[:2]
    return str(host), int(port)


_MAX_MESSAGE = 4096  # largest number of bytes in a message from a page
_SHUTDOWN_TIMEOUT = 2  # s; connections must end in this time
_WILDCARD_HOSTS = ("0.0.0.0", "::")


@dataclass(frozen=True)
class ServerOptions:
    """Options of the web server.

    Parameters
    ----------
    plans, runs : Path
        Folder of the plans, and folder of the runs.
    register : str or None
        Address of the register.
    table, imu, clock : str
        Addresses of devices that are offered in addition to the devices that are found.
    run_options : inercal.host.tasks.RunOptions
        Options of each run.
    host : str
    port : int
        Port number; 0 selects any free port.
    token : str or None
        Token that a browser must show. By default, a token is generated if `host` can be reached
        from other machines.
    read_token : str or None
        Token with which scripts read. By default, a token is generated if the page needs a token.
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
    read_token: str | None = None


_TURNS = 3  # number of iterations of the event loop


class WebServer(uvicorn.Server):
    """A web server that ends the active run before it shuts down.

    Parameters
    ----------
    config : uvicorn.Config
        Configuration, with an application behind `limits`.
    hub : Hub
    limits : ConnectionLimits
    """

    def __init__(self, config: uvicorn.Config, hub: Hub, limits: ConnectionLimits):
        super().__init__(config)
        self._hub, self._limits, self._signal_count = hub, limits, 0
        self._loop: asyncio.AbstractEventLoop | None = None

    async def serve(self, sockets: list[socket.socket] | None = None) -> None:
        """Serve until the server is told to end, and then end the run."""
        self._loop = asyncio.get_running_loop()
        checking = asyncio.create_task(self._check_connections())
        try:
            await super().serve(sockets)
        finally:
            checking.cancel()

    def handle_exit(self, sig: int, frame: FrameType | None) -> None:
        """Handle a signal: the first signal shuts down in order, and the second at once."""
        self._signal_count += 1
        if self._signal_count > 1:
            self.should_exit = self.force_exit = True
        elif self._loop is not None:
            self._loop.call_soon_threadsafe(self.stop_run_and_exit)

    def stop_run_and_exit(self) -> None:
        """Stop the active run, if any, and shut down when it has ended."""
        run_process = self._hub.run_process
        if run_process is not None and self._hub.is_run_active:
            run_process.stop()
            print_notice(
                "the run is being stopped; the server ends when the table is at rest (press "
                "Ctrl-C again to end it at once; the run is stopped nevertheless)"
            )
        self._exit_task = asyncio.ensure_future(self._exit_when_idle())

    async def _check_connections(self) -> None:
        while True:
            await asyncio.sleep(CHECK_INTERVAL)
            # If the event loop was blocked, requests that arrived meanwhile are read in the next
            # iterations. Before this, their connections would count as idle.
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
        A folder, an address, a token or a port cannot be used.
    """
    refused = RefusalLog()
    runs = _registered_runs(options)
    with listening_socket(options.host, options.port) as opened:
        port = opened.getsockname()[1]
        token = options.token
        if token is None and not is_loopback(options.host):
            token = secrets.token_urlsafe(24)
        read_token = options.read_token
        if read_token is None and token is not None:
            read_token = secrets.token_urlsafe(24)
        names = {options.host, "localhost", "127.0.0.1", "[::1]"} if token is None else set[str]()
        access = Access(host_header_values(names, port), token, read_token)
        choice = DeviceCatalogue(options.table, options.imu, options.clock)
        hub = Hub(Plans(options.plans), runs, choice, options.register, options.run_options)
        server = web_server(hub, options.register, access, refused)
        host = socket.gethostname() if options.host in _WILDCARD_HOSTS else options.host
        print_notice(
            "the STOP on this page is only software; the safety function is the hardware interlock"
        )
        address = f"http://{_bracketed_host(host)}:{port}/"
        print(_page_address_text(address, options.token, token), flush=True)
        if read_token != options.read_token:
            print(f"scripts may read with the token {read_token}", flush=True)
        asyncio.run(server.serve(sockets=[opened]))


def web_server(hub: Hub, register: str | None, access: Access, refused: RefusalLog) -> WebServer:
    """Return a web server for the page of a hub."""
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
        # With these settings, a broken connection to a viewer is detected within 9 s.
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
    """Return a socket that listens on a host and port.

    Raises
    ------
    InputError
        The server cannot listen on this host and port.
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
    """Return the permitted values of the Host header in requests from a browser."""
    bare = {_bracketed_host(name).lower() for name in names}
    own = {f"{name}:{port}" for name in bare}
    return frozenset(own | bare if port == 80 else own)  # browsers omit the default port of HTTP


def print_notice(words: str) -> None:
    """Print a line for the person who started the server."""
    print(f"inercal: {words}", file=sys.stderr, flush=True)


def _page_address_text(address: str, given: str | None, token: str | None) -> str:
    """Return a text with the page's address, and the token if it was generated here."""
    if token is None:
        return f"the page is at {address}"
    if given is None:
        return f"the page is at {address}?token={quote(token, safe='')}"
    # A stated token is not printed, because other servers may also use it.
    return f"the page is at {address} and asks for the token that you gave"


def _registered_runs(options: ServerOptions) -> Runs:
    """Enter all runs in the register, and return them."""
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
