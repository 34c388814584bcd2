"""`python -m inercal.host.guard TABLE_ADDRESS --silence 1.5`, with the host's pipe as its input."""

import os
import signal
import sys
from argparse import ArgumentParser
from contextlib import suppress

from inercal.host.guard.watchdog import Watchdog


def _say(line: str) -> None:
    # The host may be gone, or be frozen and its pipe full: neither keeps the table from stopping.
    with suppress(OSError):
        os.write(1, " ".join(line[:1000].split()).encode() + b"\n")


def _ignore_signal(*_: object) -> None:
    """Leave a signal to what it has written."""


def main() -> int:
    """Watch the table at the address given; return the status to exit with."""
    parser = ArgumentParser(prog="python -m inercal.host.guard", description="Guards a table.")
    parser.add_argument("address")
    parser.add_argument("--silence", type=float, default=1.5)
    parser.add_argument("--patience", type=float, default=600.0)
    options = parser.parse_args()
    signals, poke = os.pipe()
    for end in (signals, poke):
        os.set_blocking(end, False)
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.set_wakeup_fd(poke, warn_on_full_buffer=False)
    for number in (signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, _ignore_signal)  # ignored, it would write nothing
    # Before what else the machine does, where the system lets it.
    with suppress(OSError):
        os.setpriority(os.PRIO_PROCESS, 0, -20)
    if not os.isatty(1):
        os.set_blocking(1, False)
    return Watchdog(options.address, options.silence, options.patience, (0, signals), _say).run()


if __name__ == "__main__":
    sys.exit(main())
