"""Runs a manual session, from the connection until the table is at rest.

The loop runs every 20 ms::

    clock -> commands, dead-man -> table commanded and read, IMU's bytes -> interlocks, journal

The driver, the watchdog and the interlocks are the same as in a run (`bench_run`), but there are no
steps. If an axis cannot execute a command, or the command exceeds the limits, it is refused before
anything moves (`command_check`). The journal records every command with the operator and the time,
and every event that stops an axis.

If an axis has a fault, all axes are stopped, but the session continues, because the operator must
be able to clear the fault. If an interlock finds a fault, the session ends. However the session
ends, the loop or the watchdog brings the table to rest. Both are software; the hardware interlock
is the safety function.
"""

from collections.abc import Callable, Mapping
from contextlib import ExitStack, suppress
from dataclasses import replace
from functools import partial
from math import degrees, inf, radians
from queue import Empty, SimpleQueue
from time import monotonic
from typing import Literal

from inercal.basics.closeable import Closeable
from inercal.basics.errors import InercalError, InputError
from inercal.benches.turntable import require_turntable
from inercal.host.addresses import DeviceAddresses, open_table
from inercal.host.assembly.reading_plausibility import ReadingPlausibility
from inercal.host.assembly.table_polls import POLL_INTERVAL
from inercal.host.clock import MonotonicClock, SimulatedClock
from inercal.host.drivers.rotary_table import (
    REST_RATE,
    AxisState,
    Feature,
    TableFault,
    TableState,
    axis_index,
)
from inercal.host.guard import Guard
from inercal.host.interlocks import Interlocks, LastChecks
from inercal.host.journal import NOTE_LEVEL, Journal
from inercal.host.manual import commands
from inercal.host.manual.commands import AxisTask, CommandCheck, narrower_limits
from inercal.host.manual.dead_man import HOLD_TIMEOUT, DeadMan
from inercal.host.manual.imu import ManualImu
from inercal.host.sequencer import Command, SpinCommand, StopCommand
from inercal.host.table_driver import READ_TIMEOUT, TableDriver
from inercal.host.table_lock import TableLock
from inercal.runfile import Run

SHOW_INTERVAL = 0.1  # s of wall time between two updates of the display
_SIMULATED_READ_TIMEOUT = 0.5  # s; a simulated table may be slow on a busy machine
_GRACE = 5.0  # s for coming to rest, in addition to the deceleration time
_STOP_GRACE = 1.0  # s for a stop, in addition to the deceleration time
_ARRIVAL_TOLERANCE = radians(0.05)  # rad
_STARTING_TIME = 0.3  # s after a command; an axis may still report rest


class ManualSession(Closeable):
    """A manual session. At the end of its `with` block, the table is at rest.

    Parameters
    ----------
    run : Run
        Run file contents: [bench] names the axes and states their limits, and [sensor] describes
        the IMU.
    journal : Journal
    addresses : DeviceAddresses
        Addresses of the devices; the address of the IMU may be empty.
    show : callable, optional
        Function that is called with this session at intervals.
    patience : float
        Time for which the watchdog tries to reach a lost table, s.

    Attributes
    ----------
    axes : tuple of str
        Names of the axes, from outer to inner.
    limits : tuple of AxisLimits
        Enforced limits of each axis.
    unsupported : mapping
        Functions that the controller cannot carry out, with the reasons.
    time : float
        Session time, s.
    state : TableState or None
        The last state that was read from the table.
    tasks : list of AxisTask
        The last command to each axis.
    imu : ManualImu or None
    dead_man : DeadMan

    Raises
    ------
    InputError
        The run file is not for a turntable, an address is invalid, or another program commands the
        table.
    LinkLost
        A device does not answer.
    """

    def __init__(
        self,
        run: Run,
        journal: Journal,
        addresses: DeviceAddresses,
        show: Callable[["ManualSession"], None] | None = None,
        patience: float = 600.0,
    ):
        bench = require_turntable(run)
        self._journal, self._show = journal, show
        self._requests: SimpleQueue[tuple[str, commands.ManualCommand | str]] = SimpleQueue()
        self._end_words = ""
        self._watchdog_stops = self._is_alarmed = self._was_read = self._was_commanded = False
        self._fault_words: list[tuple[str, ...]] = [()] * len(bench.names)
        self._jog: tuple[int, int, str] | None = None  # axis, press, operator
        self._last_checks = LastChecks()
        self._check_trouble: str | None = None
        self._plausibility = ReadingPlausibility(bench)
        self._show_time = -inf
        self.imu: ManualImu | None = None
        with ExitStack() as opened:
            opened.enter_context(TableLock(addresses.table, "a manual session"))
            timeout = _SIMULATED_READ_TIMEOUT if addresses.clock else READ_TIMEOUT
            self._table = opened.enter_context(open_table(addresses.table, bench, timeout))
            self._clock = (
                SimulatedClock(addresses.clock, 1.0) if addresses.clock else MonotonicClock(0.0)
            )
            opened.callback(self._clock.close)
            self.axes = self._table.axes
            self.unsupported: Mapping[Feature, str] = self._table.unsupported
            self.limits = narrower_limits(self._table.limits, bench.axis_motion_limits)
            self._check = CommandCheck(self.axes, self.limits, self.unsupported)
            self._interlocks = Interlocks(self._table.limits, bench, run.sensor)
            self._guard = opened.enter_context(Guard(addresses.table, patience=patience))
            self.dead_man = DeadMan(self._guard.stop)
            opened.callback(self.dead_man.close)
            self._driver = TableDriver(self._table, self._guard, self._clock.now, self._say)
            now = self._clock.now()
            self._clock.begin(now)
            tick = self._clock.end()
            if addresses.imu:
                self.imu = opened.enter_context(
                    ManualImu(
                        addresses.imu, run, self._interlocks, self._clock.now, tick,
                        self._table.wrap_period,
                    )
                )  # fmt: skip
            self._open_resources = opened.pop_all()
        self.time, self._next = tick.time, tick.time + POLL_INTERVAL
        self.tasks = [AxisTask() for _ in self.axes]

    @property
    def state(self) -> TableState | None:
        """The last state that was read from the table."""
        return self._driver.state

    def request(self, by: str, command: commands.ManualCommand) -> None:
        """Request a command, from any thread; the dead-man control receives it at once."""
        match command:
            case commands.JogCommand(press=press):
                self.dead_man.begin(press)
            case commands.HoldCommand(press):
                self.dead_man.hold(press)
                return
            case commands.ReleaseCommand() | commands.HaltCommand():
                self.dead_man.release()
            case _:
                pass
        self._requests.put((by, command))

    def write_note(self, words: str) -> None:
        """Record a note; any thread may call this."""
        self._requests.put(("", words))

    def end(self, words: str) -> None:
        """End the session; threads and signal handlers may call this. The first reason is kept."""
        self._end_words = self._end_words or words
        self.dead_man.release()

    def operate(self) -> str:
        """Execute commands until the session ends, and return the reason for the end."""
        with self._guard.catch_signals():
            try:
                self._clock.begin(self._next)
                while not self._end_words:
                    self._tick()
                if not self._is_alarmed:
                    self._halt(f"the session ends: {self._end_words}", "info")
                self._wait_for_rest()
            except InercalError as error:
                self._alarm_end(str(error))
        self._show_state()
        return self._end_words

    def _tick(self) -> None:
        tick = self._clock.end()
        self._next = max(self._next, tick.time) + POLL_INTERVAL
        self.time = tick.time
        self._guard.beat()
        self._hear_guard()
        self._follow_dead_man()
        commanded = self._do_requests()
        if not commanded:
            self._driver.send([])
        self._was_commanded, self._was_read = commanded, False
        fresh = self._driver.read()
        self._was_read = fresh is not None
        if self.imu is not None:
            self.imu.take(tick)
        self._clock.begin(self._next)
        if fresh is not None and self._is_plausible(fresh[1]):
            self._follow_state(*fresh)
        self._last_checks.update(self.time)
        trouble, before = self._last_checks.trouble, self._check_trouble
        self._check_trouble = trouble
        if trouble is not None and before is None and self._is_driving:
            self._halt(trouble)
        self._check_gyros()
        if monotonic() - self._show_time >= SHOW_INTERVAL:
            self._show_time = monotonic()
            self._show_state()

    def _show_state(self) -> None:
        if self._show is not None:
            self._show(self)

    @property
    def _is_driving(self) -> bool:
        return any(task.activity != "idle" for task in self.tasks)

    # Commands from the operator.

    def _do_requests(self) -> bool:
        """Execute the waiting commands; return whether a command was sent to the table."""
        commanded = False
        with suppress(Empty):
            while not self._end_words:
                by, command = self._requests.get_nowait()
                if isinstance(command, str):
                    self._journal.record_event(NOTE_LEVEL, command, self.time)
                    continue
                commanded |= self._do(by, command)
        return commanded

    def _do(self, by: str, command: commands.ManualCommand) -> bool:
        """Execute or refuse a command; return whether it was sent to the table."""
        if isinstance(command, commands.HoldCommand):
            return False
        if isinstance(command, commands.ReleaseCommand):
            return self._stop_jog(f"released by {by}")
        # A stop is executed before it is recorded. All other commands are recorded first.
        if isinstance(command, commands.HaltCommand):
            self._halt(f"{by}: {command}", "info")
            return True
        if isinstance(command, commands.JogCommand) and not self.dead_man.is_live(command.press):
            self._say("info", f"{by}: {command}: not started, because the key was already released")
            return False
        try:
            checked = self._judged(command, by)
        except (InputError, TableFault) as error:
            why = str(error).removeprefix(f"axis {command.axis}: ")
            self._say("warning", f"refused: {by}: {command}: {why}")
            return False
        self._say("info", f"{by}: {command}")
        try:
            self._driver.send([checked])
        except TableFault as error:
            self._say("warning", f"refused by the table: {command}: {error}")
            self._forget(command)
        except InercalError as error:
            self._halt(f"{command}: {error}")
        return True

    def _judged(self, command: commands.AxisCommand, by: str) -> Command:
        """Check a command, update `tasks`, and return the command for the table.

        Raises
        ------
        InputError, TableFault
            See `CommandCheck.judge`. The error is also raised if the watchdog is stopping the
            table.
        """
        if self.state is None:
            raise InputError("the table has not been read yet; try again")
        if self._watchdog_stops:
            raise InputError("the watchdog is stopping the table; wait until it is at rest")
        checked, task = self._check.judge(command, self.state, self.tasks, self.time)
        i = axis_index(command.axis, self.axes)
        if isinstance(command, commands.JogCommand):
            self._stop_jog(f"replaced by a jog of axis {command.axis}")
            self._jog = i, command.press, by
            self.dead_man.set_moving(True)
        if task is not None:
            self._start(i, task)
        return checked

    def _start(self, i: int, task: AxisTask) -> None:
        self.tasks[i] = replace(task, begun=self.time)

    def _forget(self, command: commands.AxisCommand) -> None:
        """Stop an axis that refused a motion, because its previous motion may be unwanted."""
        if isinstance(command, (commands.HomeAxisCommand, commands.GoCommand, commands.JogCommand)):
            if isinstance(command, commands.JogCommand):
                self._jog = None
                self.dead_man.set_moving(False)
            self._stop_axis(axis_index(command.axis, self.axes))

    # Stopping.

    def _follow_dead_man(self) -> None:
        """Stop the axis that is being jogged if nobody holds the key any more."""
        if self._jog is not None and not self.dead_man.is_live(self._jog[1]):
            # If a release is in the queue, it is processed first, because it names the operator.
            if self._requests.empty():
                self._stop_jog(f"no message about the held key for {HOLD_TIMEOUT:g} s", "warning")
            else:
                self._stop_axis(self._jog[0])
                self.dead_man.set_moving(False)

    def _stop_jog(self, why: str, level: Literal["info", "warning"] = "info") -> bool:
        """Stop the axis that is being jogged, if any, and return whether a command was sent."""
        if self._jog is None:
            return False
        i, _, by = self._jog
        self._jog = None
        if self.tasks[i].activity == "jog":
            self._stop_axis(i)
        self.dead_man.set_moving(False)
        held = self.dead_man.count
        self._say(level, f"axis {self.axes[i]}: the jog of {by} ends after {held} messages: {why}")
        return True

    def _stop_axis(self, i: int) -> None:
        """Decelerate an axis and hold it; a servo that is off stays off."""
        state = self.state
        if state is not None and not state.axes[i].enabled:
            self._start(i, AxisTask())
            return
        rate = abs(state.axes[i].rate) if state is not None else self.limits[i].rate
        due = self.time + rate / self.limits[i].acceleration + _STOP_GRACE
        self._start(i, AxisTask("stop", due=due))
        try:
            self._driver.send([SpinCommand(i, 0.0, self.limits[i].acceleration)])
        except InercalError as error:
            self._say("alarm", str(error))
            self._driver.stop([StopCommand()])

    def _halt(self, why: str, level: Literal["info", "alarm"] = "alarm") -> None:
        """Stop all axes whose servos are on, one by one; axes that are off stay off."""
        self._jog = None
        for i in range(len(self.axes)):
            self._stop_axis(i)
        self.dead_man.set_moving(False)
        self._say(level, why if level == "info" else f"{why}: all axes are stopped")

    def _alarm_end(self, words: str) -> None:
        """Stop all axes and end the session, because an interlock has found a fault."""
        self._end_words, self._is_alarmed = self._end_words or words, True
        self._jog = None
        on = [axis.enabled for axis in self.state.axes] if self.state is not None else []
        if all(on):
            self._driver.stop([StopCommand()])
        else:
            # If a servo is off, its loop is not closed, because somebody may be touching the axis.
            for i in range(len(self.axes)):
                self._stop_axis(i)
        self.dead_man.set_moving(False)
        self._say("alarm", words)

    # Monitoring.

    def _hear_guard(self) -> None:
        """Read the watchdog's messages, and check that it is alive."""
        if self._guard.signal_received and not self._end_words:
            self._alarm_end("stopped by the operator")
        for line in self._guard.read_lines():
            if line == "at rest":
                self._watchdog_stops = False
                self._say("info", "watchdog: at rest")
            elif line.startswith("stopping"):
                self._watchdog_stops, self._jog = True, None
                for i in range(len(self.axes)):
                    self._start(i, AxisTask())
                self._say("alarm", f"watchdog: {line}")
            elif line.startswith("killed"):
                self._alarm_end(f"watchdog: {line}")
            elif line != "ready":
                self._say("warning", f"watchdog: {line}")
        if not self._guard.alive and not self._end_words:
            self._alarm_end("the watchdog is gone")

    def _is_plausible(self, state: TableState) -> bool:
        if not all(axis.enabled for axis in state.axes):
            # An operator may turn an axis by hand faster than its limits.
            self._plausibility.restart()
            return True
        if self._plausibility.accept_state(state):
            return True
        if self._plausibility.is_fault and not self._end_words:
            self._alarm_end(self._plausibility.fault_text)
        return False

    def _follow_state(self, time: float, state: TableState) -> None:
        """Check the progress of each axis, and run the interlocks."""
        if self.imu is not None:
            self.imu.take_table(time, state)
        self._last_checks.record("table", self.time)
        if self._end_words:
            return
        words = self._interlocks.check(_without_free_axes(state), self.time)
        if (words := words or self._driver.commanded_motion.check(state)) is not None:
            self._alarm_end(words)
            return
        for i, axis in enumerate(state.axes):
            self._follow_faults(i, axis)
            self._follow_task(i, axis, self.tasks[i])

    def _follow_faults(self, i: int, axis: AxisState) -> None:
        fresh = set(axis.faults) - set(self._fault_words[i])
        self._fault_words[i] = axis.faults
        if fresh:
            self._halt(f"axis {self.axes[i]}: {', '.join(sorted(fresh))}")

    def _follow_task(self, i: int, axis: AxisState, task: AxisTask) -> None:
        if task.activity == "idle" or self.time - task.begun < _STARTING_TIME:
            return
        name = self.axes[i]
        if not axis.enabled:
            self._start(i, AxisTask())
            if task.activity != "stop":
                self._halt(f"axis {name}: its servo has switched off")
        elif task.activity == "home" and axis.homed and axis.settled:
            self._start(i, AxisTask(goal=0.0))
            self._say("info", f"axis {name}: homed")
        elif task.activity == "go" and axis.settled:
            self._start(i, AxisTask(goal=task.goal))
            where = f"axis {name}: at rest at {degrees(axis.angle):.4f}°"
            if abs(axis.angle - task.goal) > _ARRIVAL_TOLERANCE:
                there = f"{degrees(task.goal):.4f}°: it was stopped from outside"
                self._say("warning", f"{where} instead of {there}")
            else:
                self._say("info", where)
        elif task.activity == "stop" and axis.settled:
            self._start(i, AxisTask())
        elif self.time > task.due:
            self._late(i, task)

    def _late(self, i: int, task: AxisTask) -> None:
        """Stop an axis because its command has exceeded the time limit."""
        name, what = self.axes[i], task.activity
        if what == "stop":
            self._start(i, AxisTask())
            self._guard.stop()
            self._say("alarm", f"axis {name} does not come to rest; the watchdog stops the table")
        else:
            doing = "found its zero" if what == "home" else "arrived"
            self._halt(f"axis {name} has not {doing} in {self.time - task.begun:.1f} s")

    def _check_gyros(self) -> None:
        """Check that gyros and encoders agree."""
        if self.imu is None:
            return
        try:
            words = self.imu.check_gyros(self.time)
        except InputError as error:
            words = str(error)
        if words is not None and not self._end_words:
            self._alarm_end(words)
        if self._interlocks.encoder_stuck:
            self._driver.switch_servos_off()

    def _wait_for_rest(self) -> None:
        """Wait until the table is at rest; if it does not stop, the watchdog takes over."""
        slowest = max(one.rate / one.acceleration for one in self.limits)
        # An axis may report motion some time after a new command.
        least, until = self.time + _STARTING_TIME, self.time + slowest + _GRACE
        while self.time < least or (self.time < until and not self._is_at_rest):
            self._tick()

    @property
    def _is_at_rest(self) -> bool:
        """Return whether no axis with an active servo moved in the last reading."""
        axes = self.state.axes if self.state is not None and self._was_read else ()
        return self._driver.at_rest or (
            bool(axes)
            and not self._was_commanded
            and not any(a.enabled and (a.moving or abs(a.rate) >= REST_RATE) for a in axes)
        )

    def _say(self, level: Literal["info", "warning", "alarm"], words: str) -> None:
        self._journal.record_event(level, words, self.time)

    def close(self) -> None:
        """Leave the table at rest, and close all connections."""
        try:
            say = partial(self._say, "alarm")
            self._driver.leave(self._clock, say, at_rest=self._is_at_rest)
        finally:
            self._open_resources.close()


def _without_free_axes(state: TableState) -> TableState:
    """Return the state with zero rates for axes with their servo off, which people may turn."""
    axes = (
        axis if axis.enabled else replace(axis, rate=0.0, following_error=0.0)
        for axis in state.axes
    )
    return replace(state, axes=tuple(axes))
