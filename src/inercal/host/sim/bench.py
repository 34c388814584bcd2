"""A simulated turntable as a process: its Turbo PMAC, its time, and its motion told to the IMU.

Time passes as the wall's does, or is granted by the host through the clock's address, whose
protocol is that of `inercal.host.clock`: `until 12.5` and `now`, answered `TIME SENT SENT_BY`.

Run as `python -m inercal.host.sim.bench RUNFILE --seed 1 --motion unix:/tmp/inercal-x/motion`.
"""

import socket
import sys
from argparse import ArgumentParser
from functools import partial
from math import tau
from time import monotonic

import numpy as np

from inercal.errors import InputError
from inercal.host.sim import motion_link
from inercal.host.sim.errors import SimulatedErrors, draw
from inercal.host.sim.faults import number_in
from inercal.host.sim.motion_link import Part
from inercal.host.sim.pmac import SimulatedPmac
from inercal.host.sim.process import obey
from inercal.host.sim.server import Server, Session, WallClock
from inercal.runfile import read

COUNTS = 3_600_000  # in a turn
_MOST = 0.5  # s of motion in a part: the IMU keeps a few seconds
_PATIENCE = 5.0  # s of the wall for an IMU's answer; one that is slower has none


class Bench:
    """A table whose motion is told to an IMU.

    Parameters
    ----------
    drawn : SimulatedErrors
    imu : socket, optional
        Where its motion goes.
    """

    def __init__(self, drawn: SimulatedErrors, imu: socket.socket | None = None):
        i10 = 3713707
        period = i10 / 8388608e3
        self.pmac = SimulatedPmac(drawn.axes(period), COUNTS, i10)
        # What the run file allows, the controller allows too.
        for motor, limit in enumerate(drawn.bench.limits_of_axes, start=1):
            rate = max(limit.rate * COUNTS / tau * 1e-3, 4000.0)
            acceleration = max(limit.acceleration * COUNTS / tau * 1e-6, 2.0)
            line = f"I{motor}16={rate:.6f} I{motor}17={acceleration:.9f}"
            self.pmac.interpreter.line(line.encode(), 1)
        self.sent, self.sent_by = 0, 0.0
        self._imu = imu
        self._until = 0.0
        start = np.array([[(axis.start, 0.0, 0.0) for axis in self.pmac.table.axes]])
        self._ready = [Part(0.0, period, 0, start)]
        self._owed: list[float] = []

    @property
    def time(self) -> float:
        """Bench time, s."""
        return self.pmac.time

    def advance(self, until: float) -> None:
        """Let bench time pass; the next call, though no time may pass in it, tells the IMU.

        So that who asked for the time has its answer before the IMU, on the same processor maybe,
        sets to work.
        """
        self._tell()
        while self._until < until:
            self._until = min(self._until + _MOST, until)
            first = self.pmac.table.cycle + 1
            moved = self.pmac.table.turn(self._until)
            self._ready.append(Part(self._until, self.pmac.table.period, first, moved))

    def hear(self) -> None:
        """Wait until the IMU has sent what is due by what it was told."""
        while self._owed:
            self._hear()

    def settle(self) -> None:
        """Wait until the IMU has sent what is due by now."""
        self._tell()
        self.hear()

    def session(self) -> Session:
        """Return the controller's side of a new connection."""
        return self.pmac.session()

    def fault(self, words: str) -> None:
        """Set a fault of the table in words."""
        self.pmac.fault(words)

    def _tell(self) -> None:
        """Tell the IMU; hear of all but the last that it is done with."""
        for part in self._ready:
            if self._imu is None:
                self.sent_by = part.until
                continue
            try:
                motion_link.send(self._imu, part)
            except OSError:
                self._lose()
                continue
            self._owed.append(part.until)
            while len(self._owed) > 1:
                self._hear()
        self._ready.clear()

    def _hear(self) -> None:
        assert self._imu is not None
        try:
            self.sent = motion_link.answered(self._imu)
            self.sent_by = self._owed.pop(0)
        except OSError:
            self._lose()

    def _lose(self) -> None:
        """Go on without an IMU, as a table does."""
        if self._imu is not None:
            self._imu.close()
        self._imu = None
        self._owed.clear()


class Pace:
    """Bench time as it is granted; see `inercal.host.clock`.

    Parameters
    ----------
    silence : float
        s of the wall without a request after which time goes on by itself.
    """

    def __init__(self, silence: float = 5.0):
        self._silence = silence
        self._now = 0.0
        self._since: float | None = None  # of the wall, from which on time passes by itself

    def __call__(self) -> float:
        """Return bench time, s."""
        if self._since is not None and (passed := monotonic() - self._since) > 0:
            self._now += passed
            self._since += passed
        return self._now

    def grant(self, until: float) -> float:
        """Let time pass up to `until` and no further; return what time it is."""
        self._now = max(self(), until)
        self._since = monotonic() + self._silence
        return self._now

    def let_go(self) -> None:
        """Go on at the wall's pace from now on, if time was ever granted."""
        if self._since is not None:
            self._since = min(self._since, monotonic())


class ClockServer:
    """Serves the time of a bench, in the same loop as its controller.

    `address` is what `SimulatedClock` opens.
    """

    def __init__(self, server: Server[Bench], pace: Pace, port: int = 0):
        self._server, self._pace = server, pace
        self._listener = socket.create_server(("127.0.0.1", port))
        self._granted: set[socket.socket] = set()
        self.address = f"clock://127.0.0.1:{self._listener.getsockname()[1]}"
        server.attend(self._listener, self._accept)

    def _accept(self) -> None:
        end, _ = self._listener.accept()
        end.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._server.attend(end, partial(self._serve, end, bytearray()))

    def _serve(self, end: socket.socket, came: bytearray) -> None:
        try:
            data = end.recv(4096)
            came += data
            while b"\n" in came:
                line, _, rest = came.partition(b"\n")
                came[:] = rest
                end.sendall(self._answer(end, bytes(line)))
        except OSError:
            data = b""
        if not data:
            self._server.forget(end)
            end.close()
            if end in self._granted:
                self._granted.discard(end)
                self._pace.let_go()

    def _answer(self, end: socket.socket, line: bytes) -> bytes:
        device = self._server.device
        with self._server.lock:
            before = self._pace()
            match line.split():
                case [b"until", time] if abs(number_in(time)) < 1e9:
                    self._granted.add(end)
                    until = float(time)
                    now = self._pace.grant(until)
                case [b"now"]:
                    until, now = before, before
                case _:
                    return b"no: possible: until TIME, now\n"
            device.hear()
            device.advance(now)
            if until <= before:
                device.settle()
            return f"{now!r} {device.sent} {device.sent_by!r}\n".encode()


def main() -> None:
    """Serve until standard input ends, which tells faults; see `process.obey`."""
    parser = ArgumentParser(prog="python -m inercal.host.sim.bench", description=__doc__)
    parser.add_argument("run", metavar="RUNFILE")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--pace", default="granted", help="granted, or a factor of the wall's")
    parser.add_argument("--motion", help="where the IMU takes the motion, unix:PATH")
    parser.add_argument("--port", type=int, default=0, help="of the PMAC; 0: any free one")
    options = parser.parse_args()
    try:
        drawn = draw(read(options.run), options.seed)
        pace = Pace() if options.pace == "granted" else WallClock(float(options.pace))
        imu = motion_link.connect(options.motion, _PATIENCE) if options.motion else None
    except (InputError, OSError, ValueError) as error:
        print(f"no: {error}", flush=True)
        sys.exit(2)
    server = Server(Bench(drawn, imu), pace, port=options.port)
    clock = ClockServer(server, pace) if isinstance(pace, Pace) else None
    with server:
        print(f"at {server.address}" + (f" {clock.address}" if clock else ""), flush=True)
        obey(server, sys.stdin, sys.stdout)


if __name__ == "__main__":
    main()
