"""Store the polls of a table in the order of its clock, and relate this clock to the host's.

The subclasses for turntables and rate tables (`table_polls`) store different values from a poll,
check differently for implausible polls, and interpolate differently between polls.

The clocks are related at the start. After a time without replies, `wrap_correction` relates them
again.
"""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from math import inf, isfinite
from typing import Any, NamedTuple

import numpy as np

from inercal.basics.arrays import Array, Bools
from inercal.basics.errors import InputError
from inercal.basics.units import format_duration
from inercal.host.assembly.reading_plausibility import Plausibility
from inercal.host.drivers.rotary_table import StateArrays, unpack_states
from inercal.host.run_log import LogFrame
from inercal.recordings import AngleQuality

CLOCK_LOST = frozenset({"the table"})  # names in an error after which the run cannot continue
MATCHING_TIME = 5.0  # s; the smallest difference between two clocks is found in this time
_ARRIVAL_TOLERANCE, _DRIFT = 1.0, 2e-4  # s, and fraction of an outage: possible arrival error
# Uncertainty of an arrival, s. Clock turns can be counted if half a turn is longer than this.
_ARRIVAL_UNCERTAINTY = 0.1


def wrap_correction(behind: float, wraps: float, outage: float) -> float:
    """Return the correction of a table clock that may have wrapped around, s.

    Parameters
    ----------
    behind : float
        Time by which the clock is behind, according to the host's clock, s.
    wraps : float
        Time after which the clock wraps around, s; infinite if it never does.
    outage : float
        Time during which nothing was received from the table, s.

    Raises
    ------
    InputError
        The clock was reset, or may have wrapped around any number of times.
    """
    drift = _DRIFT * abs(outage)
    added = 0.0
    if isfinite(wraps):
        added = wraps * round(behind / wraps)
        if wraps / 2 < _ARRIVAL_UNCERTAINTY + drift:
            raise InputError(
                f"the table sent nothing for {format_duration(outage)}, and its clock starts again "
                f"every {wraps:.3g} s: its clock can no longer be matched to that of the bench; "
                "begin a new run",
                names=tuple(CLOCK_LOST),
            )
    if abs(behind - added) > _ARRIVAL_TOLERANCE + drift:
        raise InputError(
            "the table has reset its clock: it can no longer be matched to the IMU's clock; begin "
            "a new run",
            names=tuple(CLOCK_LOST),
        )
    return added


# Time without a poll after which the angles are unknown, s, because the table may have moved
# anywhere. If a table was at rest before and after such a gap, it is assumed to have been at rest
# during the gap.
MAX_UNREAD = 5.0
_AFTER = 3  # number of polls that are needed after a time


class PollHistory(NamedTuple):
    """Polls in the order of time; the oldest polls are dropped."""

    time: Array  # (n,) s by the table's clock, unwrapped
    value: Array  # (n, k) rad, NaN while a table searches for its zero; or rad/s
    settled: Bools  # (n,)

    def where(self, rows: "Bools | slice") -> "PollHistory":
        """Return a selection of the polls."""
        return self._make(column[rows] for column in self)

    def join(self, other: "PollHistory") -> "PollHistory":
        """Return these polls, followed by later polls."""
        return self._make(map(np.concatenate, zip(self, other, strict=True)))


class PollRecord(ABC):
    """The states of a table, which were read in polls.

    Parameters
    ----------
    plausibility : Plausibility
        Check that identifies and counts polls that imply impossible motion.

    Attributes
    ----------
    history : PollHistory or None
        The polls; None before the first poll.
    offset : float or None
        Host time minus table time, s: the smallest difference among the first polls. None before it
        is known.
    wrap_offset : float
        Correction that is added to the table's times, s, because its clock may have wrapped around
        during a time without replies.
    drops : int
        Number of polls that were not later than the previous poll.
    count : int
        Number of all polls.
    """

    def __init__(self, plausibility: Plausibility[Any]):
        self.history: PollHistory | None = None
        self.offset: float | None = None
        self.drops = self.count = 0
        self._counted = plausibility
        self._first_arrival, self._least_difference = 0.0, inf
        # The latest host time minus table time, because the clocks drift apart in a long run.
        self._difference = 0.0
        self._wraps, self._must_match = inf, False
        self.wrap_offset = 0.0

    @property
    def implausible(self) -> int:
        """Number of polls that were rejected because the table cannot move in this way."""
        return self._counted.rejected

    @property
    def complete_until(self) -> float:
        """Time before which angles can be interpolated, s; −∞ if there are too few polls."""
        if self.history is None or self.history.time.size <= _AFTER:
            return -inf
        return float(self.history.time[-_AFTER])

    @property
    def last(self) -> float:
        """Time of the last poll, s; −∞ before the first poll."""
        return -inf if self.history is None else float(self.history.time[-1])

    def begin_session(self, wraps: float) -> None:
        """Begin a session; the clock wraps around every `wraps` s (infinite if it never does)."""
        self._wraps = wraps
        self._counted.restart()
        if self.offset is None:
            self.history, self._least_difference = None, inf
        else:
            self._must_match = True

    def expect_stop(self) -> None:
        """Allow any deceleration until the table is at rest."""
        self._counted.expect_stop()

    def feed(self, frames: Sequence[LogFrame]) -> None:
        """Process the polls of one session.

        Raises
        ------
        InputError
            The table's clock was reset.
        """
        if not frames:
            return
        came = unpack_states([frame.payload for frame in frames])
        heard = np.array([frame.time for frame in frames])
        time = np.where(np.isfinite(came.time), came.time, heard)
        if self._must_match and self.offset is not None:
            behind = float(heard[0]) - self._difference - float(time[0])
            outage = float(heard[0]) - self._difference - self.last
            self.wrap_offset = wrap_correction(behind, self._wraps, outage)
            self._must_match = False
        time = time + self.wrap_offset
        self._difference = float(heard[-1] - time[-1])
        later = time > np.maximum.accumulate(np.concatenate([[self.last], time[:-1]]))
        self.drops += int(np.sum(~later))
        self.count += len(frames)
        values = self._values(came)
        good = later & self._plausible(time, values, came, later)
        kept = PollHistory(time, values, came.settled).where(good)
        if self.offset is None:
            self._match(heard, time)
        if self.history is None:
            self.history = kept if kept.time.size else None
            return
        self.history = self.history.join(kept)

    def _match(self, heard: Array, time: Array) -> None:
        """Search for the smallest clock difference among the first polls."""
        if not isfinite(self._least_difference):
            self._first_arrival = float(heard[0])
        early = heard < self._first_arrival + MATCHING_TIME
        self._least_difference = min(
            self._least_difference, float(np.min((heard - time)[early], initial=inf))
        )
        if not early.all():
            self.offset = self._least_difference

    def discard_old(self, before: float) -> None:
        """Drop the polls that are not needed for times after `before`."""
        if self.history is not None:
            first = int(np.searchsorted(self.history.time, before, "right")) - 3
            if first > 0:
                self.history = self.history.where(slice(first, None))

    @abstractmethod
    def readback(self, time: Array) -> tuple[Array, AngleQuality, Bools]:
        """Return the values, (n, k), at times, (n,), their uncertainty, and which are known.

        The times must be before `complete_until`.
        """

    @abstractmethod
    def _values(self, came: StateArrays) -> Array:
        """Return the values to store from the polls, (n, k)."""

    @abstractmethod
    def _plausible(self, time: Array, values: Array, came: StateArrays, later: Bools) -> Bools:
        """Return which polls are plausible as motion of the table, (n,)."""
