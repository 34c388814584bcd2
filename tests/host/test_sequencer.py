"""The sequencer against a table of a few lines: what it commands, repeats and refuses."""

from dataclasses import replace
from itertools import pairwise
from math import pi, radians

import pytest
from tests.refusals import refused

from inercal.basics.units import Measured
from inercal.benches import Turntable
from inercal.benches.motion_control import AxisMotionLimits, TurnTask
from inercal.benches.turntable.kind import plan_tasks
from inercal.host.drivers.rotary_table import AxisState, TableFault, TableState
from inercal.host.sequencer import (
    EnableCommand,
    HomeCommand,
    MoveCommand,
    SectionEvent,
    Sequencer,
    StopCommand,
)
from inercal.physics.plan import Position, Rotation

BENCH = Turntable(Measured(9.8, 0.0), radians(38), Measured(0.0, 0.0))
LIMITS = BENCH.axis_motion_limits
PLAN = [
    Position("warm-up", (0.0, 0.0, 0.0), 5.0),
    Position("up", (0.0, pi / 2, 0.0), 3.0),
    Rotation("x+", 2, 4 * pi, radians(30)),
    Rotation("x-", 2, -4 * pi, radians(30), (pi, 0.0, 0.0)),
]


class Table:
    """Axes that turn at the rate they were told, at once; polled each 0.1 s."""

    def __init__(self):
        self.time, self.angle, self.goal = 0.0, [0.0] * 3, [0.0] * 3
        self.rate = [1.0] * 3
        self.enabled = self.homed = False
        self.faults: dict[int, tuple[str, ...]] = {}
        self.stuck: set[int] = set()
        self.told: list[object] = []

    def read(self) -> TableState:
        axes = [
            AxisState(
                self.angle[i],
                0.0,
                0.0,
                abs(self.goal[i] - self.angle[i]) < 1e-9,
                abs(self.goal[i] - self.angle[i]) >= 1e-9,
                self.enabled,
                self.homed,
                self.faults.get(i, ()),
            )
            for i in range(3)
        ]
        return TableState(self.time, tuple(axes))

    def tell(self, command: object) -> None:
        self.told.append(command)
        match command:
            case EnableCommand():
                self.enabled = True
            case HomeCommand():
                self.homed = True
            case MoveCommand(axis, angle, rate, _):
                self.goal[axis], self.rate[axis] = angle, rate
            case StopCommand():
                self.goal = list(self.angle)

    def wait(self, seconds: float = 0.1) -> None:
        self.time += seconds
        for i in set(range(3)) - self.stuck:
            left = self.goal[i] - self.angle[i]
            step = min(abs(left), self.rate[i] * seconds)
            self.angle[i] += step if left > 0 else -step


def run(made: Sequencer, table: Table, until: float = 1e4) -> list[SectionEvent]:
    while not made.is_over and table.time < until:
        for command in made.step(table.read()):
            table.tell(command)
        table.wait()
    return made.sections


def test_a_plan_made_absolute_counts_on_over_whole_turns():
    made = plan_tasks(BENCH, PLAN)
    assert [one.label for one in made] == ["warm-up", "up", "x+", "x-"]
    assert made[2].start == pytest.approx((0, pi / 2, 0))
    assert made[2].end == pytest.approx((0, pi / 2, 4 * pi))
    assert made[3].start == pytest.approx((pi, 0, 4 * pi))
    assert made[3].end == pytest.approx((pi, 0, 0))
    assert [one.rate > 0 for one in made] == [False, False, True, True]


def test_all_steps_are_done_in_order_and_the_table_returns():
    table, made = Table(), Sequencer(plan_tasks(BENCH, PLAN), LIMITS)
    sections = run(made, table)
    assert made.phase == "done"
    assert [(s.number, s.state) for s in sections] == [
        (k, what) for k in range(4) for what in ("begun", "done")
    ]
    began, ended = sections[2:4]
    assert 3.0 <= ended.time - began.time < 3.2
    assert table.told[:2] == [EnableCommand(), HomeCommand()]
    assert table.angle == pytest.approx([0, 0, 0], abs=1e-8)
    assert made.remaining_time(table.time) == 0


@pytest.mark.parametrize("at", [0.05, 3.0, 8.0, 9.0, 14.0, 25.0, 50.0, 70.0])
def test_a_pause_repeats_the_step_whole_from_where_it_begins(at: float):
    table, made = Table(), Sequencer(plan_tasks(BENCH, PLAN), LIMITS)
    run(made, table, at)
    number, phase = made.number, made.phase
    for command in made.pause(table.time):
        table.tell(command)
    assert table.told[-1] == StopCommand()
    assert not made.step(table.read())
    assert made.pause(table.time) == []
    made.resume()
    sections = run(made, table)
    assert made.phase == "done"
    void = [s for s in sections if s.state == "void"]
    assert [s.number for s in void] == ([number] if phase == "work" else [])
    for k, task in enumerate(plan_tasks(BENCH, PLAN)):
        done = [s for s in sections if s.number == k]
        assert [s.state for s in done[-2:]] == ["begun", "done"]
        if not task.rate:
            assert done[-1].time - done[-2].time >= task.seconds


def test_a_run_goes_on_at_a_later_step_and_brings_the_axes_there():
    table = Table()
    table.enabled = table.homed = True
    sections = run(Sequencer(plan_tasks(BENCH, PLAN), LIMITS, first=2), table)
    assert [s.number for s in sections] == [2, 2, 3, 3]
    goes = [c for c in table.told if isinstance(c, MoveCommand)]
    assert goes[0] == MoveCommand(1, pi / 2, LIMITS[1].rate, LIMITS[1].acceleration)
    assert goes[1].axis == 2
    assert goes[1].rate == pytest.approx(radians(30))
    assert not any(isinstance(c, HomeCommand | EnableCommand) for c in table.told)


def test_abort_stops_and_nothing_follows():
    table, made = Table(), Sequencer(plan_tasks(BENCH, PLAN), LIMITS)
    run(made, table, 2.0)
    assert made.abort(table.time) == [StopCommand()]
    assert made.is_over
    assert made.sections[-1].state == "void"
    assert made.step(table.read()) == []


def test_an_axis_that_does_not_arrive_is_named_with_its_step():
    table, made = Table(), Sequencer(plan_tasks(BENCH, PLAN), LIMITS)
    table.stuck = {1}
    with refused(TableFault, key="approach", names=("1", "up")):
        run(made, table)


def test_a_fault_and_a_servo_that_is_off_are_said_in_words():
    table, made = Table(), Sequencer(plan_tasks(BENCH, PLAN), LIMITS)
    run(made, table, 6.5)
    table.faults = {2: ("amplifier fault",)}
    assert made.task is not None
    with refused(TableFault, names=("2", made.task.label)) as fault:
        made.step(table.read())
    assert "amplifier fault" in str(fault.value)
    table.faults = {}
    table.enabled = False
    with refused(TableFault, names=("0", made.task.label)):
        made.step(table.read())


def test_a_stay_ends_by_the_tables_clock_however_seldom_it_is_asked():
    table, made = Table(), Sequencer([TurnTask("p", (0,) * 3, (0,) * 3, 0.0, 10.0, 0.0)], LIMITS)
    while not made.is_over:
        for command in made.step(table.read()):
            table.tell(command)
        table.wait(0.7)
    began, ended = made.sections
    assert 10.0 <= ended.time - began.time < 10.8


def test_what_remains_shrinks_to_nothing():
    limits = [replace(one, rate=1.0) for one in LIMITS]
    assert isinstance(limits[0], AxisMotionLimits)
    table, made = Table(), Sequencer(plan_tasks(BENCH, PLAN), limits)
    left = [made.remaining_time(0.0)]
    while not made.is_over:
        for command in made.step(table.read()):
            table.tell(command)
        table.wait()
        left.append(made.remaining_time(table.time))
    assert left[0] > 50
    assert max(after - before for before, after in pairwise(left)) < 1e-9
    assert left[-1] == 0


def test_an_axis_that_was_stopped_from_outside_is_not_taken_for_arrived():
    table, made = Table(), Sequencer(plan_tasks(BENCH, PLAN), LIMITS)
    while made.number < 1 or made.phase != "approach" or table.angle[1] < 0.5:
        for command in made.step(table.read()):
            table.tell(command)
        table.wait()
    table.tell(StopCommand())
    with refused(TableFault, key="approach", names=("1", "up")):
        made.step(table.read())


@pytest.mark.parametrize("turned", [radians(0.06), -pi / 4])
def test_an_axis_that_is_moved_from_outside_during_a_hold_is_named(turned: float):
    table, made = Table(), Sequencer(plan_tasks(BENCH, PLAN), LIMITS)
    while made.number < 1 or made.phase != "work":
        run(made, table, table.time + 0.05)
    table.angle[1] += turned
    table.tell(StopCommand())  # it stands there, and says no fault
    assert made.step(table.read()) == []
    with refused(TableFault, key="work", names=("1", "up")):
        made.step(table.read())


def test_an_axis_that_moves_during_a_hold_is_named_before_it_is_far():
    table, made = Table(), Sequencer(plan_tasks(BENCH, PLAN), LIMITS)
    while made.number < 1 or made.phase != "work":
        run(made, table, table.time + 0.05)
    table.tell(MoveCommand(2, 1.0, 1e-4, 1.0))
    table.wait()
    assert made.step(table.read()) == []
    with refused(TableFault, key="work", names=("2", "up")):
        made.step(table.read())


def test_one_false_reading_during_a_hold_is_not_believed_and_ends_none():
    table, made = Table(), Sequencer([TurnTask("p", (0,) * 3, (0,) * 3, 0.0, 10.0, 0.0)], LIMITS)
    while made.phase != "work":
        run(made, table, table.time + 0.05)
    for late in (1.0, 20.0):
        table.angle[0] = table.goal[0] = 1.0
        table.time += late
        made.step(table.read())
        assert made.phase == "work"
        table.angle[0] = table.goal[0] = 0.0
        made.step(table.read())
    assert [one.state for one in made.sections] == ["begun", "done"]
