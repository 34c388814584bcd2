"""Where a simulated IMU's bytes go: a pseudo-terminal or TCP, which never hold it up for long.

What no buffer takes is lost, as where a port overruns.
"""

import os
import pty
import socket
import tty
from contextlib import suppress
from pathlib import Path
from time import monotonic, sleep
from typing import Protocol

_WRITE_TIMEOUT = 0.5  # s of the wall for a reader that is busy; one that was not there gets none
_RETRY_INTERVAL = 0.001  # s


class SimulatorPort(Protocol):
    """Takes bytes."""

    address: str

    def write(self, data: bytes) -> int:
        """Send what can be sent; return how many bytes that is."""
        ...

    def close(self) -> None:
        """Unplug it."""
        ...


class TerminalPort:
    """A pseudo-terminal; `path` becomes a link to it, so that it is there again if replugged."""

    def __init__(self, path: Path):
        self.address = f"serial:{path}"
        self._path = path
        # The host's end stays open here too: else it hangs up whenever no program has it open.
        self._device, self._host = pty.openpty()
        tty.setraw(self._host)
        os.set_blocking(self._device, False)
        path.symlink_to(os.ttyname(self._host))
        self._overrun = False

    def write(self, data: bytes) -> int:
        """As `SimulatorPort.write`."""
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
        """As `SimulatorPort.close`."""
        self._path.unlink(missing_ok=True)
        os.close(self._device)
        os.close(self._host)


class TcpPort:
    """A port of TCP; one host at a time, the last."""

    def __init__(self, port: int = 0):
        self._listener = socket.create_server(("127.0.0.1", port))
        self._listener.setblocking(False)
        self.port: int = self._listener.getsockname()[1]
        self.address = f"tcp://127.0.0.1:{self.port}"
        self._host: socket.socket | None = None

    def write(self, data: bytes) -> int:
        """As `SimulatorPort.write`."""
        # Whoever has connected by now gets these bytes, whichever process was faster.
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
            # How much of it arrived nobody knows: the connection ends.
            self._disconnect_host()
            return 0
        return len(data)

    def close(self) -> None:
        """As `SimulatorPort.close`."""
        self._disconnect_host()
        self._listener.close()

    def _disconnect_host(self) -> None:
        if self._host is not None:
            self._host.close()
            self._host = None
