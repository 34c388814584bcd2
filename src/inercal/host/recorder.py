"""Recorder of a run: it writes log and journal, and derives samples and the live estimate.

The log has all data of an estimate and is written first; the journal has what the operator and a
resumed run need. All else is derived from the log: a resumed run replays it.
"""

import json
from collections import deque
from contextlib import ExitStack
from math import inf, isfinite, nan
from time import monotonic
from typing import Any, Literal, NamedTuple

import numpy as np

from inercal.basics.errors import InercalError
from inercal.benches.turntable import require_turntable
from inercal.host.assembly import SampleAssembler, SampleBlock
from inercal.host.clock import HostUptime, read_host_uptime
from inercal.host.closeable import Closeable
from inercal.host.drivers.rotary_table import RotaryTable
from inercal.host.journal import Journal
from inercal.host.live_estimator import LiveEstimator, NavigationSolution, Navigator, is_whole_imu
from inercal.host.packets import PacketLayout
from inercal.host.run_folder import RunFolder
from inercal.host.run_log import EVENT, IMU, TABLE, LogFrame, RunLog, read_frames
from inercal.host.table_state_codec import unpack_states
from inercal.host.task_sequencer import SectionEvent

# s of the bench that are worked through at a time: the gyros are compared with the table as often
_PIECE_MIN, PIECE_MAX = 0.2, 5.0
_PIECE_WALL = 0.1  # s of the wall's
_RECENT_COUNT = 8  # events, and blocks, that are at hand
_LOSS_WARNING_INTERVAL = 60.0  # s
_IMU_LATENCY = (
    0.05  # s from a sample to its bytes' arrival, at most: a USB converter's and a tick's
)


class LogEnd(NamedTuple):
    """The end of a log that is continued.

    Parameters
    ----------
    time : float
        The largest time of a frame, s of the run; 0 where the log is empty.
    poll : (float, float) or None
        s of the run and of the controller's clock, of the last reading of the table.
    session : (float, HostUptime) or None
        s of the run, and how long the host was up, when its last session began.
    """

    time: float = 0.0
    poll: tuple[float, float] | None = None
    session: tuple[float, HostUptime] | None = None

    def resumed_time(self, table: RotaryTable) -> float:
        """Return the run's time now, s: from the end of its log on, without a look at the date.

        How long the run was without a host is told by the host's uptime; where the host has been
        started anew, by the table's clock, up to one wrap of it; else it counts for nothing, and
        the IMU's counter, which does not agree then, is reported.
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
    """The recorder of one run, new or resumed; a context manager.

    Parameters
    ----------
    folder : RunFolder
    journal : Journal
    layout : PacketLayout
        Of the IMU's packets.

    Attributes
    ----------
    assembly : SampleAssembler
    log_end : LogEnd
        Where the log ended when it was opened.
    live_estimator : LiveEstimator or None
        The estimate, where the run file's method has a sequential estimator.
    navigation : NavigationSolution or None
        Attitude and velocity by an IMU's corrected readings alone, once all of its coefficients
        are estimated.
    temperature : float
        Of the IMU, K; NaN where it tells none.
    events : int
        How many there were.
    said : deque of (str, str)
        Level and words of the last of them.
    blocks : deque of SampleBlock
        The last samples; who shows them takes them out.

    Raises
    ------
    InputError
        A log that is damaged, packets that do not go with the run file.
    """

    def __init__(self, folder: RunFolder, journal: Journal, layout: PacketLayout):
        run = folder.run
        self.assembly = SampleAssembler(run, layout, journal.header().poll)
        # Packets hold no temperature of each sample: coefficients of it are found afterwards.
        self._estimates = run.method.sequential is not None and not run.sensor.uses("dT")
        self.live_estimator = LiveEstimator(run) if self._estimates else None
        # Without readback there is no attitude of the table to begin from and to compare with.
        has_attitude = run.motion_control.has_attitude
        navigates = is_whole_imu(run.sensor) and has_attitude and require_turntable(run).readback
        self._new_navigator = lambda: (
            Navigator(run.sensor, require_turntable(run)) if navigates else None
        )
        self._navigator = self._new_navigator()
        self.navigation: NavigationSolution | None = None
        self.temperature = nan
        self.events = 0
        self.recent_messages: deque[tuple[str, str]] = deque(maxlen=_RECENT_COUNT)
        self.blocks: deque[SampleBlock] = deque(maxlen=_RECENT_COUNT)
        self._journal = journal
        # Sections that the journal has yet to be told of, with the run's time of each.
        self._waiting_sections: deque[tuple[float, SectionEvent]] = deque()
        self._last_processing = -inf, -inf
        self._losses, self._last_loss_warning = (0, 0, 0, 0), 0.0
        with ExitStack() as opened:
            self._log = opened.enter_context(RunLog(folder.log))
            self.log_end = self._replay(folder)
            self._open_resources = opened.pop_all()

    @property
    def estimation(self) -> Literal["none", "waits", "on", "ended"]:
        """How live estimation stands: "none" where the run file's method has none."""
        if self.live_estimator is None:
            return "ended" if self._estimates else "none"
        return "on" if self.live_estimator.has_estimate else "waits"

    def record_frame(self, kind: int, time: float, payload: bytes) -> None:
        """Record what arrived from a device, at a time of the run."""
        self._log.append(kind, time, payload)
        self.assembly.feed(LogFrame(kind, time, payload))
        if kind == IMU:
            self._record_waiting_sections(time - _IMU_LATENCY)

    def record_session(
        self, time: float, following: int, wraps: float, uptime: HostUptime | None = None
    ) -> None:
        """Record that the stream was interrupted: the next sample does not continue the previous.

        Parameters
        ----------
        time : float
            Of the run, s.
        following : int
            The step that is next: those from there on are to be done again.
        wraps : float
            s after which the table's clock begins again.
        uptime : HostUptime, optional
            How long the host was up at `time`, where its clock is that of the run.
        """
        known: dict[str, object] = {"wraps": wraps} if isfinite(wraps) else {}
        if uptime is not None:
            known |= {"boot": uptime.boot, "uptime": uptime.seconds}
        self._event(time, {"what": "session", "next": following, **known})

    def record_section(self, time: float, one: SectionEvent, *, holds: bool) -> None:
        """Record that a section began or ended.

        The log has it at once. The journal has it when the IMU's bytes up to then are in the log: a
        host that is killed before repeats the section, whose last samples are lost.
        """
        content = {"number": one.number, "label": one.section, "state": one.state, "time": one.time}
        self._event(time, {"what": "section", **content, "hold": holds})
        self._waiting_sections.append((time, one))

    def record_interruption(self, time: float, cause: str | None, lasted: float = 0.0) -> None:
        """Record why the table is stopped, for a cause that has lasted for some seconds.

        None: the run continues.
        """
        self._event(time, {"what": "interruption", "cause": cause, "since": time - lasted})

    def record_message(
        self, time: float, level: Literal["info", "warning", "alarm"], words: str
    ) -> None:
        """Record what an operator should know."""
        self.events += 1
        self.recent_messages.append((level, words))
        self._journal.record_event(level, words, time)

    def is_processing_due(self, time: float) -> bool:
        """Return whether `work` is due; when it is done does not change the results.

        A piece has a price of its own: a bench that is sped up has larger ones.
        """
        came, passed = time - self._last_processing[0], monotonic() - self._last_processing[1]
        return came >= _PIECE_MIN and (passed >= _PIECE_WALL or came >= PIECE_MAX)

    def process_pending(self, time: float) -> SampleBlock | None:
        """Assemble what arrived and update the estimate; return the new samples.

        Raises
        ------
        InputError
            A device that set its clock anew.
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
        self.temperature = float(block.temperature[-1])
        if self.live_estimator is None:
            return
        if block.starts_recording:
            self._navigator = self._new_navigator()
        try:
            self.live_estimator.feed(block)
            if self._navigator is not None and np.isfinite(self.live_estimator.values).all():
                self.navigation = self._navigator.feed(block.track, self.live_estimator.values)
        except Exception as error:
            # The recording is what counts: it may be calibrated otherwise. A method may be another
            # package's, and whatever it raises must not end a run whose table moves.
            self.live_estimator = None
            what = "" if isinstance(error, InercalError) else f"{type(error).__name__}: "
            words = f"live estimation ends: {what}{error}"
            # A run that goes on comes to an end that it came to before: then it was said.
            if all(event.words != words for event in self._journal.events()):
                self.record_message(time, "warning", words)

    def _loss_warnings(self, time: float) -> list[str]:
        """Return the messages about losses, each of them once, and again as they increase."""
        tally = self.assembly.tally
        counts, before = tally.bytes, self._losses
        left_out = tally.samples_without_angle + tally.samples_with_unusable_angle
        losses = counts.lost, counts.failed, left_out, tally.implausible_polls
        if losses == before or time - self._last_loss_warning < _LOSS_WARNING_INTERVAL:
            return []
        self._losses, self._last_loss_warning = losses, time
        result: list[str] = []
        if losses[:2] != before[:2]:
            result.append(
                f"so far {counts.lost} packets of {counts.packets + counts.lost} are lost, and "
                f"{counts.failed} had a checksum error"
            )
        if left_out != before[2]:
            result.append(
                f"so far {left_out} samples of {tally.samples + tally.samples_without_angle} have "
                "no usable angle: the table was polled too slowly while it turned, or "
                "was homing"
            )
        if tally.implausible_polls != before[3]:
            result.append(
                f"so far {tally.implausible_polls} readings of {tally.polls} of the table are left "
                "out: they imply motion beyond its limits; a corrupted digit, noise, an "
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
        """Replay the log of an interrupted run; events already reported are not reported again."""
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
        self.assembly.take_received()  # a viewer is shown what comes from now on
        return LogEnd(latest, _read_poll(last.get(TABLE)), _read_session(session))

    def close(self) -> None:
        """Close the log."""
        self._open_resources.close()


def _read_poll(frame: LogFrame | None) -> tuple[float, float] | None:
    """Return the run's time and the controller's of a reading of the table."""
    return frame and (frame.time, float(unpack_states([frame.payload]).time[0]))


def _read_session(frame: LogFrame | None) -> tuple[float, HostUptime] | None:
    """Return the run's time, and how long the host was up, at the begin of a session."""
    event: dict[str, Any] = json.loads(frame.payload) if frame else {}
    if frame is None or "uptime" not in event:
        return None
    return frame.time, HostUptime(str(event["boot"]), float(event["uptime"]))
