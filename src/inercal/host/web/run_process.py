"""The server's side of a run's process: start, send, receive, stop.

It is the leader of a session of its own: what becomes of the server, or of the terminal that the
server was started from, does not reach it.
"""

import asyncio
import os
import signal
import sys
from collections.abc import AsyncGenerator
from contextlib import suppress
from subprocess import PIPE, Popen

from inercal.host.web.run_request import ProcessRequest

_MAX_MESSAGE = 1 << 20  # bytes of a message


class RunProcess:
    """The process of a run or of a manual session.

    Parameters
    ----------
    order : ProcessRequest
    command : sequence of str, optional
        Starts the process; the request's worker unless told.
    """

    def __init__(self, order: ProcessRequest, command: tuple[str, ...] = ()):
        self.order = order
        python = (sys.executable, "-P", "-m", order.worker)
        self._process = Popen(command or python, stdin=PIPE, stdout=PIPE, start_new_session=True)
        assert self._process.stdin
        os.set_blocking(self._process.stdin.fileno(), False)
        self.send_line(order.json_line)

    def send_line(self, line: str) -> bool:
        """Send a line to the process; False if it does not read."""
        assert self._process.stdin
        data = f"{line}\n".encode()
        try:
            return os.write(self._process.stdin.fileno(), data) == len(data)
        except OSError:
            return False

    def stop(self) -> None:
        """Stop the table: the signal's handler writes to the watchdog as soon as it arrives."""
        with suppress(ProcessLookupError):
            if self._process.poll() is None:
                os.killpg(self._process.pid, signal.SIGINT)

    async def messages(self) -> AsyncGenerator[tuple[str, str]]:
        """Yield kind and text of the process's messages until there are no more."""
        assert self._process.stdout
        reader = asyncio.StreamReader(_MAX_MESSAGE)
        protocol = asyncio.StreamReaderProtocol(reader)
        loop = asyncio.get_running_loop()
        transport, _ = await loop.connect_read_pipe(lambda: protocol, self._process.stdout)
        try:
            while line := await reader.readline():
                kind, _, text = line.decode("utf-8", "replace").rstrip("\n").partition(" ")
                yield kind, text
        except ValueError:
            return  # a line without an end is none of ours
        finally:
            transport.close()

    async def wait_for_exit(self) -> int:
        """Return the status of the process, once it has ended."""
        assert self._process.stdin
        with suppress(OSError):
            self._process.stdin.close()
        # In a thread: the process of a run that is stopped may take its time.
        return await asyncio.to_thread(self._process.wait)
