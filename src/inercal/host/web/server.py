"""The server of the page: where it listens, and how it ends.

To end it while a run goes on is to stop the run: it waits until the table is at rest and the run's
process has ended. A second Ctrl-C leaves at once; the run is stopped all the same.
"""

import asyncio
import logging
import secrets
import socket
import sys
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from types import FrameType
from urllib.parse import quote

import uvicorn

from inercal.errors import InercalError, InputError
from inercal.host.log import usable
from inercal.host.options import ORDINARY
from inercal.host.options import Options as OfRuns
from inercal.host.web.access import Access, is_loopback
from inercal.host.web.app import application
from inercal.host.web.choice import Choice
from inercal.host.web.connections import limited
from inercal.host.web.hub import Hub
from inercal.host.web.plans import Plans
from inercal.host.web.refusal_log import Handler, RefusalLog
from inercal.host.web.runs import Runs
from inercal.host.web.viewers import MOST
from inercal.store import Register

_MESSAGE = 4096  # bytes of a message of a page
_GRACE = 2  # s that connections may take to end
_ANY = ("0.0.0.0", "::")


@dataclass(frozen=True)
class Options:
    """How the page is served.

    Parameters
    ----------
    plans, runs : Path
        Folders.
    register : str or None
        Address of the register.
    table, imu, clock : str
        Addresses of devices to choose beside those that are found.
    of_runs : inercal.host.options.Options
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
    of_runs: OfRuns = ORDINARY
    host: str = "127.0.0.1"
    port: int = 8765
    token: str | None = None


class Server(uvicorn.Server):
    """The web server, which ends the run before it ends itself."""

    def __init__(self, config: uvicorn.Config, hub: Hub):
        super().__init__(config)
        self._hub, self._asked = hub, 0
        self._loop: asyncio.AbstractEventLoop | None = None

    async def serve(self, sockets: list[socket.socket] | None = None) -> None:
        """Serve until it is told to end."""
        self._loop = asyncio.get_running_loop()
        await super().serve(sockets)

    def handle_exit(self, sig: int, frame: FrameType | None) -> None:
        """Hear a signal: the first ends it in order, the second at once."""
        self._asked += 1
        if self._asked > 1:
            self.should_exit = self.force_exit = True
        elif self._loop is not None:
            self._loop.call_soon_threadsafe(self.end)

    def end(self) -> None:
        """Stop the run, if one goes on, and end when that has ended."""
        going = self._hub.going
        if going is not None and self._hub.goes_on:
            going.stop()
            say(
                "the run is being stopped; this ends when the table is at rest (Ctrl-C again: at "
                "once; the run is stopped all the same)"
            )
        self._ending = asyncio.ensure_future(self._end())

    async def _end(self) -> None:
        await self._hub.over()
        self.should_exit = True


def serve(options: Options) -> None:
    """Serve the page until Ctrl-C.

    Raises
    ------
    InputError
        A folder, an address, a token or a port that cannot be used.
    """
    refused = RefusalLog()
    runs = _runs(options)
    with listening(options.host, options.port) as opened:
        port = opened.getsockname()[1]
        token = options.token
        if token is None and not is_loopback(options.host):
            token = secrets.token_urlsafe(24)
        names = {options.host, "localhost", "127.0.0.1", "[::1]"} if token is None else set[str]()
        access = Access(hosts(names, port), token)
        choice = Choice(options.table, options.imu, options.clock)
        hub = Hub(Plans(options.plans), runs, choice, options.register, options.of_runs)
        server = made(hub, options.register, access, refused)
        host = socket.gethostname() if options.host in _ANY else _bracketed(options.host)
        say(
            "a stop on this page is done by programs and is no safety function: that is the "
            "hardware interlock"
        )
        print(_where(f"http://{host}:{port}/", options.token, token), flush=True)
        asyncio.run(server.serve(sockets=[opened]))


def made(hub: Hub, register: str | None, access: Access, refused: RefusalLog) -> Server:
    """Return a server of a hub's page."""
    logger = logging.getLogger("uvicorn.error")
    logger.handlers[:] = [Handler(refused)]
    logger.propagate = False
    config = uvicorn.Config(
        application(hub, register, access, refused),
        loop="asyncio",
        http=limited(refused),
        ws="websockets-sansio",
        ws_max_size=_MESSAGE,
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
        backlog=4 * MOST,
        timeout_graceful_shutdown=_GRACE,
    )
    return Server(config, hub)


def listening(host: str, port: int) -> socket.socket:
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
        raise InputError(f"--host {host} --port {port}: {words}; another --port?") from None


def hosts(names: Iterable[str], port: int) -> frozenset[str]:
    """Return what a browser may call this server by, as it says it in Host."""
    bare = {_bracketed(name).lower() for name in names}
    own = {f"{name}:{port}" for name in bare}
    return frozenset(own | bare if port == 80 else own)  # that of http is left out


def say(words: str) -> None:
    """Say something to who has started the server."""
    print(f"inercal: {words}", file=sys.stderr, flush=True)


def _where(address: str, given: str | None, token: str | None) -> str:
    """Say where the page is: with a token that was made here, and else nobody could know."""
    if token is None:
        return f"the page is at {address}"
    if given is None:
        return f"the page is at {address}?token={quote(token, safe='')}"
    # A log or a screen is no place for a token that may be another server's too.
    return f"the page is at {address} and asks for the token that you gave"


def _runs(options: Options) -> Runs:
    """Return the runs there are, once all of them are in the register."""
    if not options.plans.is_dir():
        raise InputError(f"--plans {options.plans}: there is no such folder")
    with usable(f"--runs {options.runs}", "made"):
        options.runs.mkdir(parents=True, exist_ok=True)
    Register(options.register).close()
    runs = Runs(options.runs)
    try:
        troubles = runs.enter(options.register)
    except InercalError as error:
        troubles = [str(error)]
    for words in troubles:
        say(f"not in the register: {words}")
    return runs


def _bracketed(host: str) -> str:
    return f"[{host}]" if ":" in host and not host.startswith("[") else host
