"""The table's polls, and its angles between them.

A cubic goes through the four polls about a time, unevenly apart as they are; beside a gap and at
the first poll a parabola through three, or a line. Across a gap there is nothing, unless the table
stood still on both sides, as where it holds and is polled more seldom: there a line.
"""
# Numba's decorator has no types.
# pyright: reportUntypedFunctionDecorator=false

from collections.abc import Sequence
from math import inf, isfinite, nan
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from inercal.arrays import Array
from inercal.errors import InputError
from inercal.host.assembly.clock_matching import MATCHING_TIME, wrap_correction
from inercal.host.run_log import LogFrame
from inercal.host.table_state_codec import unpack_states

# A gap: polls, and s through which a cubic still knows an angle to 2e-5 rad at 15 °/s² (rms).
_GAP_POLLS, _MIN_GAP = 2.5, 0.1
HOLD_POLL_FACTOR = 4  # so many times seldomer a table is polled that holds its place
MAX_REST_GAP = 5.0  # s of a gap through which a table is taken to stand that stood on both sides
SAME_ANGLE = 5e-5  # rad, 10″


class PollHistory(NamedTuple):
    """Polls in the order of time; the oldest are let go."""

    time: Array  # (n,) s by the table's clock, counted on
    angle: Array  # (n, k) rad; NaN while a table seeks its zero
    settled: NDArray[np.bool_]  # (n,)

    def where(self, rows: "NDArray[np.bool_] | slice") -> "PollHistory":
        """Return some of them."""
        return self._make(column[rows] for column in self)

    def join(self, other: "PollHistory") -> "PollHistory":
        """Return these and later ones."""
        return self._make(map(np.concatenate, zip(self, other, strict=True)))


class TablePolls:
    """What the table said of itself.

    Parameters
    ----------
    poll : float
        s between polls.

    Attributes
    ----------
    known : PollHistory or None
        Polls; None before the first.
    offset : float or None
        The host's time minus the table's, s: the least of the first polls; None before.
    wrap_offset : float
        What is added to the table's own times, s: its clock may have begun again in an outage.
    drops : int
        Polls that were not later than the one before.
    """

    def __init__(self, poll: float):
        self.history: PollHistory | None = None
        self.offset: float | None = None
        self.drops = 0
        self._gap = max(_GAP_POLLS * poll, _MIN_GAP)
        self._first_arrival, self._least_difference = 0.0, inf
        self._wraps, self._must_match = inf, False
        self.wrap_offset = 0.0

    @property
    def last(self) -> float:
        """Time of the last poll, s; −∞ before the first."""
        return -inf if self.history is None else float(self.history.time[-1])

    def begin_session(self, wraps: float) -> None:
        """Expect a clock that may have begun anew at each `wraps` s (infinite: never)."""
        self._wraps = wraps
        if self.offset is None:
            self.history, self._least_difference = None, inf
        else:
            self._must_match = True

    def feed(self, frames: Sequence[LogFrame]) -> None:
        """Take in polls of one session.

        Raises
        ------
        InputError
            A clock that began anew.
        """
        if not frames:
            return
        came = unpack_states([frame.payload for frame in frames])
        heard = np.array([frame.time for frame in frames])
        time = np.where(np.isfinite(came.time), came.time, heard)
        if self._must_match and self.offset is not None:
            outage = float(heard[0]) - self.offset - self.last
            self.wrap_offset = wrap_correction(
                float(heard[0]) - self.offset - float(time[0]), self._wraps, outage, "the table"
            )
            self._must_match = False
        time = time + self.wrap_offset
        later = time > np.maximum.accumulate(np.concatenate([[self.last], time[:-1]]))
        self.drops += int(np.sum(~later))
        # An angle is one from the zero that homing finds; of a table that seeks it there is none.
        angle = np.where(came.homed[:, None], came.angle, nan)
        kept = PollHistory(time, angle, came.settled).where(later)
        if self.offset is None:
            self._match(heard, time)
        if self.history is None:
            self.history = kept if kept.time.size else None
            return
        self.history = self.history.join(kept)

    def _match(self, heard: Array, time: Array) -> None:
        """Look for the least difference of the clocks among the first polls."""
        if not isfinite(self._least_difference):
            self._first_arrival = float(heard[0])
        early = heard < self._first_arrival + MATCHING_TIME
        self._least_difference = min(
            self._least_difference, float(np.min((heard - time)[early], initial=inf))
        )
        if not early.all():
            self.offset = self._least_difference

    def discard_old(self, before: float) -> None:
        """Let go of polls that no time from `before` on needs."""
        if self.history is not None:
            first = int(np.searchsorted(self.history.time, before, "right")) - 2
            if first > 0:
                self.history = self.history.where(slice(first, None))

    def angles(self, time: Array) -> tuple[Array, NDArray[np.bool_]]:
        """Return angles at times (n,), (n, k) rad, and which are known.

        Two polls or more must be later than any of the times.
        """
        if self.history is None:
            raise InputError("no poll of the table yet")
        found = np.zeros((time.size, self.history.angle.shape[1]))
        there = np.zeros(time.size, np.bool_)
        _interpolate_angles(time, *self.history, self._gap, found, there)
        return found, there & np.isfinite(found).all(axis=-1)


@njit(cache=True, nogil=True, error_model="numpy")
def _interpolate_angles(
    time: Array,
    x: Array,
    y: Array,
    settled: NDArray[np.bool_],
    gap: float,
    found: Array,
    there: NDArray[np.bool_],
) -> None:
    """Write angles at ascending times, and whether they are known."""
    weight = np.zeros(4)
    a = 0
    for i in range(time.size):
        t = time[i]
        while x[a + 1] <= t:
            a += 1
        step = x[a + 1] - x[a]
        near = step <= gap
        stood = step <= MAX_REST_GAP and settled[a] and settled[a + 1]
        for k in range(y.shape[1]):
            stood = stood and abs(y[a + 1, k] - y[a, k]) <= SAME_ANGLE
        there[i] = t >= x[a] and (near or stood)
        first = a - 1 if near and a > 0 and x[a] - x[a - 1] <= gap else a
        last = a + 2 if near and x[a + 2] - x[a + 1] <= gap else a + 1
        for j in range(first, last + 1):
            weight[j - first] = 1.0
            for m in range(first, last + 1):
                if m != j:
                    weight[j - first] *= (t - x[m]) / (x[j] - x[m])
        for k in range(y.shape[1]):
            # Weights add up to 1: of large angles only the differences are rounded.
            found[i, k] = y[a, k]
            for j in range(first, last + 1):
                found[i, k] += weight[j - first] * (y[j, k] - y[a, k])
