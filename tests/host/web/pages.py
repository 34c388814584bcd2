"""A server of the page in a thread, with a scripted run behind it, and pages that look on."""

import asyncio
import http.client
import json
import socket
import sys
from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager
from pathlib import Path
from resource import RLIMIT_NOFILE, getrlimit, setrlimit
from threading import Event, Thread
from time import monotonic
from typing import Any, Self

from websockets.exceptions import ConnectionClosed
from websockets.sync.client import ClientConnection, connect

from inercal.host.tasks import RunOptions
from inercal.host.web.access import Access
from inercal.host.web.device_catalogue import DeviceCatalogue
from inercal.host.web.folders import Plans, Runs
from inercal.host.web.hub import Hub
from inercal.host.web.json_objects import RefusalLog
from inercal.host.web.run_request import ProcessRequest, RunProcess, RunRequest
from inercal.host.web.server import WebServer, listening_socket, web_server

PATIENCE = 20.0  # s
HURRIED = RunOptions(speed=5.0)
COMPILING = 300.0  # s, the first time on a machine
RUNNING = 120.0  # s
SCRIPT = (sys.executable, str(Path(__file__).with_name("scripted_worker.py")))
SIMULATED = {"table": {"id": "simulated"}, "imu": {"id": "simulated"}}


def scripted(order: RunRequest) -> RunProcess:
    """Start the scripted run."""
    return RunProcess(order, SCRIPT)


class Page:
    """Somebody who looks on; `heard` is all but beats and marks, which come whenever they like."""

    def __init__(self, connecting: AbstractContextManager[ClientConnection]):
        self._connecting = connecting
        self.connection = connecting.__enter__()
        self.heard: list[dict[str, Any]] = []

    def say(self, command: str, **content: object) -> None:
        """Ask for something."""
        self.connection.send(json.dumps({"do": command, **content}))

    def next(self, patience: float = PATIENCE) -> dict[str, Any]:
        """Return the next message; marks are answered."""
        message: dict[str, Any] = json.loads(self.connection.recv(patience))
        if message["kind"] == "mark":
            self.say("seen", n=message["n"])
            return self.next(patience)
        if message["kind"] != "beat":
            self.heard.append(message)
        return message

    def until(self, kind: str, patience: float = PATIENCE, **content: object) -> dict[str, Any]:
        """Return the next message of a kind that says that."""
        end = monotonic() + patience
        while monotonic() < end:
            message = self.next(patience)
            if message["kind"] == kind and content.items() <= message.items():
                return message
        raise AssertionError(f"no {kind} {content} within {patience} s; heard {self.heard[-5:]}")

    def operate(self, name: str = "Ada") -> None:
        """Become operator."""
        self.say("operate", name=name)
        self.until("people", operator=name, yours=True)

    def start(self, **content: object) -> None:
        """Start the scripted run."""
        self.say("start", **({"plan": "demo", "sensor": None, **SIMULATED} | content))
        self.until("plan")

    def closed(self) -> int:
        """Hear all until the server closes the connection; return its code."""
        try:
            while True:
                self.next()
        except ConnectionClosed as error:
            return error.rcvd.code if error.rcvd is not None else 1006

    def close(self) -> None:
        """Close the page."""
        self._connecting.__exit__(None, None, None)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def as_header(cookies: Mapping[str, str]) -> dict[str, str]:
    """Return the header that says cookies; none for none."""
    said = "; ".join(f"{name}={value}" for name, value in cookies.items())
    return {"Cookie": said} if said else {}


def opened(
    port: int,
    origin: str | None = "own",
    host: str | None = None,
    cookies: Mapping[str, str] | None = None,
    *,
    slow: bool = False,
    tab: str = "",
    headers: Mapping[str, str] | None = None,
) -> Page:
    """Open a page of the server at a port; see `Served.page`."""
    host = host or f"127.0.0.1:{port}"
    return Page(
        connect(
            f"ws://{host}/live?tab={tab}",
            origin=f"http://{host}" if origin == "own" else origin,  # pyright: ignore[reportArgumentType]
            additional_headers=as_header(cookies or {}) | dict(headers or {}),
            sock=socket.create_connection(("127.0.0.1", port), PATIENCE),
            max_size=None,
            max_queue=4 if slow else None,
            close_timeout=0.2 if slow else PATIENCE,
            proxy=None,
        )
    )


def sockets(port: int, count: int) -> list[socket.socket]:
    """Open so many connections to the server, which is in this process too."""
    soft, hard = getrlimit(RLIMIT_NOFILE)
    wanted = 4 * count
    setrlimit(RLIMIT_NOFILE, (max(soft, min(wanted, hard)), hard))
    return [socket.create_connection(("127.0.0.1", port), PATIENCE) for _ in range(count)]


def unharmed(page: Page) -> None:
    """See the run go on, and hear commands."""
    page.until("samples")
    page.say("pause")
    page.until("state", paused="paused by the operator")
    page.say("go on")
    page.until("state", paused="")


class Served(AbstractContextManager["Served"]):
    """The server."""

    def __init__(
        self,
        folder: Path,
        token: str | None = None,
        start: Callable[[RunRequest], RunProcess] = scripted,
        table: str = "",
        options: RunOptions = HURRIED,
        read_token: str | None = None,
    ):
        self.refused: list[str] = []
        self._browsers: dict[str, dict[str, str]] = {}
        self.register = str(folder / "register.db")
        (folder / "runs").mkdir(exist_ok=True)
        (folder / "plans").mkdir(exist_ok=True)
        self.runs = Runs(folder / "runs")
        plans, choice = Plans(folder / "plans"), DeviceCatalogue(table)

        def begin(order: ProcessRequest) -> RunProcess:
            return start(order) if isinstance(order, RunRequest) else RunProcess(order)

        self.hub = Hub(plans, self.runs, choice, self.register, options, begin)
        self.socket = listening_socket("127.0.0.1", 0)
        self.port: int = self.socket.getsockname()[1]
        self.host = f"127.0.0.1:{self.port}"
        hosts = frozenset((self.host,)) if token is None else frozenset[str]()
        self.access = Access(hosts, token, read_token)
        refused = RefusalLog(self.refused.append)
        self.server: WebServer = web_server(self.hub, self.register, self.access, refused)
        self._up = Event()
        self._loop: asyncio.AbstractEventLoop | None = None
        self._thread = Thread(target=self._serve, name="server")
        self._thread.start()
        assert self._up.wait(PATIENCE)

    def viewer(self, which: str) -> dict[str, str]:
        """Return the cookies of a browser that has opened the page: of one name, the same."""
        if which not in self._browsers:
            (said,) = self.ask("/").cookies
            name, _, value = said.partition(";")[0].partition("=")
            self._browsers[which] = {name: value}
        return self._browsers[which]

    def page(
        self,
        origin: str | None = "own",
        host: str | None = None,
        cookies: Mapping[str, str] | None = None,
        *,
        slow: bool = False,
        tab: str = "",
        headers: Mapping[str, str] | None = None,
    ) -> Page:
        """Open a page; a slow one takes from its connection only what it is asked for."""
        return opened(self.port, origin, host, cookies, slow=slow, tab=tab, headers=headers)

    def ask(
        self,
        path: str,
        method: str = "GET",
        body: bytes | None = None,
        headers: Mapping[str, str] | None = None,
    ) -> "Answer":
        """Send a request as it stands, dots and all."""
        connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=PATIENCE)
        own = {"Host": self.host, **(headers or {})}
        if method == "POST" and "Origin" not in own:
            own["Origin"] = f"http://{own['Host']}"
        try:
            connection.putrequest(method, path, skip_host=True, skip_accept_encoding=True)
            for name, value in own.items():
                connection.putheader(name, value)
            if body is not None:
                connection.putheader("Content-Length", str(len(body)))
            connection.endheaders(body)
            return Answer(connection.getresponse())
        finally:
            connection.close()

    def wait(self, condition: Callable[[], object]) -> None:
        """Wait until something is so."""
        end = monotonic() + PATIENCE
        tick = Event()
        while not condition():
            assert monotonic() < end
            tick.wait(0.005)

    def take_port(self, port: int) -> None:
        """Let a browser reach the page by another port of this machine too."""
        self.access._hosts |= {f"127.0.0.1:{port}"}

    def was_refused(self, words: str) -> None:
        """Wait until something was refused, by what was said of it."""
        self.wait(lambda: any(words in line for line in self.refused))

    def soon(self, act: Callable[[], object]) -> None:
        """Have something done in the server's thread."""
        assert self._loop
        self._loop.call_soon_threadsafe(act)

    def __exit__(self, *_: object) -> None:
        self.soon(self.server.stop_run_and_exit)
        self._thread.join(PATIENCE)
        assert not self._thread.is_alive()

    def _serve(self) -> None:
        async def serve() -> None:
            self._loop = asyncio.get_running_loop()
            self._loop.call_soon(self._up.set)
            await self.server.serve(sockets=[self.socket])

        asyncio.run(serve())


class Answer:
    """What came back."""

    def __init__(self, response: http.client.HTTPResponse):
        self.status, self.body = response.status, response.read()
        self.headers = {name.lower(): value for name, value in response.getheaders()}
        self.cookies = [
            value for name, value in response.getheaders() if name.lower() == "set-cookie"
        ]

    @property
    def json(self) -> Any:
        """The body as JSON."""
        return json.loads(self.body)
