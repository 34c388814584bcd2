"""A simulator as a process: what it serves, at what pace, and what its standard input tells it."""

import sys
from argparse import ArgumentParser, Namespace
from collections.abc import Callable
from typing import Any, TextIO

from inercal.basics.errors import InputError
from inercal.host.sim.server import Device, ManualClock, ScaledClock, SimulatorServer


def serve(device: Device, pace: Callable[[], float], port: int, terminal: bool = False) -> None:
    """Serve until standard input ends, which tells faults and time, a line each.

    The address is printed first, as `at tcp://127.0.0.1:40123`; each line told is answered by `ok`
    or by what is wrong. `advance 1.5` lets time pass where it is granted; the faults are those of
    `faults` and of the device.
    """
    with SimulatorServer(device, pace, port=port, terminal=terminal) as server:
        print(f"at {server.address}", flush=True)
        execute_commands(server, sys.stdin, sys.stdout)


def execute_commands(server: SimulatorServer[Any], told: TextIO, answers: TextIO) -> None:
    """Do what each line of `told` says of time and faults, until there is no more."""

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
    """Hand each line of `told` to `tell`, and answer by `ok` or by its error."""
    for line in told:
        try:
            tell(line.strip())
            print("ok", file=answers, flush=True)
        except (InputError, ValueError) as error:
            print(f"no: {error}", file=answers, flush=True)


def add_pace_option(parser: ArgumentParser) -> None:
    """Add the option `--pace`: a factor of the wall clock, or `told`."""
    parser.add_argument(
        "--pace",
        default="1",
        help="bench time per second, such as 10; told: it advances by `advance T` alone",
    )


def selected_pace(options: Namespace) -> Callable[[], float]:
    """Return the pace that `--pace` asks for."""
    return ManualClock() if options.pace == "told" else ScaledClock(float(options.pace))
