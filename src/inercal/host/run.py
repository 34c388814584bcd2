"""A run on a bench, from the first command to the table at rest: the loop that all else serves.

Every 20 ms of the bench's time, every 80 ms while the table holds its place::

    clock -> table's state and IMU's bytes -> log -> interlocks -> sequencer -> table, log, journal

and now and then what came is assembled, and the sequential estimator of the method, if it has one,
is fed with it. What an estimate is made of is in the log: a run that was interrupted replays it,
and repeats the step that was in hand whole.

On any way out the table comes to rest: by the sequencer, or by the watchdog (`guard`), a process of
its own with its own connection. Both are software; the hardware interlock is the safety function.
"""

from collections.abc import Callable
from contextlib import ExitStack
from datetime import datetime
from functools import partial
from math import degrees
from time import monotonic
from typing import Literal, Self

from inercal.benches.turntable import turntable_of
from inercal.errors import InercalError, InputError
from inercal.host.addresses import Addresses, layout_of_address, open_imu, open_table
from inercal.host.assembly.polls import SELDOM
from inercal.host.clock import Clock, SimulatedClock, WallClock
from inercal.host.drivers.table import TableFault, TableState
from inercal.host.folder import Folder
from inercal.host.guard import Guard
from inercal.host.imu_receiver import ImuReceiver
from inercal.host.interlocks import Interlocks
from inercal.host.interruptions import Interruptions
from inercal.host.journal import Journal
from inercal.host.link import LinkLost
from inercal.host.log import IMU, TABLE
from inercal.host.options import ORDINARY, Options
from inercal.host.recorder import RunRecorder
from inercal.host.sequencer import Command, Sequencer
from inercal.host.states import pack
from inercal.host.table_driver import TableDriver
from inercal.host.tasks import tasks

SHOWN = 0.2  # s of the wall's between two looks at the run
_NO_PACKET = 5.0  # s
_AFTER = 1.0  # s that are recorded on: the last samples wait for what the table says after them
_PATIENCE, _SIMULATED = 600.0, 10.0  # s that it looks for a table that is gone
_GRACE = 5.0  # s to come to rest in, beside what the deceleration takes


class BenchRun:
    """One run, begun or resumed; a context manager that leaves the table at rest.

    Parameters
    ----------
    folder : Folder
    journal : Journal
    addresses : Addresses
    options : Options
    show : callable
        Called with the run itself, now and then.
    every : float
        s of the wall's between two such calls.

    Attributes
    ----------
    name, sensor, axes
        The sensor's name, the sensor, the names of the table's axes.
    time : float
        The run's, s.
    sequencer : Sequencer
    tasks : tuple of Task
    account : RunRecorder
        What came, and what was made of it.

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
        options: Options = ORDINARY,
        show: Callable[["BenchRun"], None] | None = None,
        every: float = SHOWN,
    ):
        run, bench = folder.run, turntable_of(folder.run)
        self.tasks = tasks(bench, run.table_steps)
        self.sequencer = Sequencer(self.tasks, bench.limits_of_axes, journal.done(), bench.names)
        self.name, self.sensor, self.axes = run.sensor.name, run.sensor, bench.names
        self._journal, self._options = journal, options
        self._show: Callable[[BenchRun], None] = show or _blind
        self._every = every
        self._bench, self._poll = bench, journal.header().poll
        self._commands: list[Command] = []
        self._shown, self._waits = 0.0, True
        layout = layout_of_address(addresses.imu)
        if options.temperature is not None and "temperature" not in layout.roles:
            raise InputError(f"packets of {layout.name} carry no temperature that could be watched")
        with ExitStack() as opened:
            self.account = opened.enter_context(RunRecorder(folder, journal, layout))
            self._clock = _clock(addresses, options, journal)
            opened.callback(self._clock.close)
            self._table = opened.enter_context(open_table(addresses.table, bench))
            self._interlocks = self._watched()
            self._require_possible()
            patience = _SIMULATED if addresses.clock else _PATIENCE
            self._guard = opened.enter_context(Guard(addresses.table, patience=patience))
            self._interruptions = Interruptions(self.sequencer, self._guard, self._stop, self._say)
            self._driven = TableDriver(self._table, self._guard, self._clock.now, self._say)
            # A simulated bench stands still from here on: the port opens between two packets.
            clock, now = self._clock, self._clock.now()
            clock.begin(now)
            tick = clock.end()
            waits = bool(addresses.clock)
            self._imu = ImuReceiver(partial(open_imu, addresses.imu, clock.now, waits=waits), tick)
            opened.callback(self._imu.close)
            journal.put_state("running")
            self._opened = opened.pop_all()
        self.time, self._next = tick.time, tick.time + self._poll
        self._packets, self._differ = (0, tick.time), False
        self._since = monotonic(), tick.time
        self._over: float | None = None

    @property
    def state(self) -> TableState | None:
        """The table's, as last read."""
        return self._driven.state

    @property
    def speed(self) -> float:
        """Seconds of the bench in one of the wall's, so far."""
        wall, bench = self._since
        now = monotonic() if self._over is None else self._over
        return (self.time - bench) / max(now - wall, 1e-9)

    @property
    def paused(self) -> str:
        """Why the run pauses; empty where it does not."""
        return self._interruptions.paused

    @property
    def trouble(self) -> str:
        """Why the run was interrupted; empty where it was not."""
        return self._interruptions.trouble

    def ask(self, what: Literal["pause", "go on", "stop"]) -> None:
        """Ask for something, from whichever thread; it is done within a tick."""
        self._interruptions.ask(what)

    def carry_out(self) -> bool:
        """Go through the plan; True when all is done, False when it was interrupted.

        The table is at rest then, or `trouble` says why that is not known.
        """
        with self._guard.catch_signals():
            try:
                self._attach()
                self._clock.begin(self._next)
                # The watchdog of a host that was killed may be stopping the table still.
                self._come_to_rest()
                self._waits = False
                while not self.sequencer.over:
                    self._tick()
                self._come_to_rest()
                self._hear_gyros()
            except LinkLost as error:
                self._interruptions.end(f"the bench's clock is gone: {error}")
            except InercalError as error:
                self._interruptions.end(str(error))
        self._work()
        self._over = monotonic()
        done = self.sequencer.phase == "done" and not self.trouble
        self._journal.put_state("carried out" if done else "interrupted")
        self._look()
        return done

    def _tick(self) -> None:
        """See what the last tick brought, let the bench go on, and do what is to be done of it.

        Between `end` and `begin` a simulated bench stands still: commands reach it there, one tick
        after the state that they are for.
        """
        tick = self._clock.end()
        # A bench that has gone on by itself is not followed tick by tick.
        step = self._poll * (SELDOM if self.sequencer.holding else 1)
        self._next = max(self._next, tick.time) + step
        self.time = tick.time
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
        self._interruptions.look(self.time, self._imu, self._options.patience)
        if fresh is not None:
            self._go_on(fresh[1])
        if self.account.due(self.time):
            self._work()
        if monotonic() - self._shown >= self._every:
            self._shown = monotonic()
            self._look()

    def _look(self) -> None:
        """Show the run to who looks on."""
        try:
            self._show(self)
        except OSError:  # nobody looks any more, and the run goes on
            self._show = _blind

    def _read(self) -> tuple[float, TableState] | None:
        """Return when the table was read, and its state; None where that failed."""
        try:
            return self._driven.read()
        except LinkLost as error:
            self._interruptions.end(str(error))
            return None

    def _go_on(self, state: TableState) -> None:
        """Show the sequencer a state of the table, and do what it says."""
        if self.sequencer.over or self._waits:
            return
        words = self._interlocks.check(state, self.time, temperature=self.account.temperature)
        if words is not None:
            self._interruptions.end(words)
            return
        try:
            self._commands = self.sequencer.step(state)
        except TableFault as error:
            self._interruptions.fail(error)
        self._sections()

    def _tell_what_is_due(self) -> None:
        """Tell the table what the sequencer has said; it may be paused since."""
        commands, self._commands = self._commands, []
        if commands:
            self._interruptions.look_at_guard()  # while it stops the table nothing is commanded
        try:
            self._driven.tell([] if self.paused or self.sequencer.over else commands)
        except InercalError as error:
            self._interruptions.fail(error)

    def _sections(self) -> None:
        """Keep what began and ended."""
        made = self.sequencer.sections
        for one in made:
            self.account.section(self.time, one, holds=not self.tasks[one.number].rate)
            if one.what == "begun":
                self._say("info", f"step {one.number + 1} of {len(self.tasks)}: {one.label}")
        made.clear()

    def _stop(self, how: Callable[[float], list[Command]]) -> None:
        """Pause or abort, `how` the sequencer does."""
        self._driven.stop(how(self.time if self.state is None else self.state.time))
        self._sections()

    def _come_to_rest(self) -> None:
        """See the table come to rest; where it does not, or is gone, the watchdog has it."""
        slowest = max(one.rate / one.acceleration for one in self._bench.limits_of_axes)
        until, after = self.time + slowest + _GRACE, self.time + _AFTER
        while self.time < until and not (self._driven.rests and self.time > after):
            self._tick()

    def _hear_gyros(self) -> None:
        """See that the table rests by the gyros too: an encoder may stand while its axis turns."""
        self._work()
        until = self.time + _GRACE
        while self._interlocks.apart and self.time < until:
            self._tick()
            self._work()
        if self._interlocks.apart:
            self._interruptions.add(
                f"by its encoders the table rests, by the gyros it still turns at "
                f"{degrees(self._interlocks.apart):.3g} °/s or more: cut its power, keep away"
            )

    def _work(self) -> None:
        """Have what came worked through, and see that gyros and table agree."""
        try:
            block = self.account.work(self.time)
        except InputError as error:
            self._interruptions.end(str(error))
            return
        packets = self.account.assembly.tally.bytes.packets
        if packets > self._packets[0] or not self._imu.bytes_come:
            self._packets = packets, self.time
        elif self.time - self._packets[1] > _NO_PACKET:
            self._interruptions.end(
                f"for {_NO_PACKET:g} s bytes have come from the IMU and no packet: are preset and "
                "baud right?"
            )
        if block is None:
            return
        if block.begins:
            self._interlocks = self._watched()
        words = self._interlocks.against_gyros(block.track)
        if words is not None and not self._differ:
            self._differ = True
            self._interruptions.end(words)
        if self._interlocks.encoder_stands:
            self._driven.coast()

    def _watched(self) -> Interlocks:
        return Interlocks(self._table.limits, self._bench, self.sensor, self._options.temperature)

    def _require_possible(self) -> None:
        """Refuse a plan that the controller would refuse, and limits that nothing is held to."""
        for task in self.tasks:
            for name, most, held, *angles in zip(
                self.axes, self._table.limits, self._bench.limits_of_axes, task.start, task.end,
                strict=True,
            ):  # fmt: skip
                for angle in angles:
                    most.check(name, task.rate or held.rate, held.acceleration, angle)

    def _attach(self) -> None:
        self.account.attach(self.time, self.sequencer.number, self._table.wraps)

    def _say(self, level: Literal["info", "warning", "alarm"], words: str) -> None:
        self.account.say(self.time, level, words)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        try:
            if not self._driven.rests:
                self._clock.close()  # a simulated bench goes on by itself then
                if (words := self._driven.leave()) is not None:
                    self._interruptions.add(words)
        except BaseException:
            self._guard.leave()  # who does not wait for it, by another Ctrl-C, does not call it off
            raise
        finally:
            self._opened.close()


def _blind(run: BenchRun) -> None:
    """Show nothing."""


def _clock(addresses: Addresses, options: Options, journal: Journal) -> Clock:
    """Return the bench's clock: a simulated one's own, or the wall's since the run was begun."""
    if addresses.clock:
        return SimulatedClock(addresses.clock, options.speed)
    return WallClock(datetime.fromisoformat(journal.header().begun).timestamp())
