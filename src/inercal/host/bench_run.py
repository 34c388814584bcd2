"""Run the main loop of a bench, from the first command until the table is at rest.

The loop runs every 20 ms of bench time, or every 80 ms while the table holds its position::

    clock -> table's state and IMU's bytes -> log -> interlocks -> sequencer -> table, log, journal

At intervals, the received data are converted to samples and passed to the sequential estimator of
the method, if there is one. The log contains all data that an estimate uses, so a resumed run
replays its log and repeats the interrupted step from the beginning.

However the run ends, the table is brought to rest by the sequencer or by the watchdog (`guard`), a
separate process with its own connection. Both are software; the hardware interlock is the safety
function.
"""

from collections.abc import Callable
from contextlib import ExitStack
from functools import partial
from math import degrees, inf, nan
from time import monotonic, sleep
from typing import Literal

import numpy as np

from inercal.basics.closeable import Closeable
from inercal.basics.errors import InercalError, InputError
from inercal.benches.motion_control import SpinTask
from inercal.benches.turntable import require_turntable
from inercal.host.addresses import DeviceAddresses, layout_of_address, open_imu, open_table
from inercal.host.assembly.poll_record import CLOCK_LOST
from inercal.host.assembly.reading_plausibility import ReadingPlausibility
from inercal.host.assembly.table_polls import HOLD_POLL_FACTOR, RatePlausibility
from inercal.host.clock import Clock, HostUptime, MonotonicClock, SimulatedClock, read_host_uptime
from inercal.host.drivers.rotary_table import TableFault, TableState, pack_state
from inercal.host.further_imus import FurtherImus
from inercal.host.guard import Guard
from inercal.host.imu_port import ImuReceiver
from inercal.host.interlocks import MAX_CHECK_INTERVAL, Interlocks, LastChecks, ReadbackWarnings
from inercal.host.interruptions import Interruptions
from inercal.host.journal import Journal
from inercal.host.link import LinkLost
from inercal.host.preparation import require_feasible_plan, require_thermometer
from inercal.host.recorder import PIECE_MAX, RunRecorder
from inercal.host.run_folder import RunFolder
from inercal.host.run_log import IMU, TABLE
from inercal.host.sequencer import Command
from inercal.host.soaks import SoakControl, open_soaks
from inercal.host.spin_sequencer import (
    MountingPrompt,
    MountingRequest,
    SpinSequencer,
    create_sequencer,
)
from inercal.host.table_driver import READ_TIMEOUT, TableDriver
from inercal.host.table_lock import TableLock
from inercal.host.tasks import DEFAULT_OPTIONS, RunOptions, host_plan

SHOW_INTERVAL = 0.2  # s of wall time between two updates of the display
_PACKET_TIMEOUT = 5.0  # s
_SIMULATED_READ_TIMEOUT = 1.0  # s
# Time for which recording continues at the end, s, because the last samples need another reading of
# the table.
_RECORDING_TAIL = 1.0
_PATIENCE, _SIMULATED_PATIENCE = 600.0, 10.0  # s; the watchdog tries to reach a lost table
_DATING_TIMEOUT = 10.0  # s; the first packets of a resumed run must be dated within this time
_GRACE = 5.0  # s in addition to the deceleration time


class BenchRun(Closeable):
    """A new or resumed run. At the end of its `with` block, the table is at rest.

    Parameters
    ----------
    folder : RunFolder
    journal : Journal
    addresses : DeviceAddresses
    options : RunOptions
    show : callable
        Function that is called with this run at intervals.
    show_interval : float
        Wall time between two calls of `show`, s.

    Attributes
    ----------
    name, sensor, axes
        The name of the sensor, the sensor, and the names of the table's axes.
    time : float
        Run time, s.
    sequencer : Sequencer or SpinSequencer
    tasks : tuple of Task
    recorder : RunRecorder
        Records the received data and converts them to samples.
    soaks : SoakControl or None
        The chamber of a plan with soaks.

    Raises
    ------
    InputError
        A host cannot drive this kind of bench, an address is invalid, the log is damaged, or
        another program commands the table.
    LinkLost
        A device does not answer.
    """

    def __init__(
        self,
        folder: RunFolder,
        journal: Journal,
        addresses: DeviceAddresses,
        options: RunOptions = DEFAULT_OPTIONS,
        show: Callable[["BenchRun"], None] | None = None,
        show_interval: float = SHOW_INTERVAL,
    ):
        run, plan = folder.run, host_plan(folder.run)
        bench, self.tasks = plan.bench, plan.tasks
        self.name, self.sensor, self.axes = run.sensor.name, run.sensor, bench.names
        self._journal, self._options = journal, options
        self._show: Callable[[BenchRun], None] = show or _show_nothing
        self._show_interval = show_interval
        self._bench, self._poll = bench, journal.header().poll
        self._commands: list[Command] = []
        self._show_time, self._before_start, self._clocks_lost = -inf, True, False
        layout = layout_of_address(addresses.imu)
        require_thermometer(options, layout)
        with ExitStack() as opened:
            self.recorder = opened.enter_context(RunRecorder(folder, journal, layout))
            done = min(journal.completed_steps(), self.recorder.logged_steps)
            self.sequencer = create_sequencer(plan, done, journal.mounting())
            # Earlier readings were checked when they were received. A fault may have been repaired
            # since then.
            self._checked_from = self.recorder.assembly.table.last
            # The table is locked before anything is sent, because another run may be commanding it.
            opened.enter_context(TableLock(addresses.table, f"run {folder.path.resolve()}"))
            # On a busy machine, a simulated table may answer slowly.
            timeout = _SIMULATED_READ_TIMEOUT if addresses.clock else READ_TIMEOUT
            self._table = opened.enter_context(open_table(addresses.table, bench, timeout))
            self._clock, self._last_checks = self._open_clock(addresses)
            opened.callback(self._clock.close)
            self._interlocks = self._create_interlocks()
            self._readback_warnings = ReadbackWarnings(bench, self.sensor)
            self._plausibility = (
                RatePlausibility(bench.axis_motion_limits)
                if plan.spins
                else ReadingPlausibility(require_turntable(run))
            )
            require_feasible_plan(self.tasks, self._table.limits, bench)
            patience = _SIMULATED_PATIENCE if addresses.clock else _PATIENCE
            self._guard = opened.enter_context(Guard(addresses.table, patience=patience))
            self._interruptions = Interruptions(
                self.sequencer, self._guard, self._stop, self._go_on, self._say
            )
            self._table_driver = TableDriver(self._table, self._guard, self._clock.now, self._say)
            self._mounting: MountingPrompt | None = None
            if isinstance(self.sequencer, SpinSequencer):  # such a plan has no mountings
                self._mounting = MountingPrompt(self.sequencer, journal, self._clock, self._say)
                self._mounting.restore()
            # From here on, a simulated bench stands still, so the port opens between two packets.
            clock, now = self._clock, self._clock.now()
            clock.begin(now)
            tick = clock.end()
            self._is_simulated = bool(addresses.clock)
            self._imu = ImuReceiver(
                partial(open_imu, addresses.imu, clock.now, synchronous=self._is_simulated), tick
            )
            opened.callback(self._imu.close)
            record, simulated = self.recorder.record_chamber, self._is_simulated
            further, recorder = journal.further_imus(), self.recorder
            self._further_imus = FurtherImus(further, clock, tick, recorder, simulated=simulated)
            opened.callback(self._further_imus.close)
            self.soaks = open_soaks(journal.chamber(), run, layout, self._say, record, simulated)
            if self.soaks is not None:
                opened.callback(self.soaks.close)
                self.sequencer.may_begin = self.soaks.may_begin
            journal.set_state("running")
            self._open_resources = opened.pop_all()
        self.time, self._next = tick.time, tick.time + self._poll
        self._packets, self._gyros_disagree = (0, tick.time), False
        self._speed_reference = monotonic(), tick.time
        self._end_time: float | None = None

    @property
    def state(self) -> TableState | None:
        """The last state that was read from the table."""
        return self._table_driver.state

    @property
    def speed(self) -> float:
        """Mean speed so far: bench time divided by wall time."""
        wall, bench = self._speed_reference
        now = monotonic() if self._end_time is None else self._end_time
        return (self.time - bench) / max(now - wall, 1e-9)

    @property
    def pause_reason(self) -> str:
        """Reason why the run is paused; empty if it is not paused."""
        return self._interruptions.pause_reason

    @property
    def trouble(self) -> str:
        """Reason why the run was interrupted; empty if it was not interrupted."""
        return self._interruptions.trouble

    @property
    def needs_new_run(self) -> bool:
        """Whether the run cannot be resumed, because clocks of devices cannot be related again."""
        return self._clocks_lost or self.recorder.assembly.imu.mismatch is not None

    @property
    def mounting_request(self) -> MountingRequest | None:
        """The mounting that the operator must confirm; None if there is none."""
        return self._mounting.request if self._mounting else None

    @property
    def has_mountings(self) -> bool:
        """Whether an operator mounts the sensor during the run."""
        return any(isinstance(task, SpinTask) for task in self.tasks)

    def call_before_request(self, drop: Callable[[], object]) -> None:
        """Register a function that the run's thread calls before each request for a mounting."""
        if self._mounting:
            self._mounting.before_request = drop

    def confirm_mounting(self, number: int, mounting: str, by: str) -> None:
        """Confirm the mounting that a request asked for; any thread may call this."""
        if self._mounting:
            self._mounting.confirm(number, mounting, by)

    def request(self, what: Literal["pause", "go on", "stop"]) -> None:
        """Request a command, from any thread; it is executed within one tick."""
        self._interruptions.request(what)

    def execute_plan(self) -> bool:
        """Carry out the plan; return True if it was completed and False if it was interrupted.

        When this method returns, the table is at rest, or `trouble` says why this is unknown.
        """
        with self._guard.catch_signals():
            try:
                self._record_session()
                self._clock.begin(self._next)
                if (stopped := self.recorder.log_end.time) > 0:
                    again = f"resumed at {self.time:.1f} s with step {self.sequencer.number + 1}"
                    self._say("info", f"interrupted at {stopped:.1f} s, {again}")
                if self.sequencer.number < (known := self._journal.completed_steps()):
                    again = f"{known} steps are complete, but the log ends before; repeating them"
                    self._say("warning", f"{again} from step {self.sequencer.number + 1} on")
                # If an earlier host was killed, its watchdog may still be stopping the table.
                self._wait_for_rest()
                self._table_driver.require_idle()
                # A device that has reset its clock is reported before anything moves.
                self._wait_for_dates()
                self._begin_checks()
                self._before_start = False
                while not self.sequencer.is_over:
                    self._tick()
                self._wait_for_rest()
                self._check_rest_with_gyros()
            except LinkLost as error:
                self._interruptions.end(f"the bench's clock does not answer: {error}")
            except InercalError as error:
                self._interruptions.end(str(error))
        self._process_pending()
        for warning in self._readback_warnings.find(self.recorder.assembly.recording_start or 0.0):
            self._say("warning", warning)
        self._end_time = monotonic()
        done = self.sequencer.phase == "done" and not self.trouble
        self._journal.set_state("carried out" if done else "interrupted")
        self._show_state()
        return done

    def _tick(self) -> None:
        """Process the results of the last tick, let the bench advance, and send commands.

        Between `end` and `begin`, a simulated bench stands still. Commands reach it at this time,
        one tick after the state to which they respond.
        """
        tick = self._clock.end()
        # If a bench has advanced by itself, its ticks are skipped.
        step = self._poll * (HOLD_POLL_FACTOR if self.sequencer.is_holding else 1)
        late, self._next = tick.time - self._next, max(self._next, tick.time) + step
        self.time = tick.time
        self._guard.beat()
        self._interruptions.follow_host(0.0 if self._before_start else late)
        if self._mounting:
            self._mounting.update(self.time if self.state is None else self.state.time)
        self._send_commands()
        fresh = self._read()
        self._further_imus.take(tick)  # first: a section is complete when the main IMU's are in
        heard = self._imu.take(tick)
        self._clock.begin(self._next)
        if fresh is not None:
            self.recorder.record_frame(TABLE, fresh[0], pack_state(fresh[1]))
        if heard.reopened:
            self._record_session()
        for time, data in heard.pieces:
            self.recorder.record_frame(IMU, time, data)
        self._update_last_checks()
        if self.soaks is not None:
            self._follow_chamber(self.soaks)
        self._interruptions.update(self.time, self._imu, self._last_checks, self._options.patience)
        if fresh is not None and self._is_plausible(fresh[1]):
            self._advance_sequencer(fresh[1])
        if self.recorder.is_processing_due(self.time):
            self._process_pending()
        if self._is_simulated and self.mounting_request is not None:
            sleep(step)  # a simulated bench waits while its operator works
        if monotonic() - self._show_time >= self._show_interval:
            self._show_time = monotonic()
            self._show_state()

    def _follow_chamber(self, soaks: SoakControl) -> None:
        """Read the chamber; end the run if it must end, and pause it if there is no answer."""
        kelvin = self.recorder.temperature if self._imu.is_receiving else nan
        ended = self.sequencer.is_over
        words = soaks.update(self.time, self.sequencer.number, kelvin, ended=ended)
        if words is not None:
            self._interruptions.end(words)
        if not ended:
            self._interruptions.follow("chamber", soaks, self.time, self._options.patience)

    def _show_state(self) -> None:
        """Show the run to its viewers."""
        try:
            self._show(self)
        except OSError:  # the viewer is gone, but the run continues
            self._show = _show_nothing

    def _read(self) -> tuple[float, TableState] | None:
        """Read the table; return the time and the state, or None if the reading failed."""
        try:
            return self._table_driver.read()
        except LinkLost as error:
            self._interruptions.end(str(error))
            return None

    def _is_plausible(self, state: TableState) -> bool:
        """Return whether a reading is plausible; end the run if too many are implausible.

        An implausible reading is logged, but it has no other effect.
        """
        if self._plausibility.accept_state(state):
            return True
        if self._plausibility.is_fault and not self.sequencer.is_over:  # report it only once
            self._interruptions.end(self._plausibility.fault_text)
        return False

    def _advance_sequencer(self, state: TableState) -> None:
        """Pass a table state to the sequencer and send the commands that it returns."""
        if self.sequencer.is_over or self._before_start:
            return
        words = self._interlocks.check(state, self.time, temperature=self.recorder.temperature)
        words = words or self._table_driver.commanded_motion.check(
            state, hands_on=self.mounting_request is not None
        )
        self._last_checks.record("table", self.time)
        if words is not None:
            self._interruptions.end(words)
            return
        try:
            self._commands = self.sequencer.step(state)
        except TableFault as error:
            self._interruptions.handle_table_error(error)
        self._record_sections()

    def _send_commands(self) -> None:
        """Send the sequencer's commands to the table, unless the run was paused in the meantime."""
        commands, self._commands = self._commands, []
        if commands:
            self._interruptions.check_guard()  # no commands while the watchdog stops the table
        try:
            self._table_driver.send([] if self.pause_reason or self.sequencer.is_over else commands)
        except InercalError as error:
            self._interruptions.handle_table_error(error)

    def _record_sections(self) -> None:
        """Record which sections began and ended."""
        result = self.sequencer.sections
        for one in result:
            self.recorder.record_section(self.time, one, holds=not self.tasks[one.number].rate)
            if one.state == "begun":
                self._say("info", f"step {one.number + 1} of {len(self.tasks)}: {one.label}")
        result.clear()

    def _stop(self, how: Callable[[float], list[Command]], cause: str, lasted: float) -> None:
        """Pause or abort by calling `how`; the cause began `lasted` s ago."""
        self._table_driver.stop(how(self.time if self.state is None else self.state.time))
        self._plausibility.expect_stop()
        self.recorder.record_interruption(self.time, cause, lasted)
        self._record_sections()

    def _go_on(self) -> None:
        self.recorder.record_interruption(self.time, None)

    def _wait_for_rest(self) -> None:
        """Wait until the table is at rest; if it does not stop, the watchdog takes over."""
        slowest = max(one.rate / one.acceleration for one in self._bench.axis_motion_limits)
        until, after = self.time + slowest + _GRACE, self.time + _RECORDING_TAIL
        while self.time < until and not (self._table_driver.at_rest and self.time > after):
            self._tick()

    def _wait_for_dates(self) -> None:
        """Check that the IMU's packets can be dated; end the run if they cannot."""
        self._process_pending()
        until = self.time + _DATING_TIMEOUT
        while self.recorder.assembly.imu.waits_for_dates and self.time < until:
            self._tick()
            self._process_pending()
        if (words := self.recorder.assembly.imu.mismatch) is not None:
            self._interruptions.end(words)

    def _check_rest_with_gyros(self) -> None:
        """Check with the gyros that the table is at rest, because an encoder may be frozen."""
        self._process_pending()
        until = self.time + _GRACE
        while self._interlocks.rate_difference and self.time < until:
            self._tick()
            self._process_pending()
        if self._interlocks.rate_difference:
            self._interruptions.add(
                f"the encoders report rest, but the gyros measure "
                f"{degrees(self._interlocks.rate_difference):.3g} °/s or more: "
                "keep away from the table, and cut its power"
            )

    def _process_pending(self) -> None:
        """Process the received data, and check that gyros and table agree."""
        try:
            block = self.recorder.process_pending(self.time)
        except InputError as error:
            self._clocks_lost = set(error.names) >= CLOCK_LOST
            self._interruptions.end(str(error))
            return
        if (mismatch := self.recorder.assembly.imu.mismatch) is not None:
            self._imu.set_trouble(mismatch, self.time)
        packets = self.recorder.assembly.imu.counts.packets
        if packets > self._packets[0] or not self._imu.is_receiving:
            self._packets = packets, self.time
        elif self.time - self._packets[1] > _PACKET_TIMEOUT:
            self._interruptions.end(
                f"the IMU has sent bytes for {_PACKET_TIMEOUT:g} s, but no valid packet: "
                "check preset and baud"
            )
        if block is None:
            return
        if block.starts_recording:
            start = self.recorder.assembly.recording_start or 0.0
            self._say("info", f"the recording begins at {start:.1f} s; a verdict counts from there")
            self._interlocks = self._create_interlocks()
            self._readback_warnings.restart()
        old = int(np.searchsorted(block.table, self._checked_from, "right"))
        fresh = block.track.slice(old, block.table.size).with_known_angles
        words = self._interlocks.check_gyros(fresh)
        begin = self.recorder.assembly.recording_start or 0.0
        if self.sequencer.is_waiting:
            # The biases of the gyros change with the temperature.
            self._readback_warnings.restart()
        for warning in self._readback_warnings.find(begin, fresh):
            self._say("warning", warning)
        self._last_checks.record("gyros", self.time)
        if words is not None and not self._gyros_disagree:
            self._gyros_disagree = True
            self._interruptions.end(words)
        if self._interlocks.encoder_stuck:
            self._table_driver.switch_servos_off()

    def _open_clock(self, addresses: DeviceAddresses) -> tuple[Clock, LastChecks]:
        """Return the clock of the bench, and a monitor for the last check of each interlock."""
        if not addresses.clock:
            start = self.recorder.log_end.resumed_time(self._table)
            return MonotonicClock(start), LastChecks()
        # A simulated bench waits for its host, which may process several seconds of data at once.
        ticks = 3 * HOLD_POLL_FACTOR * self._poll
        checks = LastChecks(max(MAX_CHECK_INTERVAL, ticks), PIECE_MAX + ticks)
        return SimulatedClock(addresses.clock, self._options.speed), checks

    def _begin_checks(self) -> None:
        """Require that the interlocks run on schedule from now on."""
        self._last_checks.record("table", self.time)
        if self.recorder.assembly.is_recording:
            self._last_checks.record("gyros", self.time)

    def _update_last_checks(self) -> None:
        """Check for overdue interlocks; none is due before and after the plan (nothing moves)."""
        homed = self.state is not None and all(axis.homed for axis in self.state.axes)
        if not (homed and self.recorder.assembly.is_recording and self._interlocks.has_gyros):
            self._last_checks.pause("gyros")
        if not (self._before_start or self.sequencer.is_over):
            self._last_checks.update(self.time)

    def _create_interlocks(self) -> Interlocks:
        return Interlocks(self._table.limits, self._bench, self.sensor, self._options.temperature)

    def _record_session(self) -> None:
        self._plausibility.restart()
        uptime = None if self._is_simulated else read_host_uptime()
        if uptime is not None:  # converted to the time of the session, a moment ago
            uptime = HostUptime(uptime.boot, uptime.seconds - (self._clock.now() - self.time))
        self.recorder.record_session(
            self.time, self.sequencer.number, self._table.wrap_period, uptime
        )

    def _say(self, level: Literal["info", "warning", "alarm"], words: str) -> None:
        self.recorder.record_message(self.time, level, words)

    def close(self) -> None:
        """Leave the table at rest, and close all connections."""
        try:
            driver = self._table_driver
            driver.leave(self._clock, self._interruptions.add, at_rest=driver.at_rest)
        finally:
            self._open_resources.close()


def _show_nothing(run: BenchRun) -> None:
    """Do nothing."""
