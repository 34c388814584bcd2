"""Motion that nobody here has commanded: told from every motion that was."""

from collections.abc import Callable
from math import radians
from pathlib import Path

import pytest
from tests.base_seeds import evidence
from tests.host.in_process_bench import ADDRESSES, InProcessBench
from tests.host.simulated_runs import plan

from inercal.host.addresses import DeviceAddresses
from inercal.host.bench_run import BenchRun
from inercal.host.drivers.rotary_table import AxisState, TableState
from inercal.host.run_folder import create_run
from inercal.host.sequencer import (
    Command,
    HomeCommand,
    MoveCommand,
    SpinCommand,
    StopCommand,
)
from inercal.host.sim.pmac import SimulatedPmac
from inercal.host.table_driver import CommandedMotion

STEP = 0.02  # s between readings
ACCELERATION = radians(30)


class Axis:
    """An axis with a history of commands and readings."""

    def __init__(self, *, enabled: bool = True):
        self.checked, self.enabled = CommandedMotion(["outer"]), enabled
        self.time = self.angle = self.rate = 0.0
        self.found: str | None = None

    def told(self, command: Command) -> "Axis":
        self.checked.record(command)
        return self

    def goes(self, rate: float, seconds: float, *, hands_on: bool = False) -> "Axis":
        """Turn at a rate, °/s, that is reached by the usual acceleration."""
        end = self.time + seconds
        while self.time < end:
            change = radians(rate) - self.rate
            self.rate += max(min(change, ACCELERATION * STEP), -ACCELERATION * STEP)
            self.time += STEP
            self.angle += self.rate * STEP
            moving = self.rate != 0
            state = AxisState(
                self.angle, self.rate, 0.0, not moving, moving, self.enabled, homed=True
            )
            found = self.checked.check(TableState(self.time, (state,)), hands_on=hands_on)
            self.found = self.found or found
        return self


def move(angle: float, rate: float = 30.0) -> MoveCommand:
    return MoveCommand(0, radians(angle), radians(rate), ACCELERATION)


def spin(rate: float) -> SpinCommand:
    return SpinCommand(0, radians(rate), ACCELERATION)


COMMANDED: dict[str, Callable[[], Axis]] = {
    "a move that arrives": lambda: Axis().goes(0, 1).told(move(60)).goes(30, 2).goes(0, 3),
    "a move back out of a spin": lambda: (
        Axis().goes(0, 1).told(spin(30)).goes(30, 3).told(move(0)).goes(-30, 2).goes(0, 2)
    ),
    "a stop in a turn": lambda: (
        Axis().goes(0, 1).told(move(360)).goes(30, 3).told(StopCommand()).goes(0, 3)
    ),
    "a zero that is looked for": lambda: (
        Axis().goes(0, 1).told(HomeCommand()).goes(20, 2).goes(-5, 4).goes(0, 1)
    ),
    "spins one after the other": lambda: (
        Axis().goes(0, 1).told(spin(30)).goes(30, 3).told(spin(-10)).goes(-10, 5)
    ),
    "a move that begins late": lambda: (
        Axis().goes(0, 1).told(move(60)).goes(0, 1).goes(30, 2).goes(0, 2)
    ),
    "a table that coasts when it is found": lambda: Axis().goes(30, 4).goes(0, 3),
    "a hand that turns it without a servo": lambda: Axis(enabled=False).goes(0, 1).goes(30, 3),
    "an operator who nudges it": lambda: Axis().goes(0, 1).goes(2, 1, hands_on=True),
}
UNCOMMANDED: dict[str, Callable[[], Axis]] = {
    "a table at rest that turns": lambda: Axis().goes(0, 1).goes(30, 1),
    "a slow creep": lambda: Axis().goes(0, 1).goes(0.1, 8),
    "a turn with the operator at it": lambda: Axis().goes(0, 1).goes(30, 2, hands_on=True),
    "after an arrival": lambda: (
        Axis().goes(0, 1).told(move(60)).goes(30, 2).goes(0, 1.2).goes(-30, 1)
    ),
    "after a stop": lambda: Axis().goes(0, 1).told(StopCommand()).goes(0, 1).goes(5, 1),
    "a move that turns round": lambda: Axis().goes(0, 1).told(move(60)).goes(30, 1).goes(-30, 3),
    "a move that is passed": lambda: Axis().goes(0, 1).told(move(30)).goes(30, 4),
    "a move that is too fast": lambda: Axis().goes(0, 1).told(move(300, 10)).goes(30, 2),
    "a spin the other way": lambda: Axis().goes(0, 1).told(spin(30)).goes(30, 3).goes(-30, 4),
    "a spin that is too fast": lambda: Axis().goes(0, 1).told(spin(10)).goes(10, 3).goes(20, 2),
}


@pytest.mark.parametrize("name", COMMANDED)
def test_what_was_commanded_is_no_other_programs_motion(name: str):
    assert COMMANDED[name]().found is None


@pytest.mark.parametrize("name", UNCOMMANDED)
def test_what_was_not_commanded_is_said_to_be_another_programs(name: str):
    found = UNCOMMANDED[name]().found
    assert found is not None
    assert found.startswith("axis outer ")
    assert "another program commands the table" in found


class Disturbed(BenchRun):
    """A run whose table another program commands, soon after a phase of a step has begun."""

    line = b""
    at: tuple[str, str] = ("", "")
    ticks = 0
    bench: InProcessBench

    def _tick(self) -> None:
        task = self.sequencer.task
        self.ticks += task is not None and (task.label, self.sequencer.phase) == self.at
        if self.ticks == 10 and self.line:
            controller = self.bench.device.controller
            assert isinstance(controller, SimulatedPmac)
            assert controller.interpreter.execute_line(self.line, 1)[0] == b"\x06"
            self.line = b""
        super()._tick()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("label", "phase", "line"),
    [
        evidence("y up", "work", b"#2J=0"),  # out of a hold
        ("z+", "work", b"#1J-"),  # against the turn
        ("z+", "work", b"I322=5 I319=1 #3J=200000"),  # an axis that rests while another turns
        evidence("z+", "approach", b"#2J=3600000"),
    ],
)
def test_a_run_whose_table_another_program_commands_ends_with_the_table_stopped(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, label: str, phase: str, line: bytes
):
    run = plan(tmp_path / "plan")
    bench = InProcessBench(run)
    bench.install(monkeypatch)
    folder, journal = create_run(tmp_path / "run", run, ADDRESSES, 0.05)
    with journal, Disturbed(folder, journal, DeviceAddresses(*ADDRESSES)) as run_process:
        run_process.bench, run_process.line, run_process.at = bench, line, (label, phase)
        assert not run_process.execute_plan()
        assert not run_process.line
        assert "another program commands the table" in run_process.trouble
    assert not bench.device.controller.table.is_moving(0)
