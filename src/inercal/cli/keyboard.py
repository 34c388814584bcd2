"""Keys of the terminal while a run goes on: p pauses, g goes on."""

import os
import sys
from collections.abc import Generator
from contextlib import contextmanager
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from inercal.host.bench_run import BenchRun

_POLL_INTERVAL = 0.2  # s


@contextmanager
def listen_to_keys(run: "BenchRun") -> Generator[None]:
    """Listen to the keys of a terminal; where there is none, do nothing."""
    if not sys.stdin.isatty():
        yield
        return
    import termios
    import tty
    from select import select
    from threading import Thread

    over = False
    terminal = sys.stdin.fileno()

    def listen() -> None:
        while not over:
            if not select([terminal], [], [], _POLL_INTERVAL)[0]:
                continue
            # Not by sys.stdin: it takes all that waits, and select knows nothing of its buffer.
            typed = os.read(terminal, 64)
            if not typed:
                return
            for key in typed:
                match chr(key):
                    case "p":
                        run.request("pause")
                    case "g":
                        run.request("go on")
                    case _:
                        pass

    before = termios.tcgetattr(sys.stdin)
    # Ctrl-C stays a signal, which the watchdog hears too.
    tty.setcbreak(sys.stdin)
    thread = Thread(target=listen, daemon=True)
    thread.start()
    try:
        yield
    finally:
        over = True
        thread.join()
        termios.tcsetattr(sys.stdin, termios.TCSADRAIN, before)
