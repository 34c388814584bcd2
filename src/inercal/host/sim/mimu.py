"""A simulated IMU on a bench: it senses the true motion, and sends packets at its rate.

The simulated readings are those of the sensor in the run file, with the true coefficients and with
noise that was drawn in advance. Reading k, counted from 0, is sent at the time (k + 1)/rate of the
IMU's own clock, and its motion is earlier by the delay in `SimulatedErrors.latencies`. The bytes
are the same at any speed.

Each line of standard input sets a fault, and is answered by `ok` or by an error:

    fault loss 0.01      omits this fraction of the packets
    fault errors 1e-5    changes each byte with this probability
    fault silent on      sends nothing until `fault silent off`, but still counts readings
    fault unplug         removes the port until `fault replug`
    die                  ends the process at once, as if killed
    2 fault unplug       sets a fault of the second IMU, if there are several (`--imus`)

The bytes go to a pseudo-terminal or over TCP, which never delay the IMU for long. Bytes that no
buffer can take are lost, as when a real port overruns.

Run it as `python -m inercal.host.sim.mimu RUNFILE --seed 1 --preset fixed --terminal`.
"""

import os
import pty
import socket
import sys
import tty
from argparse import ArgumentParser
from collections.abc import Callable, Sequence
from contextlib import ExitStack, nullcontext, suppress
from functools import partial
from math import nan
from pathlib import Path
from tempfile import TemporaryDirectory
from threading import Lock, Thread
from time import monotonic, sleep
from typing import Protocol

import numpy as np

from inercal.basics.arrays import Array
from inercal.basics.closeable import Closeable
from inercal.basics.errors import InputError
from inercal.estimation.kernel_options import on_compilation
from inercal.host.packets import PacketLayout, read_layout
from inercal.host.packets.encode import PacketPacker
from inercal.host.sim import motion_link
from inercal.host.sim.faults import parse_number, unknown_fault
from inercal.host.sim.imu_model import SimulatedImu, draw_bias_drift, noise_block_size
from inercal.host.sim.server import answer_lines
from inercal.host.sim.simulated_errors import SimulatedErrors, draw_errors, numbered_imu
from inercal.runfile import Run, read

COMPILING = "compiling"  # printed before the address if kernels are compiled and not loaded
_WRITE_TIMEOUT = 0.5  # s of wall time to wait for a busy reader
_RETRY_INTERVAL = 0.001  # s


class SimulatorPort(Protocol):
    """A port to which bytes can be written."""

    address: str

    def write(self, data: bytes) -> int:
        """Send as many bytes as possible, and return their number."""
        ...

    def close(self) -> None:
        """Unplug the port."""
        ...


class TerminalPort:
    """A pseudo-terminal; the link `path` stays the same when it is unplugged and replugged."""

    def __init__(self, path: Path):
        self.address = f"serial:{path}"
        self._path = path
        # The host's end also stays open here, because it would hang up when no program has it open.
        self._device, self._host = pty.openpty()
        tty.setraw(self._host)
        os.set_blocking(self._device, False)
        path.symlink_to(os.ttyname(self._host))
        self._overrun = False

    def write(self, data: bytes) -> int:
        """Send as many bytes as possible, and return their number."""
        done, end = 0, None
        while True:
            with suppress(BlockingIOError):
                done += os.write(self._device, data[done:])
            if done == len(data):
                self._overrun = False
                return done
            end = end or monotonic() + _WRITE_TIMEOUT
            if self._overrun or monotonic() > end:
                self._overrun = True
                return done
            sleep(_RETRY_INTERVAL)

    def close(self) -> None:
        """Unplug the port."""
        self._path.unlink(missing_ok=True)
        os.close(self._device)
        os.close(self._host)


class TcpPort:
    """A TCP port for one host at a time; the latest connection replaces the earlier one."""

    def __init__(self, port: int = 0):
        self._listener = socket.create_server(("127.0.0.1", port))
        self._listener.setblocking(False)
        self.port: int = self._listener.getsockname()[1]
        self.address = f"tcp://127.0.0.1:{self.port}"
        self._host: socket.socket | None = None

    def write(self, data: bytes) -> int:
        """See `TerminalPort.write`."""
        # If a host has already connected, it gets these bytes, whichever process was faster.
        with suppress(BlockingIOError):
            host = self._listener.accept()[0]
            host.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            host.settimeout(_WRITE_TIMEOUT)
            self._disconnect_host()
            self._host = host
        if self._host is None:
            return 0
        try:
            self._host.sendall(data)
        except OSError:
            # It is unknown how many bytes arrived, so the connection is closed.
            self._disconnect_host()
            return 0
        return len(data)

    def close(self) -> None:
        """See `TerminalPort.close`."""
        self._disconnect_host()
        self._listener.close()

    def _disconnect_host(self) -> None:
        if self._host is not None:
            self._host.close()
            self._host = None


FAULT_SYNTAX = "fault loss P, fault errors P, fault silent on|off, fault unplug, fault replug, die"
_SPARE_NOISE = 300.0  # s of noise in addition to one and a half times the plan
_SOAK_NOISE = 4000.0  # s of noise for the wait before each soak


class PacketSender:
    """Makes packets from readings, applies the active faults, and sends the packets to a port.

    Parameters
    ----------
    packer : PacketPacker
    plug : callable
        Function that opens the port and returns it.
    seed : int
        Seed of the faults.
    """

    def __init__(self, packer: PacketPacker, plug: Callable[[], SimulatorPort], seed: int):
        self.sent = 0
        self.lock = Lock()
        self._packer, self._open_port = packer, plug
        self._port: SimulatorPort | None = plug()
        self.address = self._port.address
        self._loss = self._errors = 0.0
        self._silent = False
        self._rng = np.random.default_rng([seed, 2])

    def send(self, first: int, readings: np.ndarray, kelvin: float = nan) -> None:
        """Send readings, (n, 6), at a temperature; the first reading has the number `first`."""
        if not len(readings):
            return
        packets = self._packer(first, readings, kelvin)
        with self.lock:
            if self._loss:
                lost = (self._rng.random(len(packets)) < self._loss).tolist()
                packets = [p for p, gone in zip(packets, lost, strict=True) if not gone]
            data = b"".join(packets)
            if self._errors:
                data = self._corrupt_bytes(data)
            if self._port is not None and not self._silent and data:
                self.sent += self._port.write(data)

    def set_fault(self, words: str) -> None:
        """Set a fault from its text, or raise an `InputError` that lists the possible faults."""
        with self.lock:
            match words.split():
                case ["die"]:
                    os._exit(9)
                case ["fault", "loss" | "errors" as what, share] if 0 <= parse_number(share) <= 1:
                    setattr(self, f"_{what}", float(share))
                case ["fault", "silent", "on" | "off" as state]:
                    self._silent = state == "on"
                case ["fault", "unplug"]:
                    self.close()
                case ["fault", "replug"]:
                    self._port = self._port or self._open_port()
                case _:
                    raise unknown_fault(words, FAULT_SYNTAX)

    def close(self) -> None:
        """Unplug the port."""
        if self._port is not None:
            self._port.close()
            self._port = None

    def _corrupt_bytes(self, data: bytes) -> bytes:
        """Return the bytes, some of them changed at random."""
        bad = np.frombuffer(data, np.uint8).copy()
        places = np.flatnonzero(self._rng.random(bad.size) < self._errors)
        bad[places] ^= self._rng.integers(1, 256, places.size, dtype=np.uint8)
        return bad.tobytes()


def serve_motion(end: socket.socket, imus: Sequence[tuple[SimulatedImu, PacketSender]]) -> None:
    """Answer each block of motion after all IMUs have sent the readings that are due."""
    # If the table is gone, there is no more motion.
    with suppress(OSError):
        while (part := motion_link.receive(end)) is not None:
            for imu, sender in imus:
                first = imu.next_number
                sender.send(first, imu.read_block(part), part.temperature)
            motion_link.send_byte_counts(end, *(sender.sent for _, sender in imus))


class MotionServer(Closeable):
    """Serves one table connection after another in a thread, until `close`.

    Parameters
    ----------
    listener : socket
        Listening socket, which is closed together with the server.
    imus : sequence of (SimulatedImu, PacketSender)
    """

    def __init__(self, listener: socket.socket, imus: Sequence[tuple[SimulatedImu, PacketSender]]):
        self._listener, self._imus = listener, imus
        self._table: socket.socket | None = None
        self._lock, self._closed = Lock(), False
        self._thread = Thread(target=self._serve, daemon=True)
        self._thread.start()

    def _serve(self) -> None:
        while True:
            try:
                end, _ = self._listener.accept()
            except OSError:  # `close` has closed the socket
                return
            with end:
                with self._lock:
                    if self._closed:
                        return
                    self._table = end
                serve_motion(end, self._imus)
                with self._lock:
                    self._table = None

    def close(self) -> None:
        """End the thread, whatever it is waiting for."""
        with self._lock:
            self._closed = True
            for end in (self._listener, self._table):
                if end is not None:
                    with suppress(OSError):  # the table may have disconnected
                        end.shutdown(socket.SHUT_RDWR)
        self._thread.join()
        self._listener.close()


def packet_rate(run: Run, layout: PacketLayout, rate_hz: float | None) -> float:
    """Return the packet rate: as requested, or from the layout, or from the run's data.

    Raises
    ------
    InputError
        The requested rate differs from the rate of the layout, or no rate is known.
    """
    rate = rate_hz or layout.rate_hz or run.rate_hz
    if rate is None:
        raise InputError(
            f"[data] rate is missing, and {layout.name!r} states no rate; "
            'add it, such as rate = "200 Hz"',
            key="[data] rate",
            names=(layout.name,),
        ).located(run.path)
    if not (0 < rate < 1e5 and rate == (layout.rate_hz or rate)):
        raise InputError(
            f"sample rate {rate:g} Hz is not possible; "
            + (
                "give a rate above 0 and below 100 kHz"
                if layout.rate_hz is None
                else f"give {layout.rate_hz:g} Hz, the rate of {layout.name!r} packets"
            ),
            key="rate",
            names=(layout.name,),
        )
    return rate


def noise_duration(run: Run, drawn: SimulatedErrors) -> float:
    """Return the duration of one block of noise, s."""
    plan = 1.5 * run.kind.seconds(drawn.bench, run.steps)
    soaks = () if run.environment is None else run.environment.soaks
    return max(len(soaks), 1) * plan + len(soaks) * _SOAK_NOISE + _SPARE_NOISE


def mean_drift(
    run: Run, drawn: SimulatedErrors, rate_hz: float, start: float, stop: float
) -> Array:
    """Return the mean drift of the biases in the readings between two times, (m,), SI.

    Parameters
    ----------
    run : Run
    drawn : SimulatedErrors
    rate_hz : float
        Sampling rate.
    start, stop : float
        Times of the IMU's clock, s. They must be within the first block of noise.
    """
    count = noise_block_size(noise_duration(run, drawn), rate_hz)
    drift = draw_bias_drift(run.sensor, drawn.seed, count, rate_hz)
    return drift[int(start * rate_hz) : int(stop * rate_hz)].mean(axis=0)


def main() -> None:
    """Sense motion and send packets until standard input ends."""
    parser = ArgumentParser(prog="python -m inercal.host.sim.mimu", description=__doc__)
    parser.add_argument("run", metavar="RUNFILE")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument(
        "--preset", default="fixed", help="packet preset, or a file that describes the packets"
    )
    parser.add_argument("--rate", type=float, help="packet rate, Hz")
    parser.add_argument("--imus", type=int, default=1, help="number of IMUs")
    where = parser.add_mutually_exclusive_group()
    where.add_argument("--terminal", action="store_true", help="use a pseudo-terminal, not TCP")
    where.add_argument("--port", type=int, default=0, help="TCP port; 0: any free one")
    parser.add_argument("--folder", type=Path, help="folder of the sockets; temporary by default")
    parser.add_argument("--announce-compilation", action="store_true", help="before the address")
    announce = partial(print, COMPILING, flush=True)
    options = parser.parse_args()
    with ExitStack() as stack:
        own = TemporaryDirectory(prefix="inercal-")
        folder: Path = options.folder or Path(stack.enter_context(own))
        # The table can connect while the following code compiles.
        listener, motion = motion_link.listen(folder / motion_link.SOCKET_NAME)
        stack.enter_context(listener)
        try:
            run = read(options.run)
            layout = read_layout(options.preset)
            drawn = draw_errors(run, options.seed)
            rate = packet_rate(run, layout, options.rate)
            seconds = noise_duration(run, drawn)
            with on_compilation(announce) if options.announce_compilation else nullcontext():
                imus = [
                    SimulatedImu(*numbered_imu(run, drawn, number), rate, seconds)
                    for number in range(1, options.imus + 1)
                ]
                packer = PacketPacker(layout, rate)
        except InputError as error:
            print(f"no: {error}", flush=True)
            sys.exit(2)
        ports = {"": options.port}

        def plug(number: str) -> SimulatorPort:
            if options.terminal:
                return TerminalPort(folder / f"imu{number}")
            # When the port is replugged, it has the same path.
            opened = TcpPort(ports.get(number, 0))
            ports[number] = opened.port
            return opened

        senders = {
            number: PacketSender(packer, partial(plug, number), options.seed + k)
            for k, number in enumerate(["", *map(str, range(2, options.imus + 1))])
        }

        def set_fault(words: str) -> None:
            number, _, rest = words.partition(" ")
            known = number in senders
            senders[number if known else ""].set_fault(rest if known else words)

        sending = list(zip(imus, senders.values(), strict=True))
        stack.enter_context(MotionServer(listener, sending))
        print("at", *(one.address for one in senders.values()), f"motion {motion}", flush=True)
        answer_lines(set_fault, sys.stdin, sys.stdout)
        for one in senders.values():
            with one.lock:
                one.close()


if __name__ == "__main__":
    main()
