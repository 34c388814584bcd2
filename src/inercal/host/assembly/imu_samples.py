"""The IMU's packets, in the order of its own clock."""

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field, fields
from itertools import pairwise
from math import inf, isfinite
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from inercal.arrays import Array
from inercal.errors import InputError
from inercal.host.assembly.clock_matching import MATCHING_TIME, wrap_correction
from inercal.host.packets import Decoder, Flag, PacketCounts, PacketLayout, Packets
from inercal.host.packets.packet_format import AXES
from inercal.host.run_log import LogFrame
from inercal.sensors import Sensor

_WRAP_SHARE, _MAX_SILENCE = (
    0.25,
    1.0,
)  # of a turn of the counter, s: beyond that arrival tells turns
_ROUNDING = 1e-6
_MAX_RECENT = 256  # pieces: those of the 5 s in which the clocks are matched come one a tick
_NO_NUMBER, _BAD_STATUS, _BEYOND_RANGE = 1, 2, 3
_FLAWS = {_NO_NUMBER: "no_number", _BAD_STATUS: "bad_status", _BEYOND_RANGE: "beyond_range"}


class PacketSamples(NamedTuple):
    """Good packets, later ones behind."""

    ticks: Array  # (n,), the counter or clock of the device, counted on; whole numbers are exact
    output: Array  # (n, m), in output units of the sensor's axes
    temperature: Array  # (n,) K, NaN where there is none

    def where(self, rows: "NDArray[np.bool_] | slice") -> "PacketSamples":
        """Return some of them."""
        return self._make(column[rows] for column in self)


class _PacketRows(NamedTuple):
    """Packets, with what is wrong with each; 0 is nothing."""

    ticks: Array
    output: Array
    temperature: Array
    flaw: NDArray[np.int64]

    def where(self, rows: "NDArray[np.bool_] | slice") -> "_PacketRows":
        return self._make(column[rows] for column in self)

    def join(self, other: "_PacketRows") -> "_PacketRows":
        return self._make(map(np.concatenate, zip(self, other, strict=True)))


@dataclass
class DroppedPackets:
    """Packets that are no samples, by kind.

    Parameters
    ----------
    repeated, out_of_order : int
        Of a counter that came before, or that is ahead of those behind it.
    no_number, bad_status, beyond_range : int
        No reading; the device says that it is not good; beyond the full scale of the sensor.
    """

    repeated: int = 0
    out_of_order: int = 0
    no_number: int = 0
    bad_status: int = 0
    beyond_range: int = 0


@dataclass
class ReceivedSamples:
    """What the IMU sent.

    Parameters
    ----------
    sensor : Sensor
        Its axes are those of the packets, in SI.
    layout : PacketLayout
    rate_hz : float
        Samples per second of the device's clock.

    Attributes
    ----------
    per_second : float
        Ticks.
    offset : float or None
        The host's time minus the IMU's, s, the least of the first packets; None before.
    drops : DroppedPackets
    waiting : list of PacketSamples
        In order, to be taken.
    recent : deque of PacketSamples
        The last of the same, for a viewer, which takes them out.

    Raises
    ------
    InputError
        A layout without counter and time, of another rate, or without an axis of the sensor.
    """

    sensor: Sensor
    layout: PacketLayout
    rate_hz: float
    offset: float | None = None
    drops: DroppedPackets = field(default_factory=DroppedPackets)
    waiting: list[PacketSamples] = field(default_factory=list[PacketSamples])
    recent: deque[PacketSamples] = field(default_factory=lambda: deque(maxlen=_MAX_RECENT))

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
            self._wraps = float(layout.wraps.get("counter", 0)) or inf
        elif "time" in roles:
            self.per_second = 1.0
            self._wraps = (layout.wraps.get("time", 0) * layout.time.size) or inf
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
        self._pending_rows: _PacketRows | None = None
        self._last = -inf
        self._first_arrival, self._least_difference = -inf, inf
        self._last_arrival, self._wrap_offset, self._must_match = 0.0, 0.0, False

    @property
    def _roles(self) -> list[str]:
        """The packets' names of the sensor's axes: ax … gz."""
        kinds = {"f": iter("xyz"), "w": iter("xyz")}
        return [
            ("a" if one.measures == "f" else "g") + next(kinds[one.measures])
            for one in self.sensor.axes
        ]

    @property
    def counts(self) -> PacketCounts:
        """What became of the bytes of all sessions."""
        now = self._decoder.counts
        both = ((one.name, getattr(self._before, one.name)) for one in fields(PacketCounts))
        return PacketCounts(**{name: before + getattr(now, name) for name, before in both})

    @property
    def provisional_offset(self) -> float | None:
        """The offset, or the least difference so far while the clocks are matched; None before."""
        if self.offset is not None:
            return self.offset
        return self._least_difference if isfinite(self._least_difference) else None

    def begin_session(self) -> None:
        """Begin to decode anew: of what came in between nothing is known."""
        self._before = self.counts
        zero = self._decoder.time_zero
        self._decoder = Decoder(self.layout, mid_stream=True, time_zero=zero)
        if self.offset is None:
            self._pending_rows, self._last, self._least_difference, self._first_arrival = (
                None,
                -inf,
                inf,
                -inf,
            )
            self.waiting.clear()
            self.recent.clear()
            return
        if self._pending_rows is not None and self._pending_rows.ticks[0] > self._last:
            self._keep(self._pending_rows)
        self._pending_rows, self._must_match = None, True

    def feed(self, frames: Sequence[LogFrame]) -> None:
        """Take in what came in one session.

        Raises
        ------
        InputError
            A counter that began anew.
        """
        silence = min(_WRAP_SHARE * self._wraps / self.per_second, _MAX_SILENCE)
        together: list[bytes] = []
        for frame in frames:
            if not frame.payload:
                continue
            if self.offset is not None and frame.time - self._last_arrival > silence:
                self._must_match = True
            if self.offset is None or self._must_match:
                if together:
                    self._take(self._decoder.feed(b"".join(together)))
                    together.clear()
                self._feed_and_match(frame)
            else:
                together.append(frame.payload)
            if not self._must_match:
                self._last_arrival = frame.time
        if together:
            self._take(self._decoder.feed(b"".join(together)))

    def _feed_and_match(self, frame: LogFrame) -> None:
        """Take in a frame whose time of arrival matters."""
        packets = self._decoder.feed(frame.payload)
        if not len(packets):
            return
        newest = float(self._ticks(packets)[-1]) / self.per_second
        if self.offset is None:
            if self._first_arrival == -inf:
                self._first_arrival = frame.time
            if frame.time < self._first_arrival + MATCHING_TIME:
                self._least_difference = min(self._least_difference, frame.time - newest)
            else:
                self.offset = self._least_difference
        elif self._must_match:
            behind = frame.time - self.offset - newest
            outage = frame.time - self._last_arrival
            added = wrap_correction(behind, self._wraps / self.per_second, outage, "the IMU")
            self._wrap_offset += added * self.per_second
            self._must_match = False
        self._take(packets)

    def _ticks(self, packets: Packets) -> Array:
        if self.layout.sequence == "counter" and packets.counter is not None:
            return packets.counter.astype(np.float64) + self._wrap_offset
        return np.zeros(len(packets)) if packets.time is None else packets.time + self._wrap_offset

    def _take(self, packets: Packets) -> None:
        """Keep what is in order and good; the last packet waits for the one behind it."""
        if not len(packets):
            return
        output = self.sensor.to_output(packets.readings[:, self._columns])
        with np.errstate(invalid="ignore"):
            flaw = np.where(
                (np.abs(output - self._zeros) <= self._ends).all(axis=-1), 0, _BEYOND_RANGE
            )
        flaw[packets.flags & Flag.STATUS != 0] = _BAD_STATUS
        flaw[~np.isfinite(output).all(axis=-1)] = _NO_NUMBER
        rows = _PacketRows(self._ticks(packets), output, packets.temperature, flaw)
        if self._pending_rows is not None:
            rows = self._pending_rows.join(rows)
        self._pending_rows = rows.where(slice(-1, None))
        self._keep(rows.where(self._in_order(rows.ticks)))

    def _keep(self, rows: _PacketRows) -> None:
        """Count flaws, and let samples without one wait."""
        if not rows.ticks.size:
            return
        self._last = float(rows.ticks[-1])
        if rows.flaw.any():
            for flaw, name in _FLAWS.items():
                count = getattr(self.drops, name) + int(np.sum(rows.flaw == flaw))
                setattr(self.drops, name, count)
            rows = rows.where(rows.flaw == 0)
        if rows.ticks.size:
            good = PacketSamples(rows.ticks, rows.output, rows.temperature)
            self.waiting.append(good)
            self.recent.append(good)

    def _in_order(self, ticks: Array) -> "NDArray[np.bool_] | slice":
        """Return which are later than all before, the last one aside.

        One that is ahead of the next, which is later than all before it, has a false counter.
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
