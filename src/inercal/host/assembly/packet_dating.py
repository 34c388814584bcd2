"""Dates packets by their counter; arrival times only show how often the counter wrapped.

Two bounds enclose the time of a packet. It is later than the previous packet, which gives the
smallest possible number of counter turns, and it was sent before it arrived. An arrival time is not
sufficient to date a packet, because a host that was suspended reads packets long after they were
sent.

Packets whose counter continues are dated at once. After a gap in the counter, a time without
arrivals or a new session, packets wait in gap-free parts. They are dated in two cases:

1. With the smallest numbers of turns, the newest packet is as recent as a packet that has just
   arrived. These numbers are then correct for every part, because their sum allows no others.
2. Other numbers of turns fit, and packets have arrived as fast as they are sent for 0.5 s, so there
   is no backlog. Only these recent packets are then dated, because the number of turns before them
   is unknown.

If neither case occurs, the counter was reset or has jumped. A part is dropped if the packets before
it continue after it, because the counter then jumped and came back.
"""

from collections import deque
from dataclasses import dataclass, field
from itertools import pairwise
from math import ceil, floor, inf, isfinite
from typing import NamedTuple

import numpy as np

from inercal.basics.arrays import Array, Bools, Indices

_MAX_OUTAGE = 1.0  # s between arrivals; after a longer time, the number of lost packets is unknown
_TURN_SHARE = 0.25  # fraction of a counter turn; a larger step may include any number of turns
_GAP, _GAP_PACKETS = 0.1, 5.0  # s and packets; up to the larger, a step counts as continuous
_ARRIVAL_UNCERTAINTY, _DRIFT = 0.1, 2e-4  # s, and drift relative to the time since a comparison
_SOUNDINGS = 10  # number of clock comparisons, one per second, of which the smallest is used
_NO_BACKLOG_TIME = 0.5  # s during which packets must arrive as fast as they are sent
_MAX_WAIT = 60.0  # s of arrivals for which undated packets are kept


class PacketRows(NamedTuple):
    """Packets, each with a flag for its flaw; 0 means that it has no flaw."""

    ticks: Array  # (n,), counter or clock of the device; integers are exact
    output: Array  # (n, m), in output units of the sensor's axes
    temperature: Array  # (n,) K; NaN if unknown
    flaw: Indices  # (n,)

    def where(self, rows: "Bools | slice") -> "PacketRows":
        """Return a selection of the packets."""
        return self._make(column[rows] for column in self)

    def join(self, *others: "PacketRows") -> "PacketRows":
        """Return these packets followed by the others."""
        return self._make(map(np.concatenate, zip(self, *others, strict=True)))

    def later_by(self, ticks: float) -> "PacketRows":
        """Return the packets with their times increased by `ticks`."""
        return self._replace(ticks=self.ticks + ticks) if ticks else self


@dataclass
class _Part:
    """Gap-free packets that wait for a date, and the newest tick of each arrival."""

    pieces: list[PacketRows] = field(default_factory=list[PacketRows])
    arrivals: list[tuple[float, float]] = field(default_factory=list[tuple[float, float]])

    def add(self, rows: PacketRows, arrival: float) -> None:
        self.pieces.append(rows)
        self.arrivals.append((arrival, self.last))

    @property
    def first(self) -> float:
        return float(self.pieces[0].ticks[0])

    @property
    def last(self) -> float:
        return float(self.pieces[-1].ticks[-1])

    @property
    def size(self) -> int:
        return sum(one.ticks.size for one in self.pieces)


class PacketDating:
    """Dates the packets of one device.

    Parameters
    ----------
    per_second : float
        Ticks per second.
    turn : float
        Ticks after which the counter wraps around to 0; infinite if it never does.
    step : float
        Ticks from one packet to the next.

    Attributes
    ----------
    dropped : int
        Packets that could not be dated.
    doubt_since : float or None
        Arrival time of the first packet that waits for a date, s; None if no packet waits.
    behind : float
        Time from the newest waiting packet to its arrival, s.
    """

    def __init__(self, per_second: float, turn: float, step: float):
        self._per_second, self._turn = per_second, turn
        share = _TURN_SHARE * turn
        self._gap = min(max(_GAP * per_second, _GAP_PACKETS * step), share)
        self._outage = min(_MAX_OUTAGE, share / per_second)
        self._comparisons: deque[tuple[float, float]] = deque(maxlen=_SOUNDINGS)
        self._last, self._last_arrival = -inf, -inf
        self._turns = 0.0  # ticks added to the counter for its turns
        self._parts: list[_Part] = []
        self._doubts = self._after_outage = self._begins_part = False
        self.dropped, self.behind = 0, 0.0
        self.doubt_since: float | None = None

    @property
    def turn_seconds(self) -> float:
        """Time after which the counter wraps, s."""
        return self._turn / self._per_second

    @property
    def counts_turns(self) -> bool:
        """Whether the arrival time of a packet shows how often the counter has wrapped."""
        return self.turn_seconds / 2 > self._tolerance(self._last_arrival)

    def begin(self, arrival: float, difference: float, last: float) -> None:
        """Begin to date packets; `difference` is the smallest arrival time minus device time, s."""
        self._comparisons.append((arrival, difference))
        self._last, self._last_arrival = last, arrival

    def begin_session(self) -> None:
        """Begin a session; before this, the counter may have wrapped any number of times."""
        self._drop_parts()
        self._doubts = self._after_outage = True
        self._turns = 0.0

    def follows_outage(self, arrival: float) -> bool:
        """Return whether enough time has passed for any number of packets to be lost."""
        return arrival - self._last_arrival > self._outage

    def begin_arrival(self, arrival: float) -> None:
        """Record that bytes have arrived, even if no packet is complete yet."""
        if self.follows_outage(arrival):
            self._doubts = self._after_outage = self._begins_part = True

    def needs_arrival(self, arrival: float) -> bool:
        """Return whether packets that arrive at this time must be fed one arrival at a time.

        The answer depends only on the arrivals, so packets get the same dates however they are fed.
        """
        return self._doubts or self.follows_outage(arrival) or self._is_sounding(arrival)

    def hear(self, arrival: float) -> None:
        """Record the time of an arrival."""
        self._last_arrival = arrival

    @property
    def waiting_time(self) -> float:
        """Time for which packets have been arriving without a date, s."""
        return 0.0 if self.doubt_since is None else self._last_arrival - self.doubt_since

    def has_gap(self, ticks: Array, last: float) -> bool:
        """Return whether packets do not continue from the tick `last`, or contain a gap."""
        return bool((np.abs(np.diff(ticks, prepend=last)) > self._gap).any())

    def split(self, rows: PacketRows) -> list[PacketRows]:
        """Split packets at gaps, and return the gap-free pieces."""
        gaps = np.flatnonzero(np.abs(np.diff(rows.ticks)) > self._gap) + 1
        bounds = [0, *gaps.tolist(), rows.ticks.size]
        return [rows.where(slice(*ends)) for ends in pairwise(bounds)]

    def follows_dated(self, ticks: Array) -> bool:
        """Return whether packets continue the last dated packet and contain no gap."""
        return not (self._doubts or self.has_gap(ticks, self._last - self._turns))

    def date_next(self, rows: PacketRows) -> PacketRows:
        """Date packets that continue the dated packets, and return them."""
        dated = rows.later_by(self._turns)
        self._last = float(dated.ticks[-1])
        return dated

    def date(self, rows: PacketRows, arrival: float) -> list[PacketRows]:
        """Return the packets that can be dated after this group of arrivals.

        Parameters
        ----------
        rows : PacketRows
            One or more packets from a single arrival.
        arrival : float
            Arrival time by the host's clock, s.
        """
        dated: list[PacketRows] = []
        for piece in self.split(rows):
            dated += self._place(piece, arrival)
        if self._doubts:
            self.doubt_since = arrival if self.doubt_since is None else self.doubt_since
            dated += self._resolve(arrival)
        elif self._is_sounding(arrival):
            self._comparisons.append((arrival, arrival - self._last / self._per_second))
        return dated

    def _is_sounding(self, arrival: float) -> bool:
        return floor(arrival) > self._last_arrival

    def _tolerance(self, arrival: float) -> float:
        """Return the possible error of a packet's arrival time if there is no backlog, s."""
        return _ARRIVAL_UNCERTAINTY + _DRIFT * abs(arrival - self._comparisons[-1][0])

    def _is_continued(self, last: float, rows: PacketRows) -> bool:
        return abs(float(rows.ticks[0]) - last) <= self._gap

    def _place(self, rows: PacketRows, arrival: float) -> list[PacketRows]:
        """Add gap-free packets to a part, or date them if they continue the dated packets."""
        parts, dated = self._parts, self._last - self._turns
        if not self._doubts and self._is_continued(dated, rows):
            return [self.date_next(rows)]
        begins, self._begins_part = self._begins_part, False
        if parts and not begins and self._is_continued(parts[-1].last, rows):
            parts[-1].add(rows, arrival)
            return []
        before = parts[-2].last if len(parts) > 1 else dated
        if parts and not begins and self._is_continued(before, rows):
            # The counter jumped and has come back.
            self.dropped += parts.pop().size
            if parts:
                parts[-1].add(rows, arrival)
                return []
            if not self._after_outage:
                self._end_doubt()
                return [self.date_next(rows)]
        self._doubts = True
        parts.append(_Part())
        parts[-1].add(rows, arrival)
        return []

    def _resolve(self, arrival: float) -> list[PacketRows]:
        """Return the waiting packets whose dates are now known."""
        if not self._parts:
            return []
        least = min(difference for _, difference in self._comparisons)
        tolerance = self._tolerance(arrival)
        turns, last, each, in_order = self._turns, self._last, list[float](), True
        for part in self._parts:
            if isfinite(self._turn):
                turns = self._turn * ceil((last - self._gap - part.first) / self._turn)
            in_order &= part.first + turns >= last - self._gap
            each.append(turns)
            last = part.last + turns
        behind = self.behind = arrival - least - last / self._per_second
        more = round(behind / self.turn_seconds)
        if more and self.turn_seconds / 2 <= tolerance:
            return self._give_up(arrival)
        further = more * self._turn if more else 0.0
        if abs(behind - further / self._per_second) > tolerance:
            return self._give_up(arrival)
        if in_order and not more:
            pairs = zip(self._parts, each, strict=True)
            dated = [rows.later_by(its) for part, its in pairs for rows in part.pieces]
        else:
            turns += further
            start = self._first_fresh(self._parts[-1], arrival)
            waited = arrival - self._parts[-1].arrivals[start][0]
            if last + further < self._last - self._gap or waited < _NO_BACKLOG_TIME:
                return self._give_up(arrival)
            dated = [rows.later_by(turns) for rows in self._parts[-1].pieces[start:]]
        self.dropped += sum(one.size for one in self._parts) - sum(d.ticks.size for d in dated)
        self._parts.clear()
        self._end_doubt()
        self._turns, self._last = turns, float(dated[-1].ticks[-1])
        self._comparisons.clear()
        self._comparisons.append((arrival, arrival - self._last / self._per_second))
        return dated

    def _first_fresh(self, part: _Part, arrival: float) -> int:
        """Return the index of the first arrival in a part that is as recent as the last arrival."""
        youngest = arrival - part.last / self._per_second + _ARRIVAL_UNCERTAINTY
        ages = (heard - tick / self._per_second for heard, tick in part.arrivals)
        return next(k for k, one in enumerate(ages) if one <= youngest)

    def _give_up(self, arrival: float) -> list[PacketRows]:
        """Drop packets that have waited too long; return an empty list."""
        first, _ = self._parts[0].arrivals[0]
        if arrival - first > _MAX_WAIT:
            self._drop_parts()
        return []

    def _end_doubt(self) -> None:
        self._doubts = self._after_outage = False
        self.doubt_since, self.behind = None, 0.0

    def _drop_parts(self) -> None:
        self.dropped += sum(one.size for one in self._parts)
        self._parts.clear()
