"""Serves a simulated device over a real connection: TCP or a pseudo-terminal.

The device reads no clock. `pace` returns the bench time whenever bytes arrive, and `advance` lets
time pass from outside. The results are the same with a wall clock (`ScaledClock`) and with a clock
that is set (`ManualClock`).

If a simulator is a separate process (`serve`), it reads times and faults from its standard input.
"""

import os
import selectors
import socket
import sys
from argparse import ArgumentParser, Namespace
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from threading import RLock, Thread
from time import monotonic
from typing import Any, Generic, Protocol, Self, TextIO, TypeVar

from inercal.basics.errors import InputError
from inercal.host.sim.faults import Faults

_POLL_INTERVAL = 0.02  # s of wall time; then time passes even without a request
_READ_SIZE = 4096
_HOST = "127.0.0.1"


class Session(Protocol):
    """The device's side of one connection, which receives bytes and returns bytes."""

    def feed(self, data: bytes) -> bytes:
        """Process bytes that arrived, and return the answer that is sent at once."""
        ...


class Device(Protocol):
    """A device that a server can serve."""

    @property
    def time(self) -> float:
        """Bench time, s."""
        ...

    def advance(self, until: float) -> None:
        """Let bench time pass."""
        ...

    def session(self) -> Session:
        """Return a new session of the device, for a new connection."""
        ...

    def fault(self, words: str) -> None:
        """Set a fault of the device, or raise an `InputError` that lists the possible faults."""
        ...


D = TypeVar("D", bound=Device)


class ScaledClock:
    """Bench time that starts at 0 and passes faster than wall time by a factor."""

    def __init__(self, factor: float = 1.0):
        self._start, self._factor = monotonic(), factor

    def __call__(self) -> float:
        """Return bench time, s."""
        return (monotonic() - self._start) * self._factor


class ManualClock:
    """Bench time that stands still until it is set."""

    now: float = 0.0

    def __call__(self) -> float:
        """Return bench time, s."""
        return self.now


class SteppingClock:
    """Bench time that advances by a step, s, whenever it is read, so nobody must wait for it."""

    def __init__(self, step: float = 0.005):
        self._now, self._step = 0.0, step

    def __call__(self) -> float:
        """Return bench time, s."""
        self._now += self._step
        return self._now


class SimulatorServer(Generic[D]):
    """Serves a device on a local port (0 selects any free port) or on a pseudo-terminal.

    In a `with` block, the server runs in a separate thread. `open_link` can open its `address`.
    With `beside`, the event loop of another server, which has the same clock, serves this one.
    """

    def __init__(
        self,
        device: D,
        pace: Callable[[], float] | None = None,
        port: int = 0,
        terminal: bool = False,
        beside: "SimulatorServer[Any] | None" = None,
    ):
        self.device = device
        self.pace = pace or ManualClock()
        self.faults = Faults()
        self._stopped = False
        self._delayed_replies: list[tuple[float, _Connection, bytes]] = []
        self._connections: set[_Connection] = set()
        if beside is None:
            self.lock, self._selector = RLock(), selectors.DefaultSelector()
            self._wake_sender, woken = socket.socketpair()
            self.add_reader(woken, lambda: woken.recv(_READ_SIZE))
        else:
            self.lock, self._selector = beside.lock, beside._selector
            self._wake_sender = beside._wake_sender
        self._listener: socket.socket | None = None
        if terminal:
            line, path = _open_terminal(self.device.session())
            self.address = f"serial:{path}"
            self._add_connection(line)
        else:
            self._listener = socket.create_server((_HOST, port))
            self.add_reader(self._listener, self._accept)
            self.port: int = self._listener.getsockname()[1]
            self.address = f"tcp://{_HOST}:{self.port}"

    def run(self) -> None:
        """Serve until `stop` is called."""
        try:
            while not self._stopped:
                for key, _ in self._selector.select(_POLL_INTERVAL):
                    key.data()
                self._advance_time()
        finally:
            for line in self._connections:
                line.close()
            for key in list(self._selector.get_map().values()):
                if isinstance(key.fileobj, socket.socket):
                    key.fileobj.close()
            self._wake_sender.close()
            self._selector.close()

    def add_reader(self, end: socket.socket | int, ready: Callable[[], object]) -> None:
        """Make `run` call `ready` whenever `end` is readable; `run` closes `end` when it ends."""
        self._selector.register(end, selectors.EVENT_READ, ready)

    def remove_reader(self, end: socket.socket | int) -> None:
        """Stop watching `end`."""
        self._selector.unregister(end)

    def stop(self) -> None:
        """End `run`."""
        self._stopped = True
        # The loop may already be closed.
        with suppress(OSError):
            self._wake_sender.send(b".")

    def advance(self, until: float) -> None:
        """Let bench time pass up to `until`, s, if the clock can be set."""
        with self.lock:
            if isinstance(self.pace, ManualClock):
                self.pace.now = until
            self.device.advance(until)
        self._wake_sender.send(b".")

    def drop(self) -> None:
        """End all connections, as if a cable were unplugged."""
        with self.lock:
            for line in list(self._connections):
                self._remove_connection(line)

    def _advance_time(self) -> None:
        """Let time pass up to the present, and send the delayed replies that are due."""
        with self.lock:
            self.device.advance(self.pace())
            delayed, self._delayed_replies = self._delayed_replies, []
            for due, line, reply in delayed:
                if due <= self.device.time:
                    self._send(line, reply)
                else:
                    self._delayed_replies.append((due, line, reply))

    def _accept(self) -> None:
        assert self._listener is not None
        connection, _ = self._listener.accept()
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        receive = partial(connection.recv, _READ_SIZE)
        line = _Connection(
            connection, receive, connection.sendall, connection.close, self.device.session()
        )
        self._add_connection(line)

    def _add_connection(self, line: "_Connection") -> None:
        self._connections.add(line)
        self.add_reader(line.end, partial(self._serve, line))

    def _remove_connection(self, line: "_Connection") -> None:
        if not line.closed:
            self.remove_reader(line.end)
            self._connections.discard(line)
            line.close()

    def _serve(self, line: "_Connection") -> None:
        with self.lock:
            if line.closed:
                return
            try:
                data = line.receive()
            except OSError:
                data = b""
            if not data:
                self._remove_connection(line)
                return
            self.device.advance(self.pace())
            reply = line.session.feed(data)
            if reply and self.faults.delay:
                self._delayed_replies.append((self.device.time + self.faults.delay, line, reply))
            elif reply:
                self._send(line, reply)

    def _send(self, line: "_Connection", reply: bytes) -> None:
        pieces, ends = self.faults.apply_faults(reply)
        try:
            for piece in pieces:
                line.send(piece)
        except OSError:
            ends = True
        if ends:
            self._remove_connection(line)

    def __enter__(self) -> Self:
        self._thread = Thread(target=self.run, daemon=True)
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()
        self._thread.join()


@dataclass(eq=False)
class _Connection:
    """One end of a connection: a socket, or the descriptor of a pseudo-terminal."""

    end: socket.socket | int
    receive: Callable[[], bytes]
    _send: Callable[[bytes], object]
    _close: Callable[[], None]
    session: Session
    closed: bool = False

    def send(self, data: bytes) -> None:
        if self.closed:
            raise BrokenPipeError
        self._send(data)

    def close(self) -> None:
        if not self.closed:
            self.closed = True
            self._close()


def _open_terminal(session: Session) -> tuple[_Connection, str]:
    """Return the device's end of a pseudo-terminal, and the path of the host's end."""
    import pty
    import tty

    device, host = pty.openpty()
    tty.setraw(host)

    def send(data: bytes) -> None:
        while data:
            data = data[os.write(device, data) :]

    def close() -> None:
        os.close(device)
        os.close(host)

    # The host's end also stays open here, because it would hang up when no program has it open.
    line = _Connection(device, lambda: os.read(device, _READ_SIZE), send, close, session)
    return line, os.ttyname(host)


def simulator_parser(program: str, description: str | None, port: int | None = 0) -> ArgumentParser:
    """Return the parser of a simulator's options: `--port`, and `--pace` of its clock.

    Parameters
    ----------
    program : str
        Text that starts the program, for its help.
    description : str or None
    port : int or None
        Default of `--port`; None means a pseudo-terminal.
    """
    parser = ArgumentParser(prog=program, description=description)
    help_text = "port; 0 selects any free one"
    if port is None:
        help_text = "TCP port, 0: any free one; else a pseudo-terminal"
    parser.add_argument("--port", type=int, default=port, help=help_text)
    parser.add_argument(
        "--pace",
        default="1",
        help="bench seconds per second, such as 10; told: only `advance T` lets time pass",
    )
    return parser


def serve(device: Device, options: Namespace) -> None:
    """Serve until standard input ends; each input line sets a fault or advances the time.

    First, the address is printed in the form `at tcp://127.0.0.1:40123`. The answer to each input
    line is `ok` or an error. `advance 1.5` lets time pass if the clock can be set. The possible
    faults are defined in `faults` and by the device.
    """
    pace = ManualClock() if options.pace == "told" else ScaledClock(float(options.pace))
    terminal = options.port is None
    with SimulatorServer(device, pace, port=options.port or 0, terminal=terminal) as server:
        print(f"at {server.address}", flush=True)
        execute_commands(server, sys.stdin, sys.stdout)


def execute_commands(server: SimulatorServer[Any], told: TextIO, answers: TextIO) -> None:
    """Execute the time and fault commands in the lines of `told` until the input ends."""

    def tell(line: str) -> None:
        match line.split():
            case ["advance", until] if isinstance(server.pace, ManualClock):
                server.advance(float(until))
            case ["fault", *words]:
                with server.lock:
                    server.device.fault(" ".join(words))
            case _:
                with server.lock:
                    server.faults.set_fault(line)

    answer_lines(tell, told, answers)


def answer_lines(tell: Callable[[str], None], told: TextIO, answers: TextIO) -> None:
    """Pass each line of `told` to `tell`, and answer with `ok` or with an error."""
    for line in told:
        try:
            tell(line.strip())
            print("ok", file=answers, flush=True)
        except (InputError, ValueError) as error:
            print(f"no: {error}", file=answers, flush=True)
