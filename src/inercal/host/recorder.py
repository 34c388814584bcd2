"""Records a run: writes the log and the journal, and computes samples and the live estimate.

The log contains all data for an estimate and is written first. The journal contains the information
for the operator and for a resumed run. Everything else is computed from the log, so a resumed run
replays the log.
"""

import json
from collections import deque
from math import inf, isfinite
from time import monotonic
from typing import Any, Literal, NamedTuple

import numpy as np

from inercal.basics.closeable import Closeable, on_failure
from inercal.basics.errors import InercalError
from inercal.benches.turntable import require_turntable
from inercal.host.assembly import SampleAssembler, SampleBlock
from inercal.host.clock import HostUptime, read_host_uptime
from inercal.host.drivers.rotary_table import RotaryTable, unpack_states
from inercal.host.journal import Journal
from inercal.host.live_estimator import LiveEstimator, NavigationSolution, Navigator, is_whole_imu
from inercal.host.packets import PacketLayout
from inercal.host.run_folder import RunFolder
from inercal.host.run_log import CHAMBER, EVENT, IMU, TABLE, LogFrame, RunLog, read_frames
from inercal.host.sequencer import SectionEvent

# Bench time of the data that are processed at once, s. It is also the interval between comparisons
# of gyros and table.
_PIECE_MIN, PIECE_MAX = 0.2, 5.0
_PIECE_WALL = 0.1  # s of wall time
_RECENT_COUNT = 8  # number of recent events and of recent blocks
_LOSS_WARNING_INTERVAL = 60.0  # s
_IMU_LATENCY = 0.05  # s; longest delay of the bytes: USB converter and one tick


class LogEnd(NamedTuple):
    """The state at the end of the log of a run that is resumed.

    Parameters
    ----------
    time : float
        Largest run time in the log, s; 0 if the log is empty.
    poll : (float, float) or None
        Run time and controller time of the last reading of the table, s.
    session : (float, HostUptime) or None
        Run time, s, and host's uptime at the beginning of the last session.
    """

    time: float = 0.0
    poll: tuple[float, float] | None = None
    session: tuple[float, HostUptime] | None = None

    def resumed_time(self, table: RotaryTable) -> float:
        """Return the present run time, s; it is found from the end of the log, without the date.

        The host's uptime shows for how long the run had no host. If the host was rebooted, the
        table's clock shows this, up to one wrap of the clock. If neither is possible, the gap is
        assumed to be zero. The IMU's counter then does not agree, which is reported.
        """
        now = read_host_uptime()
        if self.session is not None and now is not None and self.session[1].boot == now.boot:
            time, then = self.session
            return max(self.time, time + now.seconds - then.seconds)
        if self.poll is None or not isfinite(controller := table.read().time):
            return self.time
        time, before = self.poll
        passed = controller - before
        if isfinite(table.wrap_period):
            passed %= table.wrap_period
        return max(self.time, time + passed)


class RunRecorder(Closeable):
    """Records a new or resumed run; a context manager.

    Parameters
    ----------
    folder : RunFolder
    journal : Journal
    layout : PacketLayout
        Layout of the IMU's packets.

    Attributes
    ----------
    assembly : SampleAssembler
    log_end : LogEnd
        State at the end of the log when it was opened.
    live_estimator : LiveEstimator or None
        Live estimate; None if the method has no sequential estimator.
    navigation : NavigationSolution or None
        Attitude and velocity, computed only from the corrected readings of an IMU. They are
        available after all its coefficients have been estimated.
    events : int
        Number of events so far.
    recent_messages : deque of (str, str)
        Level and text of the latest events.
    blocks : deque of SampleBlock
        The latest samples; their user removes them.

    Raises
    ------
    InputError
        The log is damaged, or the packets do not match the run file.
    """

    def __init__(self, folder: RunFolder, journal: Journal, layout: PacketLayout):
        run = folder.run
        self.assembly = SampleAssembler(run, layout, journal.header().poll)
        # Packets have no temperature for each sample, so its coefficients are estimated after the
        # run.
        self._estimates = run.method.sequential is not None and not run.sensor.uses("dT")
        self.live_estimator = LiveEstimator(run) if self._estimates else None
        # Without readback, there is no attitude of the table to start from or to compare with.
        has_attitude = run.motion_control.has_attitude
        navigates = is_whole_imu(run.sensor) and has_attitude and require_turntable(run).readback
        self._new_navigator = lambda: (
            Navigator(run.sensor, require_turntable(run)) if navigates else None
        )
        self._navigator = self._new_navigator()
        self.navigation: NavigationSolution | None = None
        self.events = 0
        self.recent_messages: deque[tuple[str, str]] = deque(maxlen=_RECENT_COUNT)
        self.blocks: deque[SampleBlock] = deque(maxlen=_RECENT_COUNT)
        self._journal = journal
        # Sections that are not yet in the journal, with their run times.
        self._waiting_sections: deque[tuple[float, SectionEvent]] = deque()
        self._last_processing = -inf, -inf
        self._losses, self._last_loss_warning = (0, 0, 0, 0), 0.0
        self._log = RunLog(folder.log)
        with on_failure(self._log.close):
            self.log_end = self._replay(folder)

    @property
    def estimation(self) -> Literal["none", "waits", "on", "ended"]:
        """State of live estimation; "none" if the method has no sequential estimator."""
        if self.live_estimator is None:
            return "ended" if self._estimates else "none"
        return "on" if self.live_estimator.has_estimate else "waits"

    @property
    def logged_steps(self) -> int:
        """How many steps are complete in the log; the journal knows more if its end was lost."""
        done = (one.number + 1 for one in self.assembly.sections.spans if one.state == "done")
        return max(done, default=0)

    @property
    def temperature(self) -> float:
        """Latest temperature of the IMU, K; NaN if unknown."""
        return self.assembly.imu.temperature

    def record_frame(self, kind: int, time: float, payload: bytes) -> None:
        """Record bytes that were received from a device at a run time, s."""
        self._log.append(kind, time, payload)
        self.assembly.feed(LogFrame(kind, time, payload))
        if kind == IMU:
            self._record_waiting_sections(time - _IMU_LATENCY)

    def record_session(
        self, time: float, following: int, wraps: float, uptime: HostUptime | None = None
    ) -> None:
        """Record the start of a session: the next sample does not continue the previous one.

        Parameters
        ----------
        time : float
            Run time, s.
        following : int
            Number of the next step. This step and all later steps must be repeated if they were
            begun.
        wraps : float
            Time after which the table's clock wraps around, s.
        uptime : HostUptime, optional
            The host's uptime at `time`, if the run uses the host's clock.
        """
        known: dict[str, object] = {"wraps": wraps} if isfinite(wraps) else {}
        if uptime is not None:
            known |= {"boot": uptime.boot, "uptime": uptime.seconds}
        self._event(time, {"what": "session", "next": following, **known})

    def record_section(self, time: float, one: SectionEvent, *, holds: bool) -> None:
        """Record that a section began or ended.

        The log records this at once. The journal records it only after the IMU's bytes up to this
        time are in the log. If the host is killed before this, the section is therefore repeated,
        because its last samples are lost.
        """
        content = {"number": one.number, "label": one.section, "state": one.state, "time": one.time}
        self._event(time, {"what": "section", **content, "hold": holds})
        self._waiting_sections.append((time, one))

    def record_interruption(self, time: float, cause: str | None, lasted: float = 0.0) -> None:
        """Record why the table is stopped; the cause began `lasted` s ago.

        If the cause is None, the run continues.
        """
        self._event(time, {"what": "interruption", "cause": cause, "since": time - lasted})

    def record_chamber(self, time: float, chamber: float, target: float) -> None:
        """Record the temperature and the set temperature of the chamber, K."""
        self._event(time, {"what": CHAMBER, "temperature": chamber, "target": target})

    def record_message(
        self, time: float, level: Literal["info", "warning", "alarm"], words: str
    ) -> None:
        """Record a message to the operator."""
        self.events += 1
        self.recent_messages.append((level, words))
        self._journal.record_event(level, words, time)

    def is_processing_due(self, time: float) -> bool:
        """Return whether `process_pending` is due; the time of processing does not affect results.

        Each piece has a fixed cost, so pieces are larger for an accelerated bench.
        """
        came, passed = time - self._last_processing[0], monotonic() - self._last_processing[1]
        return came >= _PIECE_MIN and (passed >= _PIECE_WALL or came >= PIECE_MAX)

    def process_pending(self, time: float) -> SampleBlock | None:
        """Convert the received data to samples, update the estimate, and return the new samples.

        Raises
        ------
        InputError
            A device has reset its clock.
        """
        block = self._process_piece(time)
        if block is not None:
            for words in self._loss_warnings(time):
                self.record_message(time, "warning", words)
        return block

    def _process_piece(self, time: float) -> SampleBlock | None:
        self._last_processing = time, monotonic()
        block = self.assembly.take()
        if block is not None:
            self.blocks.append(block)
            self._update_estimate(block, time)
        return block

    def _update_estimate(self, block: SampleBlock, time: float) -> None:
        if self.live_estimator is None:
            return
        if block.starts_recording:
            self._navigator = self._new_navigator()
        try:
            self.live_estimator.feed(block)
            if self._navigator is not None and np.isfinite(self.live_estimator.values).all():
                self.navigation = self._navigator.feed(block.track, self.live_estimator.values)
        except Exception as error:
            # The recording is more important than the estimate, because it can be calibrated in
            # other ways. A method may come from another package, so none of its exceptions may end
            # a run while the table moves.
            self.live_estimator = None
            what = "" if isinstance(error, InercalError) else f"{type(error).__name__}: "
            words = f"live estimation ends: {what}{error}"
            # If a resumed run reaches an end that was already reported, do not report it again.
            if all(event.words != words for event in self._journal.events()):
                self.record_message(time, "warning", words)

    def _loss_warnings(self, time: float) -> list[str]:
        """Return messages about losses; a message is repeated if the losses increase."""
        assembly, before = self.assembly, self._losses
        counts, table = assembly.imu.counts, assembly.table
        samples = assembly.samples + assembly.samples_without_angle
        left_out = assembly.samples_without_angle + assembly.samples_with_unusable_angle
        losses = counts.lost, counts.failed, left_out, table.implausible
        if losses == before or time - self._last_loss_warning < _LOSS_WARNING_INTERVAL:
            return []
        self._losses, self._last_loss_warning = losses, time
        result: list[str] = []
        if losses[:2] != before[:2]:
            result.append(
                f"so far {counts.lost} packets of {counts.packets + counts.lost} were lost, and "
                f"{counts.failed} had a checksum error"
            )
        if left_out != before[2]:
            result.append(
                f"so far {left_out} samples of {samples} have "
                "no usable angle: the table was polled too slowly while it turned, or was homing"
            )
        if table.implausible != before[3]:
            result.append(
                f"so far {table.implausible} readings of {table.count} of the table were "
                "left out: they imply motion beyond its limits; a corrupted digit, noise, an "
                "intermittent offset or a clock jump looks like this"
            )
        return result

    def _record_waiting_sections(self, until: float) -> None:
        while self._waiting_sections and self._waiting_sections[0][0] <= until:
            _, one = self._waiting_sections.popleft()
            self._journal.record_section(one.number, one.label, one.state, one.time)

    def _event(self, at: float, content: dict[str, object]) -> None:
        self.record_frame(EVENT, at, json.dumps(content).encode())

    def _replay(self, folder: RunFolder) -> LogEnd:
        """Replay the log of an interrupted run, without reporting earlier events again."""
        done = latest = 0.0
        last: dict[int, LogFrame] = {}
        session: LogFrame | None = None
        for frame in read_frames(folder.log):
            self.assembly.feed(frame)
            latest, last[frame.kind] = max(latest, frame.time), frame
            if frame.kind == EVENT and b'"session"' in frame.payload:
                session = frame
            if latest - done >= PIECE_MAX:
                done = latest
                self._process_piece(done)
                self._loss_warnings(done)
        self._process_piece(latest)
        self.assembly.take_received()  # discarded, because viewers only see new data
        return LogEnd(latest, _read_poll(last.get(TABLE)), _read_session(session))

    def close(self) -> None:
        """Close the log."""
        self._log.close()


def _read_poll(frame: LogFrame | None) -> tuple[float, float] | None:
    """Return the run time and the controller time of a table reading, s."""
    return frame and (frame.time, float(unpack_states([frame.payload]).time[0]))


def _read_session(frame: LogFrame | None) -> tuple[float, HostUptime] | None:
    """Return the run time, s, and the host's uptime at the beginning of a session."""
    event: dict[str, Any] = json.loads(frame.payload) if frame else {}
    if frame is None or "uptime" not in event:
        return None
    return frame.time, HostUptime(str(event["boot"]), float(event["uptime"]))
