"""What pauses a run and what ends it, and in which order the table and the operator are told."""

from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import dataclass, field

import pytest

from inercal.basics.errors import InputError
from inercal.host.interruptions import Interruptions
from inercal.host.sequencer import Command, StopCommand


@dataclass
class Sequencer:
    phase: str = "work"
    is_over: bool = False

    def pause(self, time: float) -> list[Command]:
        self.phase = "paused"
        return [StopCommand()]

    def abort(self, time: float) -> list[Command]:
        self.phase, self.is_over = "aborted", True
        return [StopCommand()]

    def resume(self) -> None:
        self.phase = "approach"


@dataclass
class Guard:
    alive: bool = True
    signal_received: bool = False
    says: list[str] = field(default_factory=list)

    def read_lines(self) -> list[str]:
        said, self.says = self.says, []
        return said


@dataclass
class Source:
    """The IMU, or the interlocks."""

    trouble: str | None = None
    trouble_since: float = 0.0


class MessageHistory:
    """An `Interruptions` and, in their order, what it has done."""

    def __init__(self, fails: str = ""):
        self.done: list[str] = []
        self.time = 0.0
        self.guard, self.sequencer = Guard(), Sequencer()
        self.imu, self.interlocks = Source(), Source()
        self._fails = fails
        self.made = Interruptions(
            self.sequencer,  # pyright: ignore[reportArgumentType]
            self.guard,  # pyright: ignore[reportArgumentType]
            self._stop,
            lambda: None,
            self._say,
        )

    def update(self) -> None:
        self.made.check_guard()
        self.made.update(self.time, self.imu, self.interlocks, 10.0)

    def _stop(self, how: Callable[[float], list[Command]], cause: str, lasted: float) -> None:
        self.done.append(f"{len(how(0.0))} stop")
        if self._fails == "section":
            raise InputError("no space left on device")

    def _say(self, level: str, words: str) -> None:
        if self._fails == "event":
            raise InputError("no space left on device")
        self.done.append(words)


@pytest.mark.parametrize("fails", ["", "event", "section"])
def test_the_table_is_stopped_before_anything_is_said_and_what_can_be_said_is(fails: str):
    kept = MessageHistory(fails)
    with pytest.raises(InputError) if fails else nullcontext():
        kept.made.end("the table is gone")
    assert kept.done == (["1 stop"] if fails == "event" else ["1 stop", "the table is gone"])
    assert kept.made.trouble == "the table is gone"


def test_a_watchdog_that_stops_the_table_pauses_the_run_until_it_rests():
    kept = MessageHistory()
    kept.guard.says = ["stopping: the host was silent for 1.5 s"]
    kept.update()
    assert kept.made.pause_reason == "watchdog: stopping: the host was silent for 1.5 s"
    kept.guard.says = ["cannot: lost"]
    kept.update()
    assert kept.done[-1] == "watchdog: cannot: lost"
    kept.guard.says = ["at rest"]
    kept.update()
    assert (kept.made.pause_reason, kept.sequencer.phase) == ("", "approach")
    assert kept.done[-1] == "the run continues"


def test_a_run_whose_table_the_watchdog_had_to_switch_off_does_not_go_on():
    kept = MessageHistory()
    kept.guard.says = ["stopping: the host was silent for 1.5 s", "killed: it did not slow down"]
    kept.update()
    kept.guard.says = ["at rest"]
    kept.update()
    assert kept.sequencer.phase == "aborted"
    assert kept.made.trouble == "watchdog: killed: it did not slow down"
    assert "the run continues" not in kept.done


def test_an_interlock_that_is_overdue_pauses_the_run_and_ends_it_where_that_lasts():
    kept = MessageHistory()
    kept.interlocks.trouble = "nothing has checked the table"
    kept.update()
    assert (kept.made.pause_reason, kept.sequencer.phase) == (kept.interlocks.trouble, "paused")
    kept.interlocks.trouble = None
    kept.update()
    assert (kept.made.pause_reason, kept.sequencer.phase) == ("", "approach")
    kept.interlocks.trouble, kept.interlocks.trouble_since = "nothing has checked the table", 1.0
    kept.time = 12.0
    kept.update()
    assert kept.sequencer.phase == "aborted"


def test_of_an_imu_that_is_gone_it_is_not_said_besides_that_its_gyros_are_not_compared():
    kept = MessageHistory()
    kept.imu.trouble, kept.interlocks.trouble = "the IMU is silent", "nothing has checked the gyros"
    kept.update()
    assert kept.made.pause_reason == kept.imu.trouble
