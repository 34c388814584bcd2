"""A run on a bench, from the first command to the table at rest: the loop that all else serves.

Every 20 ms of the bench's time::

    clock -> table's state and IMU's bytes -> log -> interlocks -> sequencer -> table, log, journal

and now and then what came is assembled, and both filters make their steps of it. What an estimate
is made of is in the log: a run that was interrupted replays it, and repeats the step that was in
hand whole.

On any way out the table comes to rest: by the sequencer, or by the watchdog (`guard`), a process of
its own with its own connection. Both are software; the hardware interlock is the safety function.
"""

from collections.abc import Callable
from contextlib import ExitStack
from datetime import datetime
from queue import SimpleQueue
from select import select
from time import monotonic
from typing import Literal, NamedTuple, Self

from inercal.benches import Turntable
from inercal.errors import InercalError, InputError
from inercal.host.account import Account
from inercal.host.addresses import layout_of_address, open_imu, open_table
from inercal.host.clock import Clock, SimulatedClock, WallClock
from inercal.host.drivers.table import ProtocolError, TableFault, TableState
from inercal.host.folder import Folder
from inercal.host.guard import Guard
from inercal.host.interlocks import Interlocks
from inercal.host.journal import Journal
from inercal.host.link import LinkLost
from inercal.host.listening import Listening
from inercal.host.log import IMU, TABLE
from inercal.host.sequencer import Command, Enable, Go, Home, Sequencer
from inercal.host.states import pack
from inercal.host.tasks import tasks
from inercal.plan import Position, Rotation

_SHOWN = 0.2  # s of the wall's between two looks at the run
_UNHEARD = 5  # readings of the table in a row that may fail
_AT_REST = 1e-3  # rad/s
_AFTER = 1.0  # s that are recorded on: the last samples wait for what the table says after them
_LOOKS = 0.05  # s of the wall's between two looks at the watchdog
_LEAVING = 30.0  # s of the wall's to come to rest in, seen by the watchdog
_PATIENCE, _SIMULATED = 600.0, 10.0  # s that it looks for a table that is gone
_GRACE = 5.0  # s to come to rest in, beside what the deceleration takes
_Why = Literal["operator", "watchdog", "IMU"]


class Addresses(NamedTuple):
    """Where the devices are; `clock` is that of a simulated bench, empty on iron."""

    table: str
    imu: str
    clock: str = ""


class Options(NamedTuple):
    """What an operator may say of a run.

    Parameters
    ----------
    speed : float or None
        Most seconds of a simulated bench in one of the wall's; None is as fast as it goes.
    temperature : (float, float) or None
        K that the IMU must stay within.
    patience : float
        s that an IMU may be gone before the run ends.
    """

    speed: float | None = None
    temperature: tuple[float, float] | None = None
    patience: float = 120.0


_ORDINARY = Options()


class BenchRun:
    """One run, begun or resumed; a context manager that leaves the table at rest.

    Parameters
    ----------
    folder : Folder
    journal : Journal
    addresses : Addresses
    options : Options
    show : callable
        Called with the run itself, five times a second of the wall's.

    Attributes
    ----------
    name, sensor, axes
        The sensor's name, the sensor, the names of the table's axes.
    time : float
        The run's, s.
    state : TableState or None
        As last read.
    sequencer : Sequencer
    tasks : tuple of Task
    account : Account
        What came, and what was made of it.
    trouble : str
        Why the run was interrupted; empty where it was not.

    Raises
    ------
    InputError
        A run file that is none of a turntable, an address that is none, a log that is damaged.
    LinkLost
        Nobody is there.
    """

    def __init__(
        self,
        folder: Folder,
        journal: Journal,
        addresses: Addresses,
        options: Options = _ORDINARY,
        show: Callable[["BenchRun"], None] = lambda run: None,
    ):
        run, bench = folder.run, folder.run.bench
        if not isinstance(bench, Turntable):
            raise InputError(f"{run.path}: [bench] kind: a bench run takes a turntable")
        steps = [step for step in run.steps if isinstance(step, Position | Rotation)]
        self.tasks = tasks(bench, steps)
        self.sequencer = Sequencer(self.tasks, bench.limits_of_axes, journal.done())
        self.name, self.sensor, self.axes = run.sensor.name, run.sensor, bench.names
        self.state: TableState | None = None
        self.trouble = ""
        self._journal, self._options, self._show = journal, options, show
        self._bench, self._poll = bench, journal.run().poll
        self._paused: dict[_Why, str] = {}
        self._commands: list[Command] = []
        self._asked: SimpleQueue[Literal["pause", "go on", "stop"]] = SimpleQueue()
        self._unheard, self._shown = 0, 0.0
        layout = layout_of_address(addresses.imu)
        with ExitStack() as opened:
            self.account = opened.enter_context(Account(folder, journal, layout))
            self._clock = _clock(addresses, options, journal)
            opened.callback(self._clock.close)
            self._table = opened.enter_context(open_table(addresses.table, bench))
            self._interlocks = Interlocks(
                self._table.limits, bench, run.sensor, options.temperature
            )
            # A simulated bench stands still from here on: the port opens between two packets.
            clock, now = self._clock, self._clock.now()
            clock.begin(now)
            tick = clock.end()
            waits = bool(addresses.clock)
            self._imu = Listening(lambda: open_imu(addresses.imu, clock.now, waits=waits), tick)
            opened.callback(self._imu.close)
            patience = _SIMULATED if addresses.clock else _PATIENCE
            self._guard = opened.enter_context(Guard(addresses.table, patience=patience))
            self._opened = opened.pop_all()
        self.time, self._next = tick.time, tick.time + self._poll
        self._since = monotonic(), tick.time
        self._over: float | None = None
        self._rests, self._looked = True, 0.0

    @property
    def speed(self) -> float:
        """Seconds of the bench in one of the wall's, so far."""
        wall, bench = self._since
        now = monotonic() if self._over is None else self._over
        return (self.time - bench) / max(now - wall, 1e-9)

    @property
    def paused(self) -> str:
        """Why the run pauses; empty where it does not."""
        return "; ".join(self._paused.values())

    def ask(self, what: Literal["pause", "go on", "stop"]) -> None:
        """Ask for something, from whichever thread; it is done within a tick."""
        self._asked.put(what)

    def carry_out(self) -> bool:
        """Go through the plan; True when all is done, False when it was interrupted.

        The table is at rest then, or `trouble` says why that is not known.
        """
        with self._guard.catch_signals():
            self._attach()
            try:
                self._clock.begin(self._next)
                while not self.sequencer.over:
                    self._tick()
                self._come_to_rest()
            except LinkLost as error:
                self._end(f"the bench's clock is gone: {error}")
        self._work()
        self._over = monotonic()
        self._journal.end("running" if self.sequencer.phase == "done" else "interrupted")
        self._show(self)
        return self.sequencer.phase == "done"

    def _tick(self) -> None:
        """See what the last tick brought, let the bench go on, and do what is to be done of it.

        Between `end` and `begin` a simulated bench stands still: commands reach it there, one tick
        after the state that they are for.
        """
        tick = self._clock.end()
        # A bench that has gone on by itself is not followed tick by tick.
        self._next = max(self._next, tick.time) + self._poll
        self.time, self._rests = tick.time, False
        self._guard.beat()
        self._tell_what_is_due()
        fresh = self._read()
        heard = self._imu.take(tick)
        self._clock.begin(self._next)
        if fresh is not None:
            self.account.keep(TABLE, fresh[0], pack(fresh[1]))
        if heard.opened:
            self._attach()
        for time, data in heard.pieces:
            self.account.keep(IMU, time, data)
        self._watch()
        if fresh is not None:
            self._go_on(fresh[1])
        if self.account.due(self.time):
            self._work()
        if monotonic() - self._shown >= _SHOWN:
            self._shown = monotonic()
            self._show(self)

    def _read(self) -> tuple[float, TableState] | None:
        """Return when the table was read, and its state; None where that failed."""
        asked = self._clock.now()
        try:
            state = self._table.read()
        except ProtocolError as error:
            self._unheard += 1
            self._say("warning", str(error))
            if self._unheard >= _UNHEARD:
                self._end(f"{_UNHEARD} readings of the table in a row failed")
            return None
        except LinkLost as error:
            self._end(f"the table is gone: {error}")
            return None
        self._unheard = 0
        self.state = state
        self._rests = all(abs(axis.rate) < _AT_REST and not axis.moving for axis in state.axes)
        return (asked + self._clock.now()) / 2, state

    def _watch(self) -> None:
        """Look at what was asked for, at watchdog and IMU: the run pauses, goes on or ends."""
        while not self._asked.empty():
            match self._asked.get():
                case "pause":
                    self._pause("operator", "paused by the operator")
                case "go on":
                    self._paused.pop("operator", None)
                case "stop":
                    self._end("stopped by the operator")
        if monotonic() - self._looked >= _LOOKS:
            self._look_at_guard()
        if self._imu.trouble is None:
            self._paused.pop("IMU", None)
        elif self.time - self._imu.since > self._options.patience:
            self._end(f"{self._imu.trouble}, and not back within {self._options.patience:g} s")
        else:
            self._pause("IMU", self._imu.trouble)
        if self.sequencer.phase == "paused" and not self._paused:
            self._say("info", "goes on")
            self.sequencer.go_on()

    def _look_at_guard(self) -> None:
        """Hear what the watchdog says, and that it is there."""
        self._looked = monotonic()
        if self._guard.interrupted:
            self._end("stopped by the operator")
        for line in self._guard.said():
            if line == "at rest":
                self._paused.pop("watchdog", None)
            elif line != "ready":
                self._pause("watchdog", f"watchdog: {line}")
        if not self._guard.alive:
            self._end("the watchdog is gone")

    def _go_on(self, state: TableState) -> None:
        """Show the sequencer a state of the table, and do what it says."""
        if self.sequencer.over:
            return
        words = self._interlocks.check(state, self.time, temperature=self.account.temperature)
        if words is not None:
            self._end(words)
            return
        try:
            self._commands = self.sequencer.step(state)
        except TableFault as error:
            self._fail(error)
        self._sections()

    def _tell_what_is_due(self) -> None:
        """Tell the table what the sequencer has said; it may be paused since."""
        commands, self._commands = self._commands, []
        if commands and not self._paused and not self.sequencer.over:
            try:
                self._tell(commands)
            except (TableFault, ProtocolError, LinkLost) as error:
                self._fail(error)

    def _fail(self, error: InercalError) -> None:
        # It may be the watchdog that stopped the table.
        self._look_at_guard()
        if "watchdog" not in self._paused:
            self._end(str(error))

    def _tell(self, commands: list[Command]) -> None:
        for command in commands:
            match command:
                case Enable():
                    self._table.enable()
                case Home():
                    self._table.home()
                case Go(axis, angle, rate, acceleration):
                    self._table.move(self._table.axes[axis], angle, rate, acceleration)
                case _:
                    self._table.stop()

    def _sections(self) -> None:
        """Keep what began and ended."""
        made = self.sequencer.sections
        for one in made:
            self.account.section(self.time, one, holds=not self.tasks[one.number].rate)
            if one.what == "begun":
                self._say("info", f"step {one.number + 1} of {len(self.tasks)}: {one.label}")
        made.clear()

    def _pause(self, why: _Why, words: str) -> None:
        if why in self._paused or self.sequencer.over:
            return
        self._paused[why] = words
        self._say("warning", f"{words}; the table stops, the step in hand will be repeated")
        self._stop(self.sequencer.pause)

    def _end(self, words: str) -> None:
        if self.sequencer.over:
            return
        self.trouble = words
        self._say("alarm", words)
        self._stop(self.sequencer.abort)

    def _stop(self, how: Callable[[float], list[Command]]) -> None:
        """Pause or abort; where the table cannot be told, the watchdog goes on trying."""
        try:
            self._tell(how(self.time if self.state is None else self.state.time))
        except (TableFault, ProtocolError, LinkLost) as error:
            self._say("alarm", f"{error}; the watchdog is told to stop the table")
            self._guard.stop()
        self._sections()

    def _come_to_rest(self) -> None:
        """See the table come to rest; where it does not, or is gone, the watchdog has it."""
        slowest = max(one.rate / one.acceleration for one in self._bench.limits_of_axes)
        until, after = self.time + slowest + _GRACE, self.time + _AFTER
        while self.time < until and not (self._rests and self.time > after):
            self._tick()

    def _work(self) -> None:
        """Have what came worked through, and see that gyros and table agree."""
        try:
            track = self.account.work(self.time)
        except InputError as error:
            self._end(str(error))
            return
        if track is not None and (words := self._interlocks.against_gyros(track)) is not None:
            self._end(words)

    def _attach(self) -> None:
        self.account.attach(self.time, self.sequencer.number, self._table.wraps)

    def _say(self, level: Literal["info", "warning", "alarm"], words: str) -> None:
        self.account.say(self.time, level, words)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        if not self._rests:
            self._leave()
        self._opened.close()

    def _leave(self) -> None:
        """Have the watchdog bring the table to rest, where that was not seen."""
        self._clock.close()  # a simulated bench goes on by itself then
        self._guard.stop()
        until = monotonic() + _LEAVING
        lines = list[str]()
        while "at rest" not in lines and self._guard.alive and monotonic() < until:
            select([], [], [], _LOOKS)
            lines += self._guard.said()
        if "at rest" not in lines:
            self._say("alarm", f"{'; '.join(lines[-1:])}: nobody has seen the table come to rest")


def _clock(addresses: Addresses, options: Options, journal: Journal) -> Clock:
    """Return the bench's clock: a simulated one's own, or the wall's since the run was begun."""
    if addresses.clock:
        return SimulatedClock(addresses.clock, options.speed)
    return WallClock(datetime.fromisoformat(journal.run().begun).timestamp())
