"""The check of a driver: the template passes, and each planted fault is found by its check."""

from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path
from types import ModuleType
from typing import Any, NamedTuple

import pytest
from tests.base_seeds import slow
from tests.refusals import refused

from inercal.host.driver_check import CheckResult, check_driver
from inercal.host.driver_check.checks import CHECKS
from inercal.host.drivers.table_address import DRIVERS
from inercal.host.drivers.text_dialogue import TextDialogue
from inercal.host.sim.acutrol import SimulatedAcutrol
from inercal.host.sim.dynamics import LineSession
from inercal.host.sim.motor import SimulatedMotor
from inercal.host.sim.pmac import SimulatedPmac
from inercal.host.sim.server import SimulatorServer, SteppingClock

FOLDER = Path(__file__).parents[2] / "examples" / "own_driver"


class Fault(NamedTuple):
    """A mistake in a module of the template, and the checks that find it."""

    where: str
    right: str
    wrong: str
    found_by: set[str]


# A dialogue as many write it: it keeps the link, and takes whatever line comes next.
NAIVE = """
class TextDialogue:
    def __init__(self, address, ending, timeout):
        from inercal.host.link import open_link
        self.address, self._timeout, self._buffer = address, timeout, b""
        self._open = open_link
        self._link = open_link(address)

    def ask(self, line, urgent=False):
        try:
            self._link.write(line)
            while b"\\n" not in self._buffer:
                data = self._link.read(100, self._timeout)
                if not data:
                    raise ProtocolError("no reply")
                self._buffer += data
        except Exception as error:
            if type(error).__name__ == "LinkLost":
                self._link.close()
                self._link, self._buffer = self._open(self.address), b""
            raise
        text, _, self._buffer = self._buffer.partition(b"\\n")
        if not text.isascii():
            raise ProtocolError("not text")
        return text.decode()

    def close(self):
        self._link.close()


_NUMBER ="""
LAST = """        try:
            time, angle, rate, word = self._last = self._ask("STATE", 4)
        except Exception as error:
            if type(error).__name__ != "LinkLost" or not hasattr(self, "_last"):
                raise
            time, angle, rate, word = self._last
"""
ONE_LINK = """        if getattr(self, "_broken", False):
            raise ProtocolError("the link was lost")
        try:
            reply = self._dialogue.ask(f"{line}\\n".encode(), urgent=urgent)
        except Exception:
            self._broken = True
            raise
"""
STATE_LINE = '        time, angle, rate, word = self._ask("STATE", 4)\n'
ASK_LINE = '        reply = self._dialogue.ask(f"{line}\\n".encode(), urgent=urgent)\n'
CHECKED = "        self.checked_index(axis, rate, acceleration, angle)\n"

FAULTS = {
    "the soft limits are exchanged": Fault(
        "spindle",
        "acceleration, low, high)",
        "acceleration, high, low)",
        {"identity", "move", "after an error"},
    ),
    "a rate is sent without a check": Fault(
        "spindle", "self.checked_index(axis, rate, acceleration)\n", "pass\n", {"limits"}
    ),
    "the angle of a move is sent in rad": Fault(
        "spindle", '"MOVE", angle,', '"MOVE", radians(angle),', {"move", "after an error"}
    ),
    "a move is reported complete at once": Fault(
        "spindle",
        'in_position=word == "holds",\n            moving=word == "turns"',
        "in_position=True,\n            moving=False",
        {"move", "rate", "after an error"},
    ),
    "the sign of a rate is lost": Fault("spindle", '"SPIN", rate', '"SPIN", abs(rate)', {"rate"}),
    "the clock is taken for ms": Fault(
        "spindle",
        "TableState(self._number(time)",
        "TableState(1e-3 * self._number(time)",
        {"clock"},
    ),
    "the clock of the simulator stands still": Fault(
        "spindle_simulator", "{self.time:.3f}", "{0:.3f}", {"clock"}
    ),
    "the rate of the simulator is in rad/s": Fault(
        "spindle_simulator", "{degrees(report.rate):.4f}", "{report.rate:.4f}", {"rate", "clock"}
    ),
    "the simulator ignores a stop": Fault(
        "spindle_simulator",
        "                self.table.halt(0)\n                return",
        "                return",
        {"stop"},
    ),
    "a stop first asks for the state": Fault(
        "spindle",
        "stop_with_retry(lambda: self",
        "self.read()\n        (lambda call: call())(lambda: self",
        {"stop"},
    ),
    "after a lost link the last reading is returned": Fault(
        "spindle", STATE_LINE, LAST, {"lost link"}
    ),
    "a lost link is not opened again": Fault(
        "spindle", ASK_LINE, ONE_LINK, {"reconnection", "after an error"}
    ),
    "what is no number is taken for 0": Fault(
        "spindle",
        "        if _NUMBER.fullmatch(text)",
        "        if not _NUMBER.fullmatch(text):\n            return 0.0\n        if text",
        {"malformed replies"},
    ),
    "the link is kept after a missing reply": Fault("spindle", "_NUMBER =", NAIVE, {"late reply"}),
    "the goal is noted before the command is checked": Fault(
        "spindle", CHECKED, "        self._goal = angle\n" + CHECKED, {"after an error"}
    ),
    "close does nothing": Fault(
        "spindle", "self._dialogue.close()", "OPEN.append(self._dialogue)", {"close"}
    ),
}
# One for each part of a driver; `make slow` plants the others.
REPRESENTATIVE = {
    "the soft limits are exchanged",
    "the sign of a rate is lost",
    "a stop first asks for the state",
    "a lost link is not opened again",
    "what is no number is taken for 0",
}
GOAL = 'in_position=word == "holds"'
NEAR_GOAL = (
    f"{GOAL} and abs(self._angle(angle) - getattr(self, '_goal', self._angle(angle))) < 1e-3"
)


@contextmanager
def template(*changes: Fault) -> Generator[SimulatorServer[Any]]:
    """Serve the template's simulator, its driver being registered; both may be changed."""
    modules: dict[str, ModuleType] = {}
    left_open: list[Any] = []
    for name in ("spindle", "spindle_simulator"):
        text = (FOLDER / f"{name}.py").read_text(encoding="utf-8")
        for fault in (one for one in changes if one.where == name):
            assert text.count(fault.right) == 1
            text = text.replace(fault.right, fault.wrong)
            if "self._goal" in fault.wrong:
                text = text.replace(GOAL, NEAR_GOAL)
        modules[name] = ModuleType(name)
        vars(modules[name])["OPEN"] = left_open
        exec(compile(text, name, "exec"), vars(modules[name]))
    driver, simulator = modules["spindle"].DRIVER, modules["spindle_simulator"].SimulatedSpindle()
    with DRIVERS.with_("spindle", driver), SimulatorServer(simulator, SteppingClock()) as server:
        yield server
    for one in left_open:
        one.close()


def failed(results: tuple[CheckResult, ...]) -> set[str]:
    assert [one.name for one in results] == list(CHECKS)
    return {one.name for one in results if not one.passed}


def check(server: SimulatorServer[Any], address: str) -> tuple[CheckResult, ...]:
    return check_driver(address, now=lambda: server.device.time)


@pytest.mark.slow
def test_the_template_passes_in_both_forms_of_its_address():
    with template() as server:
        assert failed(check(server, f"spindle:{server.address}")) == set()
        assert failed(check(server, f"spindle://127.0.0.1:{server.port}")) == set()


@pytest.mark.parametrize(
    "name",
    [one if one in REPRESENTATIVE else pytest.param(one, marks=pytest.mark.slow) for one in FAULTS],
)
def test_a_planted_fault_is_found_by_the_checks_that_it_concerns(name: str):
    with template(FAULTS[name]) as server:
        results = check(server, f"spindle:{server.address}")
    assert failed(results) == FAULTS[name].found_by, results


def change(where: str, right: str, wrong: str) -> Fault:
    return Fault(where, right, wrong, set())


UNWRAPPED = change(
    "spindle",
    "TableState(self._number(time)",
    "TableState(self.unwrapped_time(self._number(time))",
)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("stated", "changes", "found_by"),
    [
        (0.4, (UNWRAPPED,), set[str]()),
        slow(0.4, (), {"clock"}),
        (400.0, (UNWRAPPED,), {"clock"}),
        slow(1e-3, (UNWRAPPED,), {"identity", "clock"}),
    ],
)
def test_a_clock_that_wraps_within_the_check_needs_the_right_period(
    stated: float, changes: tuple[Fault, ...], found_by: set[str]
):
    clock = change("spindle_simulator", "{self.time:.3f}", "{self.time % 0.4:.3f}")
    begins = "        self.unsupported = {"
    period = change("spindle", begins, f"        self.wrap_period = {stated}\n{begins}")
    with template(clock, period, *changes) as server:
        results = check(server, f"spindle:{server.address}")
    assert failed(results) == found_by, results


@pytest.mark.slow
def test_a_driver_for_a_network_only_passes_at_both_forms_of_its_address():
    with template(change("spindle", "address.link()", "address.tcp()")) as server:
        assert failed(check(server, f"spindle:{server.address}")) == set()
        assert failed(check(server, f"spindle://127.0.0.1:{server.port}")) == set()


class Echo(SimulatedMotor):
    """A controller that repeats each line, and ends it with CR LF."""

    ending = b"\n"

    def session(self) -> Any:
        return LineSession(self.ending, lambda line: f"{line!r}\r\n")


@pytest.mark.parametrize("ending", [b"\n", b"\r\n"])
def test_lines_that_end_with_cr_and_lf_are_read_without_them(ending: bytes):
    device = Echo()
    device.ending = ending
    with SimulatorServer(device) as server, TextDialogue(server.address, ending, 5.0) as dialogue:
        assert [dialogue.ask(b"A 1\r\n") for _ in range(2)] == ["'A 1'"] * 2


@pytest.mark.slow
@pytest.mark.parametrize(
    ("device", "address"),
    [
        (SimulatedMotor, "motor:tcp://127.0.0.1:{}"),
        (SimulatedAcutrol, "acutrol://127.0.0.1:{}?axes=1,2,3"),
        (SimulatedPmac, "pmac://127.0.0.1:{}?motors=1,2,3&counts=36000"),
    ],
)
def test_the_drivers_of_this_package_pass(device: type[Any], address: str):
    with SimulatorServer(device(), SteppingClock()) as server:
        assert failed(check(server, address.format(server.port))) == set()


@pytest.mark.parametrize(
    "address", ["pmac://192.0.2.1?motors=1&counts=1", "motor:serial:/dev/ttyS0", "spindel://h"]
)
def test_only_a_simulator_on_this_machine_is_checked(address: str):
    with refused():
        check_driver(address)
