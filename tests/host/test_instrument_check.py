"""The check of an instrument's driver: the driver for VISA passes, and faulty drivers fail."""

import json
import re
import sys
from contextlib import suppress
from pathlib import Path
from typing import Self

import pytest
from tests.base_seeds import evidence
from tests.host.guided_runs import Voltmeter, serve
from tests.host.visa_meters import Meters
from tests.program import run_program

from inercal.basics.errors import InputError
from inercal.host.driver_check import check_driver
from inercal.host.drivers.rotary_table import ProtocolError
from inercal.host.equipment import INSTRUMENTS, Reading
from inercal.host.link import Link, LinkLost, open_link
from inercal.host.sim.server import SimulatorServer

TIMEOUT = 0.4  # s; a busy machine keeps a reply waiting


def voltmeter() -> SimulatorServer[Voltmeter]:
    replies = {"*IDN?": "A,B,C,D\n", "READ?": "+1.25000000E+00\n", "OVER?": "9.9E37\n"}
    return serve(lambda line: replies[line])


@pytest.mark.slow
def test_the_driver_for_visa_passes_at_a_socket():
    with voltmeter() as server:
        address = f"visa:TCPIP0::{server.address[6:].replace(':', '::')}::SOCKET?backend=@py"
        results = check_driver(address, timeout=TIMEOUT, overloaded=f"{address}&query=OVER?")
    assert [(one.name, one.reason) for one in results if not one.passed] == []
    names = [one.name for one in results]
    assert names == ["readings", "short timeout", "close", "overload", "faulty link"]


def test_the_verb_checks_a_simulated_meter(tmp_path: Path):
    meters = Meters(tmp_path)
    done = run_program("bench", "check-driver", meters.counter(), "--json")
    assert done.status == 0
    assert {one["name"] for one in json.loads(done.output)} == {
        "readings", "short timeout", "close",
    }  # fmt: skip
    # Without an overload at the input, the check of the overload fails.
    overload = ("--overload", meters.voltmeter())
    assert run_program("bench", "check-driver", meters.voltmeter(), *overload).status == 1


class LineMeter:
    """A driver for lines over TCP, as another package has it; subclasses do one thing wrong."""

    def __init__(self, address: str, timeout: float):
        self.address, self.timeout = address.partition(":")[2], timeout
        self.link: Link | None = open_link(self.address)

    def identity(self) -> str:
        return ""

    def read(self) -> Reading:
        try:
            self.link = self.link or open_link(self.address)
            self.link.write(b"READ?\n")
            return self.reading(self.reply(self.link))
        except (LinkLost, ProtocolError):
            self.after_failure()
            raise

    def reply(self, link: Link) -> bytes:
        data = b""
        while not data.endswith(b"\n"):
            piece = link.read(100, self.timeout)
            if not piece:
                raise LinkLost("no reply")
            data += piece
        return data

    def reading(self, reply: bytes) -> Reading:
        try:
            value = float(reply)
        except ValueError:
            raise ProtocolError("not a number") from None
        if value > 9e36:
            raise InputError("overload")
        return Reading(value, "V")

    def after_failure(self) -> None:
        self.close()

    def close(self) -> None:
        if self.link is not None:
            self.link.close()
            self.link = None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


class WithoutReconnection(LineMeter):
    def after_failure(self) -> None:
        pass


class WithoutOverload(LineMeter):
    def reading(self, reply: bytes) -> Reading:
        try:
            return super().reading(reply)
        except InputError:
            return Reading(9.9e37, "V")


class WithoutUnit(LineMeter):
    def reading(self, reply: bytes) -> Reading:
        return Reading(super().reading(reply).value, "volts DC")


class WithLastReading(LineMeter):
    last = Reading(0.0, "V")

    def read(self) -> Reading:
        with suppress(LinkLost, ProtocolError):
            self.last = super().read()
        return self.last


class WithLateReply(LineMeter):
    def after_failure(self) -> None:
        if str(sys.exception()) != "no reply":
            self.close()


class WithLooseNumbers(LineMeter):
    def reading(self, reply: bytes) -> Reading:
        found = re.search(rb"[\d.]+(E[-+]?\d+)?", reply)
        return super().reading(found[0] if found else reply)


class ClosedOnce(LineMeter):
    def close(self) -> None:
        if self.link is None:
            raise OSError("closed already")
        super().close()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("kind", "checks"),
    [
        (LineMeter, set[str]()),
        (WithoutReconnection, {"faulty link"}),
        evidence(WithoutOverload, {"overload"}),
        (WithoutUnit, {"readings", "short timeout"}),
        evidence(WithLastReading, {"faulty link"}),
        (WithLateReply, {"faulty link"}),
        evidence(WithLooseNumbers, {"faulty link"}),
        evidence(ClosedOnce, {"close"}),
    ],
)
def test_a_faulty_driver_fails_a_check(kind: type[LineMeter], checks: set[str]):
    with (
        voltmeter() as server,
        serve(lambda _: "9.9E37\n") as other,
        INSTRUMENTS.with_("line", kind),
    ):
        overloaded = f"line:{other.address}"
        results = check_driver(f"line:{server.address}", timeout=0.4, overloaded=overloaded)
    assert {one.name for one in results if not one.passed} == checks
