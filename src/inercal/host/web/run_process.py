"""The process of a run, as the server sees it: start, send, receive and stop.

The process has its own session, so it is not affected if the server ends or the terminal from which
the server was started is closed.
"""

import asyncio
import os
import signal
import sys
from collections.abc import AsyncGenerator
from contextlib import suppress
from subprocess import PIPE, Popen

from inercal.host.web.run_request import ProcessRequest

_MAX_MESSAGE = 1 << 20  # largest number of bytes in a message


class RunProcess:
    """The process for a run or a manual session.

    Parameters
    ----------
    order : ProcessRequest
    command : sequence of str, optional
        Command that starts the process; by default, it starts the worker of the request.
    """

    def __init__(self, order: ProcessRequest, command: tuple[str, ...] = ()):
        self.order = order
        python = (sys.executable, "-P", "-m", order.worker)
        self._process = Popen(command or python, stdin=PIPE, stdout=PIPE, start_new_session=True)
        assert self._process.stdin
        os.set_blocking(self._process.stdin.fileno(), False)
        self.send_line(order.json_line)

    def send_line(self, line: str) -> bool:
        """Send a line to the process; return False if the process does not read its input."""
        assert self._process.stdin
        data = f"{line}\n".encode()
        try:
            return os.write(self._process.stdin.fileno(), data) == len(data)
        except OSError:
            return False

    def stop(self) -> None:
        """Stop the table; the signal handler of the process informs the watchdog immediately."""
        with suppress(ProcessLookupError):
            if self._process.poll() is None:
                os.killpg(self._process.pid, signal.SIGINT)

    async def messages(self) -> AsyncGenerator[tuple[str, str]]:
        """Yield the kind and text of each message from the process until its output ends."""
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
            return  # an unterminated line is not a complete message
        finally:
            transport.close()

    async def wait_for_exit(self) -> int:
        """Wait until the process has ended, and return its exit status."""
        assert self._process.stdin
        with suppress(OSError):
            self._process.stdin.close()
        # The wait is in a thread, because a run that is being stopped may need some time to end.
        return await asyncio.to_thread(self._process.wait)
