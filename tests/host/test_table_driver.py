"""The table as a run drives it."""

from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from math import nan
from types import SimpleNamespace

import pytest

from inercal.host.bench_run import BenchRun
from inercal.host.drivers.rotary_table import AxisState, ProtocolError, TableFault, TableState
from inercal.host.link import LinkLost
from inercal.host.sequencer import MoveCommand, StopCommand
from inercal.host.table_driver import TableDriver

RESTS = AxisState(0.0, 0.0, 0.0, in_position=True, moving=False, enabled=True, homed=True)
OFF = AxisState(0.0, 0.0, 0.0, in_position=True, moving=False, enabled=False, homed=True)


@dataclass
class Table:
    """Says what it is told to; what is commanded is kept."""

    says: Sequence[TableState | Exception]
    told: list[str] = field(default_factory=list)
    axes: tuple[str, ...] = ("z",)

    def read(self) -> TableState:
        said, *self.says = self.says
        if isinstance(said, Exception):
            raise said
        return said

    def move(self, axis: str, *_: float) -> None:
        self.told.append(f"move {axis}")

    def stop(self) -> None:
        self.told.append("stop")


@dataclass
class Guard:
    stopped: int = 0
    left: bool = False
    axis_killed: bool = False
    alive: bool = True
    says: Sequence[str] = ()

    def stop(self) -> bool:
        self.stopped += 1
        return self.alive

    def read_lines(self) -> list[str]:
        if not self.stopped or not self.says:
            return []
        said, *self.says = self.says
        return [said]

    def release_to_guard(self) -> None:
        self.left = True


def driven(table: Table, times: Iterator[float] | None = None, guard: Guard | None = None):
    said: list[str] = []
    now = (lambda: 0.0) if times is None else times.__next__
    made = TableDriver(table, guard or Guard(), now, lambda level, words: said.append(words))  # pyright: ignore[reportArgumentType]
    return made, said


def test_a_reading_is_never_of_before_what_the_table_tells():
    # A host that stalls between question and answer: the table's clock was read when it went on.
    asked_told_answered = [(1.0, 1.001, 1.002), (2.0, 2.45, 2.5), (3.0, 3.001, 3.5)]
    table = Table([TableState(told, (RESTS,)) for _, told, _ in asked_told_answered])
    made, _ = driven(
        table, iter([t for asked, _, done in asked_told_answered for t in (asked, done)])
    )
    for (_, told, _), error in zip(asked_told_answered, (0.0, 0.05, 0.5), strict=True):
        heard = made.read()
        assert heard is not None
        assert heard[0] >= told
        assert heard[0] - told == pytest.approx(error, abs=2e-3)


def test_the_time_of_a_controller_that_tells_none_is_the_hosts():
    made, _ = driven(Table([TableState(nan, (RESTS,))]), iter([1.0, 1.5]))
    heard = made.read()
    assert heard is not None
    assert heard[0] == heard[1].time == 1.25


def test_a_few_readings_may_fail_and_ten_in_a_row_are_the_end():
    good = TableState(0.0, (RESTS,))
    made, said = driven(Table([ProtocolError("late")] * 9 + [good] + [LinkLost("lost")] * 10))
    assert [made.read() for _ in range(9)] == [None] * 9
    assert made.read() is not None
    assert made.at_rest
    for _ in range(9):
        assert made.read() is None
        assert not made.at_rest  # nobody knows
    with pytest.raises(LinkLost):
        made.read()
    assert said == ["late"] * 9 + ["lost"] * 10


def test_a_table_that_was_told_to_go_does_not_rest_though_it_does_not_say_so_yet():
    table = Table([TableState(t, (RESTS,)) for t in (0.0, 1.0)])
    made, _ = driven(table)
    made.send([MoveCommand(0, 1.0, 1.0, 1.0)])
    made.read()
    assert not made.at_rest
    made.send([])
    made.read()
    assert made.at_rest
    assert table.told == ["move z"]


@pytest.mark.parametrize(("axis", "told"), [(RESTS, ["stop"]), (OFF, [])])
def test_a_stop_switches_on_no_servo_that_is_off(axis: AxisState, told: list[str]):
    table = Table([TableState(0.0, (axis,))])
    made, _ = driven(table)
    made.read()
    made.stop([StopCommand()])
    assert table.told == told


def test_what_cannot_be_told_is_the_watchdogs():
    class Gone(Table):
        def stop(self) -> None:
            raise LinkLost("gone")

    guard = Guard()
    made, said = driven(Gone([]), guard=guard)
    made.stop([StopCommand()])
    assert guard.stopped == 1
    assert said == ["gone; the watchdog now stops the table"]
    guard.alive = False
    made.stop([StopCommand()])
    assert said[-1] == "gone; the watchdog is gone too: cut the table's power"


def test_a_table_that_was_told_to_go_and_refuses_in_part_does_not_rest():
    class Refuses(Table):
        def move(self, axis: str, *_: float) -> None:
            raise TableFault("no")

    made, _ = driven(Refuses([TableState(0.0, (RESTS,))]))
    made.read()
    assert made.at_rest
    with pytest.raises(TableFault):
        made.send([MoveCommand(0, 1.0, 1.0, 1.0)])
    assert not made.at_rest


def test_what_the_watchdog_has_switched_off_is_not_switched_on_by_a_stop():
    table, guard = Table([TableState(0.0, (RESTS,))]), Guard(axis_killed=True)
    made, _ = driven(table, guard=guard)
    made.read()
    made.stop([StopCommand()])
    assert table.told == []


@pytest.mark.parametrize(
    ("says", "words", "left"),
    [
        (["stopping: the host requested it", "at rest"], None, False),
        (["killed: it did not slow down", "at rest"], "watchdog: killed: it did not", False),
        (["cannot: lost"], "no reading shows the table at rest; the", True),
    ],
)
def test_a_table_is_left_to_the_watchdog_until_it_rests(
    monkeypatch: pytest.MonkeyPatch, says: list[str], words: str | None, left: bool
):
    monkeypatch.setattr("inercal.host.table_driver._REST_TIMEOUT", 0.2)
    guard = Guard(says=says)
    made, _ = driven(Table([]), guard=guard)
    said = made.release_to_guard()
    assert said == words or (words and said and said.startswith(words))
    assert guard.left is left


@pytest.mark.parametrize("when", ["leave", "close"])
def test_another_interrupt_does_not_call_the_watchdog_off(
    monkeypatch: pytest.MonkeyPatch, when: str
):
    def interrupted() -> None:
        raise KeyboardInterrupt

    guard = Guard()
    run = object.__new__(BenchRun)
    turning, _ = driven(Table([]), guard=guard)
    monkeypatch.setattr(turning, "at_rest", False)
    monkeypatch.setattr(turning, "release_to_guard", interrupted)
    clock = SimpleNamespace(close=interrupted if when == "close" else lambda: None)
    run.__dict__ |= {"_table_driver": turning, "_clock": clock}
    run.__dict__ |= {"_interruptions": SimpleNamespace(add=print), "_open_resources": ExitStack()}
    with pytest.raises(KeyboardInterrupt), run:
        pass
    assert guard.left
