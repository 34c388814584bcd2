"""Convert the packets of the IMU to samples, in the order of the IMU's clock."""

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from math import inf, isfinite, nan

import numpy as np

from inercal.basics.arrays import Array, Bools
from inercal.basics.errors import InputError
from inercal.host.assembly.packet_dating import PacketDating, PacketRows
from inercal.host.assembly.poll_record import MATCHING_TIME
from inercal.host.packets import Decoder, Flag, PacketCounts, PacketLayout, Packets
from inercal.host.packets.packet_format import AXES
from inercal.host.run_log import LogFrame
from inercal.physics.sensors import Sensor

_MISMATCH_TIME = 2.0  # s; if packets wait longer for a date, this is reported
_ROUNDING = 1e-6
_MAX_TICK = 2.0**53  # floats represent integers up to this exactly
_MAX_RECENT = 256  # pieces; each tick adds one during the 5 s of relating the clocks
_NO_NUMBER, _BAD_STATUS, _BEYOND_RANGE = 1, 2, 3
_FLAWS = {_NO_NUMBER: "no_number", _BAD_STATUS: "bad_status", _BEYOND_RANGE: "beyond_range"}


@dataclass
class DroppedPackets:
    """Counts of packets that did not become samples, by reason.

    Parameters
    ----------
    repeated, out_of_order : int
        Packets with a counter that was used before, or that is ahead of the following packets.
    undated : int
        Packets with a counter that jumped, or that has wrapped an unknown number of times.
    no_number, bad_status, beyond_range : int
        Packets without a reading, with a bad status, or with a reading beyond the sensor's full
        scale.
    """

    repeated: int = 0
    out_of_order: int = 0
    undated: int = 0
    no_number: int = 0
    bad_status: int = 0
    beyond_range: int = 0


@dataclass
class ReceivedSamples:
    """Receives the IMU's bytes and converts them to samples.

    Parameters
    ----------
    sensor : Sensor
        Sensor whose axes the packets contain, in SI.
    layout : PacketLayout
    rate_hz : float
        Samples per second by the device's clock.

    Attributes
    ----------
    per_second : float
        Ticks per second.
    offset : float or None
        Host time minus IMU time, s: the smallest difference among the first packets. None before it
        is known.
    temperature : float
        Latest temperature in a good packet, K; NaN before.
    drops : DroppedPackets
    waiting : list of PacketRows
        Samples in order that nobody has taken yet.
    recent : deque of PacketRows
        The latest samples for a viewer, who removes them.

    Raises
    ------
    InputError
        The layout has neither counter nor time, its rate is different, or an axis of the sensor is
        missing.
    """

    sensor: Sensor
    layout: PacketLayout
    rate_hz: float
    offset: float | None = None
    temperature: float = nan
    drops: DroppedPackets = field(default_factory=DroppedPackets)
    waiting: list[PacketRows] = field(default_factory=list[PacketRows])
    recent: deque[PacketRows] = field(default_factory=lambda: deque(maxlen=_MAX_RECENT))

    def __post_init__(self) -> None:
        layout, rate = self.layout, self.rate_hz
        roles = {one.role for one in layout.frames[0].fields}
        if layout.rate_hz is not None and abs(layout.rate_hz / rate - 1) > _ROUNDING:
            raise InputError(
                f"the packets of {layout.name!r} come at {layout.rate_hz:g} Hz, but [data] rate "
                f"is {rate:g} Hz; correct [data] rate",
                key="[data] rate",
                names=(layout.name,),
            )
        if layout.sequence == "counter":
            self.per_second = rate * (layout.step or 1.0)
            turn, step = float(layout.wraps.get("counter", 0)) or inf, layout.step or 1.0
        elif "time" in roles:
            self.per_second = 1.0
            turn, step = (layout.wraps.get("time", 0) * layout.time.size) or inf, 1 / rate
        else:
            raise InputError(
                f"the packets of {layout.name!r} have neither counter nor time, so lost packets "
                "cannot be detected; let the IMU send one of the two",
                names=(layout.name,),
            )
        missing = [name for name in self._roles if name not in roles]
        if missing:
            raise InputError(
                f"the packets of {layout.name!r} have no {', '.join(missing)}, which [sensor] "
                "needs; let the IMU send them or choose another preset",
                names=tuple(missing),
            )
        self._columns = [AXES.index(name) for name in self._roles]
        ends = [one.readout.full_scale for one in self.sensor.axes]
        self._ends = np.array([inf if end is None else end * (1 + _ROUNDING) for end in ends])
        self._zeros = np.array([one.readout.offset for one in self.sensor.axes])
        self._decoder = Decoder(layout, mid_stream=True, time_zero=None)
        self._before = PacketCounts()
        self._pending_rows: PacketRows | None = None
        self._last = -inf
        self._first_arrival, self._least_difference, self._last_tick = -inf, inf, 0.0
        self._dating = PacketDating(self.per_second, turn, step)

    @property
    def _roles(self) -> list[str]:
        """The names that the sensor's axes have in the packets, ax to gz."""
        kinds = {"f": iter("xyz"), "w": iter("xyz")}
        return [
            ("a" if one.measures == "f" else "g") + next(kinds[one.measures])
            for one in self.sensor.axes
        ]

    @property
    def counts(self) -> PacketCounts:
        """Counts of the packets in all sessions, by outcome."""
        return self._before + self._decoder.counts

    @property
    def provisional_offset(self) -> float | None:
        """The offset or, before it is final, the smallest difference so far; None if unknown."""
        if self.offset is not None:
            return self.offset
        return self._least_difference if isfinite(self._least_difference) else None

    @property
    def waits_for_dates(self) -> bool:
        """Whether packets have arrived that cannot be dated, or cannot be dated yet."""
        return self._dating.doubt_since is not None

    @property
    def mismatch(self) -> str | None:
        """Reason why arriving packets cannot be dated, as text; None while they can be dated."""
        dating = self._dating
        if dating.waiting_time < _MISMATCH_TIME:
            return None
        if not dating.counts_turns:
            return (
                f"the IMU's counter starts again every {dating.turn_seconds:.3g} s, and the IMU "
                "was silent for too long to count how often it did"
            )
        return (
            f"the IMU's counter is {abs(dating.behind):.3g} s off: the IMU was restarted, or its "
            "counter has jumped"
        )

    def begin_session(self) -> None:
        """Restart decoding, because it is unknown what was sent between the sessions."""
        self._before = self.counts
        zero = self._decoder.time_zero
        self._decoder = Decoder(self.layout, mid_stream=True, time_zero=zero)
        if self.offset is None:
            self._restart_matching()
            return
        if self._pending_rows is not None and self._pending_rows.ticks[0] > self._last:
            self._keep(self._pending_rows)
        self._pending_rows = None
        self._dating.begin_session()

    def feed(self, frames: Sequence[LogFrame]) -> None:
        """Process the frames that arrived in one session; an empty frame begins another session."""
        together: list[LogFrame] = []
        for frame in frames:
            if not frame.payload:
                self._feed_together(together)
                together.clear()
                self.begin_session()
                continue
            if self.offset is None or self._dating.needs_arrival(frame.time):
                self._feed_together(together)
                together.clear()
                self._feed_arrival(frame)
            else:
                together.append(frame)
            self._dating.hear(frame.time)
        self._feed_together(together)

    def _feed_together(self, frames: Sequence[LogFrame]) -> None:
        """Process frames together, or one at a time if a counter does not continue."""
        if not frames:
            return
        before = self._decoder.copy()
        rows = self._rows(self._decoder.feed(b"".join(frame.payload for frame in frames)))
        if self.offset is not None and self._dating.follows_dated(rows.ticks):
            if rows.ticks.size:
                self._take(self._dating.date_next(rows))
            return
        self._decoder = before
        for frame in frames:
            self._feed_arrival(frame)

    def _feed_arrival(self, frame: LogFrame) -> None:
        """Process a frame whose arrival time matters."""
        if self.offset is not None:
            self._dating.begin_arrival(frame.time)
        rows = self._rows(self._decoder.feed(frame.payload))
        if not rows.ticks.size:
            return
        if self.offset is None:
            self._take(self._match(frame.time, rows))
            return
        for dated in self._dating.date(rows, frame.time):
            self._take(dated)
        self.drops.undated = self._dating.dropped

    def _match(self, arrival: float, rows: PacketRows) -> PacketRows:
        """Search for the smallest clock difference during a period without a gap or an outage.

        Returns the packets that arrived in this period.
        """
        *before, rows = self._dating.split(rows)
        if self._first_arrival != -inf and (
            before
            or self._dating.follows_outage(arrival)
            or self._dating.has_gap(rows.ticks, self._last_tick)
        ):
            self._restart_matching()
        if self._first_arrival == -inf:
            self._first_arrival = arrival
        newest = self._last_tick = float(rows.ticks[-1])
        if arrival < self._first_arrival + MATCHING_TIME:
            difference = arrival - newest / self.per_second
            self._least_difference = min(self._least_difference, difference)
        else:
            self.offset = self._least_difference
            self._dating.begin(arrival, self.offset, newest)
        return rows

    def _restart_matching(self) -> None:
        """Restart the search for the smallest clock difference; earlier packets get no date."""
        self._pending_rows, self._last = None, -inf
        self._least_difference, self._first_arrival = inf, -inf
        self.waiting.clear()
        self.recent.clear()

    def _rows(self, packets: Packets) -> PacketRows:
        """Return packets with their flaws, without packets that repeat a counter value."""
        output = self.sensor.to_output(packets.readings[:, self._columns])
        with np.errstate(invalid="ignore"):
            flaw = np.where(
                (np.abs(output - self._zeros) <= self._ends).all(axis=-1), 0, _BEYOND_RANGE
            )
        flaw[packets.flags & Flag.STATUS != 0] = _BAD_STATUS
        flaw[~np.isfinite(output).all(axis=-1)] = _NO_NUMBER
        if self.layout.sequence == "counter" and packets.counter is not None:
            ticks = packets.counter.astype(np.float64)
        else:
            ticks = np.zeros(len(packets)) if packets.time is None else packets.time
        rows = PacketRows(ticks, output, packets.temperature, flaw)
        known = np.abs(ticks) < _MAX_TICK  # a real-valued clock may be NaN or too large
        return rows if known.all() else rows.where(known)

    def _take(self, rows: PacketRows) -> None:
        """Store good packets in order; the last packet waits for the next packet."""
        if self._pending_rows is not None:
            rows = self._pending_rows.join(rows)
        self._pending_rows = rows.where(slice(-1, None))
        self._keep(rows.where(self._in_order(rows.ticks)))

    def _keep(self, rows: PacketRows) -> None:
        """Count packets with flaws, and queue the others as samples."""
        if not rows.ticks.size:
            return
        self._last = float(rows.ticks[-1])
        if rows.flaw.any():
            for flaw, name in _FLAWS.items():
                count = getattr(self.drops, name) + int(np.sum(rows.flaw == flaw))
                setattr(self.drops, name, count)
            rows = rows.where(rows.flaw == 0)
        if rows.ticks.size:
            known = rows.temperature[np.isfinite(rows.temperature)]
            self.temperature = float(known[-1]) if known.size else self.temperature
            self.waiting.append(rows)
            self.recent.append(rows)

    def _in_order(self, ticks: Array) -> "Bools | slice":
        """Return which packets are later than all earlier packets; the last packet is not judged.

        The counter of a packet is false if it is ahead of the next packet, although the next packet
        is later than all earlier packets.
        """
        if ticks[0] > self._last and (ticks[1:] > ticks[:-1]).all():
            return slice(0, -1)
        kept = np.zeros(ticks.size, np.bool_)
        last = self._last
        for k, (one, after) in enumerate(pairwise(ticks.tolist())):
            if one <= last:
                name = "repeated" if one == last else "out_of_order"
            elif last < after < one:
                name = "out_of_order"
            else:
                kept[k], last = True, one
                continue
            setattr(self.drops, name, getattr(self.drops, name) + 1)
        return kept
