"""The process of a simulated table: its controller, its clock, and its motion for the IMU.

A turntable has a Turbo PMAC as its controller, and a rate table has a motor's controller.

Time passes like wall time, or the host grants it through the address of the clock, by the protocol
in `inercal.host.clock`. Without granted time, an operator reports a mounting as a fault of the
table, such as `fault mounted XY30`.

Run it as `python -m inercal.host.sim.bench_simulator RUNFILE --seed 1 --motion unix:/tmp/x/motion`.
"""

import socket
import sys
from argparse import ArgumentParser
from functools import partial
from math import nan, tau
from time import monotonic

import numpy as np

from inercal.basics.errors import InputError
from inercal.benches.motion_control import SpinTask
from inercal.host.sim import motion_link
from inercal.host.sim.chamber import SimulatedScpiChamber
from inercal.host.sim.faults import parse_number
from inercal.host.sim.motion_link import MotionBlock
from inercal.host.sim.motor import SimulatedMotor
from inercal.host.sim.pmac import SimulatedPmac
from inercal.host.sim.server import ScaledClock, Session, SimulatorServer, execute_commands
from inercal.host.sim.simulated_errors import SimulatedErrors, draw_errors
from inercal.runfile import read

COUNTS_PER_TURN = 3_600_000  # encoder counts per turn
_MAX_BLOCK = 0.5  # s of motion in one block; the IMU stores a few seconds
_CONNECT_TIMEOUT = 5.0  # s of wall time to wait for the IMU's process
# Wall time to wait for the IMU's answer, s. A bench whose time the host controls stands still
# meanwhile, so this is less than the timeout of the host. A bench that runs by itself can hardly
# wait.
_GRANTED_ANSWER_TIMEOUT, _PACED_ANSWER_TIMEOUT = 15.0, 0.2
_MAX_BACKLOG = 120.0  # s of motion that are stored while the IMU does not answer


class BenchDevice:
    """A simulated table that sends its motion to an IMU.

    Parameters
    ----------
    drawn : SimulatedErrors
    imu : socket, optional
        Socket to which the motion is sent.
    answer_timeout : float
        Wall time to wait for the IMU's answer, s. If the IMU answers later, for example because its
        process was stopped, the motion that it missed is sent then.
    in_chamber : bool
        Whether the IMU has the temperature of a case in the chamber, and not a constant one.

    Attributes
    ----------
    mounting : str
        Present mounting of the sensor; empty if the sensor was never mounted.
    bytes_sent, further_bytes : int, list of int
        Number of bytes that the IMU, and each further IMU, has sent.
    """

    def __init__(
        self,
        drawn: SimulatedErrors,
        imu: socket.socket | None = None,
        answer_timeout: float = _GRANTED_ANSWER_TIMEOUT,
        *,
        in_chamber: bool = False,
    ):
        self.controller = _create_controller(drawn)
        period = self.controller.table.period
        self._mountings = {
            task.mounting
            for task in drawn.motion_control.tasks(drawn.bench, drawn.steps)
            if isinstance(task, SpinTask)
        }
        self.mounting = ""
        self.chamber, self._in_chamber = SimulatedScpiChamber(), in_chamber
        self.bytes_sent, self.further_bytes, self.sent_until = 0, list[int](), 0.0
        self._imu, self._answer_timeout = imu, answer_timeout
        self._imu_is_late = False  # whether the last answer was not in time
        self._until = 0.0
        start = np.array([[(axis.start, 0.0, 0.0) for axis in self.controller.table.axes]])
        self._unsent_blocks = [MotionBlock(0.0, period, 0, start)]
        self._unacknowledged: list[float] = []

    @property
    def time(self) -> float:
        """Bench time, s."""
        return self.controller.time

    def advance(self, until: float) -> None:
        """Let bench time pass; the next call sends the motion to the IMU, even if no time passes.

        In this way, a client that requests the time gets the answer before the IMU, which may run
        on the same processor, starts to work.
        """
        self._send_motion()
        while self._until < until:
            self._until = min(self._until + _MAX_BLOCK, until)
            first = self.controller.table.cycle + 1
            moved = self.controller.table.advance(self._until)
            self.chamber.advance(self._until)
            kelvin = self.chamber.case_temperature if self._in_chamber else nan
            period = self.controller.table.period
            self._unsent_blocks.append(
                MotionBlock(self._until, period, first, moved, self.mounting, kelvin)
            )

    def receive_acknowledgements(self) -> None:
        """Wait until the IMU has sent all packets that are due for the received motion."""
        while self._unacknowledged and self._receive_acknowledgement():
            pass

    def synchronise_imu(self) -> None:
        """Wait until the IMU has sent all packets that are due now."""
        self._send_motion()
        self.receive_acknowledgements()

    def mount(self, mounting: str) -> None:
        """Mount the sensor before the next motion; raises `InputError` for an unknown mounting."""
        if mounting not in self._mountings:
            raise InputError(
                f"{mounting!r} is not a mounting of the plan; possible: "
                f"{', '.join(sorted(self._mountings)) or 'none'}",
                key="mounted",
                names=(mounting,),
            )
        self.mounting = mounting

    def session(self) -> Session:
        """Return a new session of the controller, for a new connection."""
        return self.controller.session()

    def fault(self, words: str) -> None:
        """Set a fault of the table, or of the chamber after `chamber`, or mount: `mounted XY30`."""
        what, _, rest = words.partition(" ")
        if what == "mounted":
            self.mount(rest)
        elif what == "chamber":
            self.chamber.fault(rest)
        else:
            self.controller.fault(words)

    def _send_motion(self) -> None:
        """Send blocks to the IMU, and wait for the answers to all blocks except the last."""
        while self._unsent_blocks:
            if self._imu is None:
                self.sent_until = self._unsent_blocks[-1].end_time
                self._unsent_blocks.clear()
                return
            if self._imu_is_late and not self._receive_acknowledgement():
                if self._until - self._unsent_blocks[0].end_time > _MAX_BACKLOG:
                    self._disconnect_imu()
                return
            part = self._unsent_blocks.pop(0)
            try:
                motion_link.send(self._imu, part)
                self._unacknowledged.append(part.end_time)
            except OSError:
                self._disconnect_imu()
            while len(self._unacknowledged) > 1 and self._receive_acknowledgement():
                pass

    def _receive_acknowledgement(self) -> bool:
        """Wait for the IMU's answer to a block; return False if it does not arrive in time."""
        if self._imu is None:
            return False
        try:
            # If the IMU is already late, do not wait again.
            timeout = 0.0 if self._imu_is_late else self._answer_timeout
            sent = motion_link.receive_byte_counts(self._imu, timeout)
        except OSError:
            self._disconnect_imu()
            return False
        self._imu_is_late = sent is None
        if sent is not None:
            self.bytes_sent, *self.further_bytes = sent
            self.sent_until = self._unacknowledged.pop(0)
        return sent is not None

    def _disconnect_imu(self) -> None:
        """Continue without an IMU, as a real table does."""
        if self._imu is not None:
            self._imu.close()
        self._imu = None
        self._unacknowledged.clear()


def _create_controller(drawn: SimulatedErrors) -> SimulatedPmac | SimulatedMotor:
    """Return the controller of a turntable or of a rate table."""
    if not drawn.motion_control.has_attitude:
        return SimulatedMotor()
    i10 = 3713707
    pmac = SimulatedPmac(drawn.axes(i10 / 8388608e3), COUNTS_PER_TURN, i10)
    # The limits of the controller permit everything that the run file permits.
    for motor, limit in enumerate(drawn.bench.axis_motion_limits, start=1):
        rate = max(limit.rate * COUNTS_PER_TURN / tau * 1e-3, 4000.0)
        acceleration = max(limit.acceleration * COUNTS_PER_TURN / tau * 1e-6, 2.0)
        line = f"I{motor}16={rate:.6f} I{motor}17={acceleration:.9f}"
        pmac.interpreter.execute_line(line.encode(), 1)
    return pmac


class GrantedClock:
    """Bench time that the host controls; see `inercal.host.clock`.

    Parameters
    ----------
    silence : float
        Wall time without a request after which bench time passes by itself, s.
    """

    def __init__(self, silence: float = 5.0):
        self._silence = silence
        self._now = 0.0
        self._since: float | None = None  # wall time at which it began to pass by itself

    def __call__(self) -> float:
        """Return bench time, s."""
        if self._since is not None and (passed := monotonic() - self._since) > 0:
            self._now += passed
            self._since += passed
        return self._now

    def grant(self, until: float) -> float:
        """Let time pass up to `until`, but not further; return the bench time."""
        self._now = max(self(), until)
        self._since = monotonic() + self._silence
        return self._now

    def release(self) -> None:
        """From now on, let bench time pass like wall time, if a host has controlled it."""
        if self._since is not None:
            self._since = min(self._since, monotonic())


class ClockServer:
    """Serves the clock of a bench, in the same event loop as the controller.

    `SimulatedClock` connects to `address`.
    """

    def __init__(self, server: SimulatorServer[BenchDevice], pace: GrantedClock, port: int = 0):
        self._server, self._pace = server, pace
        self._listener = socket.create_server(("127.0.0.1", port))
        self._granted: set[socket.socket] = set()
        self.address = f"clock://127.0.0.1:{self._listener.getsockname()[1]}"
        server.add_reader(self._listener, self._accept)

    def _accept(self) -> None:
        end, _ = self._listener.accept()
        end.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._server.add_reader(end, partial(self._serve, end, bytearray()))

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
            self._server.remove_reader(end)
            end.close()
            if end in self._granted:
                self._granted.discard(end)
                self._pace.release()

    def _answer(self, end: socket.socket, line: bytes) -> bytes:
        device = self._server.device
        with self._server.lock:
            before = self._pace()
            match line.split():
                case [b"until", time] if abs(parse_number(time)) < 1e9:
                    self._granted.add(end)
                    until = float(time)
                    now = self._pace.grant(until)
                case [b"now"]:
                    until, now = before, before
                case [b"mounted", name]:
                    try:
                        device.mount(name.decode("utf-8", "replace"))
                    except InputError as error:
                        return f"no: {error}\n".encode()
                    until, now = before, before
                case _:
                    return b"no: possible: until TIME, now, mounted NAME\n"
            device.receive_acknowledgements()
            device.advance(now)
            if until <= before:
                device.synchronise_imu()
            further = "".join(f" {count}" for count in device.further_bytes)
            return f"{now!r} {device.bytes_sent} {device.sent_until!r}{further}\n".encode()


def main() -> None:
    """Serve until standard input ends; each input line sets a fault."""
    parser = ArgumentParser(prog="python -m inercal.host.sim.bench_simulator", description=__doc__)
    parser.add_argument("run", metavar="RUNFILE")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--pace", default="granted", help="granted, or bench seconds per second")
    parser.add_argument("--motion", help="address to which the IMU's motion is sent, unix:PATH")
    parser.add_argument("--port", type=int, default=0, help="port of the PMAC; 0: any free one")
    options = parser.parse_args()
    try:
        run = read(options.run)
        drawn = draw_errors(run, options.seed)
        pace = GrantedClock() if options.pace == "granted" else ScaledClock(float(options.pace))
        imu = motion_link.connect(options.motion, _CONNECT_TIMEOUT) if options.motion else None
    except (InputError, OSError, ValueError) as error:
        print(f"no: {error}", flush=True)
        sys.exit(2)
    granted = isinstance(pace, GrantedClock)
    timeout = _GRANTED_ANSWER_TIMEOUT if granted else _PACED_ANSWER_TIMEOUT
    in_chamber = run.environment is not None and bool(run.environment.soaks)
    device = BenchDevice(drawn, imu, timeout, in_chamber=in_chamber)
    server = SimulatorServer(device, pace, port=options.port)
    clock = ClockServer(server, pace) if isinstance(pace, GrantedClock) else None
    chamber = SimulatorServer(device.chamber, pace, beside=server)
    with server:
        at_chamber = device.chamber.driver_address(chamber.address)
        print(f"at {server.address} {at_chamber}", *([clock.address] if clock else []), flush=True)
        execute_commands(server, sys.stdin, sys.stdout)


if __name__ == "__main__":
    main()
