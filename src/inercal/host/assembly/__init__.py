"""Converts the frames of the log to IMU samples, with the table's angles at the same times.

The IMU's time comes from its own counter, and the table's time comes from its controller. Both are
related to the host's clock by the smallest difference from the arrival times in the first seconds.
The remaining difference is the latency of the bench. Later, arrival times only show how often a
counter has wrapped (`packet_dating`).

The same frames always give exactly the same samples, however often `take` is called.

Events are JSON objects, and `what` states their kind. "session" means that a host started: `next`
is the first step to carry out (or repeat), and `wraps` is the time in s after which the table's
clock wraps around (null or missing if it never does). "section" states `number`, `label`, `state`
("begun", "done" or "void"), `time` by the table's clock, and whether the section is a `hold`.
"interruption" states `cause`, a text that says why the table was stopped (null if the run
continues), and `since`, the run time in s when this began. Other events are ignored.
"""

import json
from itertools import groupby
from typing import Any, NamedTuple

import numpy as np

from inercal.basics.arrays import Array, Indices
from inercal.basics.errors import InputError
from inercal.benches.turntable import require_turntable
from inercal.host.assembly import section_timeline
from inercal.host.assembly.imu_samples import ReceivedSamples
from inercal.host.assembly.packet_dating import PacketRows
from inercal.host.assembly.table_polls import POLL_INTERVAL, RatePolls, TablePolls
from inercal.host.packets import PacketLayout
from inercal.host.run_log import EVENT, IMU, TABLE, LogFrame
from inercal.host.tasks import host_plan, required_rate
from inercal.recordings import AngleQuality, Track
from inercal.recordings.data.recording_loader import readback_units
from inercal.runfile import Run

_MAX_HOLD_GAP = 0.5  # s; a hold ends after this time without a sample


class SampleBlock(NamedTuple):
    """A block of samples, with all values that a recording contains.

    Parameters
    ----------
    time : (n,) array
        Time since the first sample of the recording, by the IMU's clock, s.
    output : (n, m) array
        Readings in the output units of the sensor's axes.
    reading : (n, m) array
        The same readings in SI.
    angle_output : (n, k) array
        The readback in the units of its columns: angles, or rates of a rate table. There are no
        columns if the table's angles are not recorded.
    angles : (n, k) array
        The readback in rad or rad/s. If it is not recorded, these are the values from the driver.
    hold : (n,) array of int
        Number of the hold to which each sample belongs; −1 outside holds.
    temperature : (n,) array
        Temperature in K; NaN if unknown.
    table : (n,) array
        Time by the table's clock, s.
    quality : AngleQuality
        Quality of the angles; the standard deviation is in rad.
    starts_recording : bool
        Whether the recording begins with this block. If so, earlier samples are void.
    """

    time: Array
    output: Array
    reading: Array
    angle_output: Array
    angles: Array
    hold: Indices
    temperature: Array
    table: Array
    quality: AngleQuality
    starts_recording: bool

    @property
    def estimator_track(self) -> Track:
        """The samples as a track for an estimator; it has no angles if they are not recorded."""
        if self.angle_output.shape[-1]:
            return self.track
        return Track(self.time, self.reading, self.angle_output, self.hold)

    @property
    def track(self) -> Track:
        """The samples as a track, with the angles that the driver reports."""
        return Track(self.time, self.reading, self.angles, self.hold, angle_quality=self.quality)


class SampleAssembler:
    """Converts the frames of a run to samples.

    Parameters
    ----------
    run : Run
        A run on a bench that a host can drive.
    layout : PacketLayout
        Layout of the IMU's packets.
    poll : float
        Time between two polls of the table, s.
    imu_kind : int
        Kind of the frames with the IMU's bytes; frames from other IMUs are ignored.

    Attributes
    ----------
    sensor : Sensor
    imu : ReceivedSamples
        The packets of the IMU.
    table : TablePolls or RatePolls
        The polls of the table.
    sections : SectionTimeline
        The sections so far, by the table's clock.
    interruptions : InterruptionList
        The interruptions so far.
    samples : int
        Number of samples in the recording.
    samples_without_angle : int
        Number of packets that were left out because the table's angles are unknown.
    samples_with_unusable_angle : int
        Number of samples whose angle has an infinite uncertainty; they are among `samples`.

    Raises
    ------
    InputError
        No host can drive the bench, the rate is missing, the packets contain neither counter nor
        time, their rate is different, or an axis of the sensor is missing in them.
    """

    def __init__(
        self, run: Run, layout: PacketLayout, poll: float = POLL_INTERVAL, imu_kind: int = IMU
    ):
        control, bench = run.motion_control, host_plan(run).bench
        self.sensor = run.sensor
        self.imu = ReceivedSamples(run.sensor, layout, required_rate(run))
        self.table = (
            TablePolls(poll, require_turntable(run)) if control.has_attitude else RatePolls(bench)
        )
        self._settling = control.settling(bench)
        self.sections = section_timeline.SectionTimeline(self._settling)
        # Size in SI of the unit of each axis' column in the recording; a negative size reverses the
        # sign.
        sizes = readback_units(run)
        names = [name for name in control.readback(bench) if name in sizes]
        self._units = np.array([sizes[name] for name in names])
        self._records_angles = bool(names)
        self._imu_kind = imu_kind
        self._pending: list[LogFrame] = []
        self._attempt: int = 0
        self.interruptions = section_timeline.InterruptionList()
        self._start_recording()

    @property
    def offset(self) -> float | None:
        """The IMU's clock minus the table's clock, from arrival times, s; None while unknown."""
        if self.imu.offset is None or self.table.offset is None:
            return None
        return self.table.offset - self.imu.offset

    @property
    def is_recording(self) -> bool:
        """Whether samples are produced: the clocks are related, and the recording has begun."""
        return self.offset is not None and self.sections.start < np.inf

    @property
    def recording_start(self) -> float | None:
        """Run time of the first sample in the recording, s; None before this sample."""
        if self._first_tick is None or self.imu.offset is None:
            return None
        return self._first_tick / self.imu.per_second + self.imu.offset

    def take_received(self) -> tuple[Array, Array] | None:
        """Return the readings that arrived since the last call, even if angles are unknown.

        Returns
        -------
        time : (n,) array
            Run time, s. During the first 5 s, while the clocks are being related, this time may be
            too late by the latency of the bytes.
        output : (n, m) array
            Readings in the output units of the sensor's axes.
        """
        recent, offset = self.imu.recent, self.imu.provisional_offset
        if not recent or offset is None:
            return None
        first, *others = recent
        whole = first.join(*others)
        recent.clear()
        return whole.ticks / self.imu.per_second + offset, whole.output

    def feed(self, frame: LogFrame) -> None:
        """Add a frame to the queue, unless it is from another IMU."""
        if frame.kind == self._imu_kind:
            self._pending.append(frame if frame.kind == IMU else frame._replace(kind=IMU))
        elif frame.kind in (TABLE, EVENT):
            self._pending.append(frame)

    def take(self) -> SampleBlock | None:
        """Return the samples that are complete with the frames so far; None if there are none.

        Raises
        ------
        InputError
            A frame does not belong to this kind of log, or the table has reset its clock.
        """
        pending, self._pending = self._pending, []
        for kind, group in groupby(_sort_frames(pending), key=lambda one: one.kind):
            frames = list(group)
            if kind != EVENT:
                self.interruptions.hear(max(frame.time for frame in frames))
            if kind == IMU:
                self.imu.feed(frames)
            elif kind == TABLE:
                self.table.feed(frames)
            else:
                for frame in frames:
                    self._process_event(frame)
        return self._block()

    def _process_event(self, frame: LogFrame) -> None:
        event = _parse_event(frame)
        self.interruptions.add_event(frame.time, event)
        if event.get("cause") is not None:
            self.table.expect_stop()
        if event.get("what") == "section":
            self.sections.add_event(event, self.table.wrap_offset)
        elif event.get("what") == "session":
            self.sections.begin_session(int(event.get("next", 0)), self.table.last)
            self.imu.begin_session()
            wraps = event.get("wraps")
            self.table.begin_session(np.inf if wraps is None else float(wraps))

    def _start_recording(self) -> None:
        """Begin a new recording."""
        self._first_tick: float | None = None  # tick
        self.samples = self.samples_without_angle = self.samples_with_unusable_angle = 0
        self._holds = 0
        self._last_hold_sample = (-1, -np.inf)  # section and time of the last hold sample

    def _block(self) -> SampleBlock | None:
        offset, imu = self.offset, self.imu
        if offset is None:
            return None
        if self.sections.attempt != self._attempt:
            self._attempt = self.sections.attempt
            self._start_recording()
        samples = self._ready_samples(self.table.complete_until - self._settling, offset)
        if samples is None:
            return None
        table = samples.ticks / imu.per_second - offset
        late = table >= self.sections.start
        angles, quality, there = self.table.readback(table)
        self.table.discard_old(float(table[-1]))
        if not self._records_angles:  # samples are valid even if the table was not polled
            angles[~there], there = np.nan, np.ones_like(there)
        self.samples_without_angle += int(np.sum(late & ~there))
        kept = late & there
        if not kept.any():
            return None
        if not kept.all():
            samples, table, angles = samples.where(kept), table[kept], angles[kept]
            quality = quality.where(kept)
        begins = self._first_tick is None
        if self._first_tick is None:
            self._first_tick = float(samples.ticks[0])
        self.samples += table.size
        if self._records_angles:
            self.samples_with_unusable_angle += int(np.sum(np.isinf(quality.interpolation_sd)))
        said = angles / self._units if self._records_angles else np.zeros((table.size, 0))
        time = (samples.ticks - self._first_tick) / imu.per_second
        return SampleBlock(
            time,
            samples.output,
            self.sensor.to_si(samples.output),
            said,
            said * self._units if self._records_angles else angles,
            self._hold_numbers(table, time),
            samples.temperature,
            table,
            quality,
            begins,
        )

    def _ready_samples(self, until: float, offset: float) -> PacketRows | None:
        """Return the samples before a table time, and keep the later samples."""
        waiting, imu = self.imu.waiting, self.imu
        if not waiting:
            return None
        first, *others = waiting
        whole = first.join(*others)
        n = int(np.searchsorted(whole.ticks / imu.per_second - offset, until))
        imu.waiting = [whole.where(slice(n, None))] if n < whole.ticks.size else []
        return whole.where(slice(0, n)) if n else None

    def _hold_numbers(self, table: Array, time: Array) -> Indices:
        """Return the number of the hold to which each sample belongs."""
        section = self.sections.hold_indices(table)
        held = np.flatnonzero(section >= 0)
        number = np.full(table.size, -1, np.int64)
        if held.size:
            which, when = section[held], time[held]
            before = np.concatenate([[self._last_hold_sample[0]], which[:-1]])
            apart = when - np.concatenate([[self._last_hold_sample[1]], when[:-1]])
            number[held] = self._holds - 1 + np.cumsum((which != before) | (apart > _MAX_HOLD_GAP))
            self._holds = int(number[held[-1]]) + 1
            self._last_hold_sample = int(which[-1]), float(when[-1])
        return number


def _sort_frames(frames: list[LogFrame]) -> list[LogFrame]:
    """Group frames by kind between events, to process all frames of a kind together."""
    result: list[LogFrame] = []
    for _, group in groupby(frames, key=lambda one: one.kind == EVENT):
        result += sorted(group, key=lambda one: one.kind)
    return result


def _parse_event(frame: LogFrame) -> dict[str, Any]:
    try:
        event: Any = json.loads(frame.payload)
        return dict(event)
    except (TypeError, ValueError):
        raise InputError(
            f"the log has an event at {frame.time:.6g} s that is not a JSON object: "
            f"{frame.payload!r}; the log is damaged or of another version: restore it, or use the "
            "program that wrote it",
            key="event",
        ) from None
