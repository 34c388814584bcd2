"""Interpolates the angles of the table between its polls.

A cubic passes through the four unevenly spaced polls about a time. Its error is estimated from a
fifth poll, which changes the interpolant by about as much. Where the table holds an angle and is
polled less often, the angle is that of the nearest poll: each epoch of a filter, ten per second,
has its own poll, so that their noise is independent.

Elsewhere, next to a gap while the table turns, the interpolation is linear and marked as such: the
table may have stopped in the gap. A poll that no motion within the limits explains is omitted
(`reading_plausibility`).
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
from inercal.benches.turntable import Turntable
from inercal.errors import InputError
from inercal.host.assembly.clock_matching import MATCHING_TIME, wrap_correction
from inercal.host.assembly.reading_plausibility import (
    NOISE_FACTOR,
    AxisReading,
    ReadingPlausibility,
)
from inercal.host.run_log import LogFrame
from inercal.host.table_state_codec import StateArrays, unpack_states
from inercal.methods.turntable.model import EPOCH_PERIOD
from inercal.recording import AngleQuality

POLL_INTERVAL = 0.02  # s between polls while the table turns, on benches of iron and simulated ones
HOLD_POLL_FACTOR = 4  # so many times seldomer a table is polled that holds its place
# Polls: where one is missing a cubic goes on, and says how far it is off.
_GAP_POLLS = 2.5
# s without a poll after which no angle is known: it may have gone anywhere. A table is taken to
# stand through as much that stood on both sides.
MAX_UNREAD = 5.0
SAME_ANGLE = 5e-5  # rad, 10″, by which the angles of a table that stands differ beside noise
_MAX_POLL_AGE = EPOCH_PERIOD / 2  # s from a poll within which no other epoch has it
# What a cubic is off by over what a fifth poll changes: root mean squares over the places of a
# sudden acceleration among evenly spaced polls (0.0097 and 0.0071 of its square of the interval).
_INTERPOLATION_FACTOR = 1.4
_AFTER = 3  # polls that are needed behind a time


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
    bench : Turntable
        Its limits and noise: what is no motion of it is left out.

    Attributes
    ----------
    history : PollHistory or None
        Polls; None before the first.
    offset : float or None
        The host's time minus the table's, s: the least of the first polls; None before.
    wrap_offset : float
        What is added to the table's own times, s: its clock may have begun again in an outage.
    drops : int
        Polls that were not later than the one before.
    count : int
        Polls in all.
    """

    def __init__(self, poll: float, bench: Turntable):
        self.history: PollHistory | None = None
        self.offset: float | None = None
        self.drops = self.count = 0
        self._gap, self._plausibility = _GAP_POLLS * poll, ReadingPlausibility(bench)
        self._same_angle = SAME_ANGLE + NOISE_FACTOR * bench.white
        self._first_arrival, self._least_difference = 0.0, inf
        self._wraps, self._must_match = inf, False
        self.wrap_offset = 0.0

    @property
    def implausible(self) -> int:
        """Polls that were left out as no motion of the table."""
        return self._plausibility.rejected

    @property
    def complete_until(self) -> float:
        """Time before which angles can be interpolated, s; −∞ where there are too few polls."""
        if self.history is None or self.history.time.size <= _AFTER:
            return -inf
        return float(self.history.time[-_AFTER])

    @property
    def last(self) -> float:
        """Time of the last poll, s; −∞ before the first."""
        return -inf if self.history is None else float(self.history.time[-1])

    def begin_session(self, wraps: float) -> None:
        """Expect a clock that may have begun anew at each `wraps` s (infinite: never)."""
        self._wraps = wraps
        self._plausibility.restart()
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
        self.count += len(frames)
        # An angle is one from the zero that homing finds; of a table that seeks it there is none.
        angle = np.where(came.homed[:, None], came.angle, nan)
        good = later & self._plausible(time, angle, came, later)
        kept = PollHistory(time, angle, came.settled).where(good)
        if self.offset is None:
            self._match(heard, time)
        if self.history is None:
            self.history = kept if kept.time.size else None
            return
        self.history = self.history.join(kept)

    def _plausible(
        self, time: Array, angle: Array, came: StateArrays, later: NDArray[np.bool_]
    ) -> NDArray[np.bool_]:
        """Return which polls may be motions of the table, (n,)."""
        columns = zip(
            time.tolist(), came.settled.tolist(), later.tolist(), angle.tolist(),
            came.rate.tolist(), came.following_error.tolist(), strict=True,
        )  # fmt: skip
        return np.array(
            [
                is_later
                and self._plausibility.accept(
                    when, [*map(AxisReading, angles, rates, errors)], settled=settled
                )
                for when, settled, is_later, angles, rates, errors in columns
            ],
            np.bool_,
        )

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
            first = int(np.searchsorted(self.history.time, before, "right")) - 3
            if first > 0:
                self.history = self.history.where(slice(first, None))

    def angles(self, time: Array) -> tuple[Array, AngleQuality, NDArray[np.bool_]]:
        """Return angles at times (n,), (n, k) rad, how well they are known, and where at all.

        The times must be before `complete_until`.
        """
        if self.history is None:
            raise InputError(
                "the table has not been polled yet; add a poll before you ask for angles"
            )
        found = np.zeros((time.size, self.history.angle.shape[1]))
        quality = AngleQuality(np.full(time.size, inf), np.full(time.size, inf))
        there = np.zeros(time.size, np.bool_)
        _interpolate_angles(
            time, *self.history, self._gap, self._same_angle, found, *quality, there
        )
        return found, quality, there & np.isfinite(found).all(axis=-1)


@njit(cache=True, nogil=True, error_model="numpy")
def _interpolate_angles(
    time: Array,
    x: Array,
    y: Array,
    settled: NDArray[np.bool_],
    gap: float,
    same: float,
    found: Array,
    gain: Array,
    sd: Array,
    there: NDArray[np.bool_],
) -> None:
    """Write angles at ascending times, how well they are known, and whether they are at all."""
    weight, other = np.zeros(4), np.zeros(4)
    a = 0
    for i in range(time.size):
        t = time[i]
        while x[a + 1] <= t:
            a += 1
        step = x[a + 1] - x[a]
        there[i] = t >= x[a] and step <= MAX_UNREAD
        if there[i] and _stood(x, y, settled, same, a):
            near = a if t - x[a] <= x[a + 1] - t else a + 1
            for k in range(y.shape[1]):
                found[i, k] = y[near, k]
            sd[i] = 0.0
            if abs(t - x[near]) <= _MAX_POLL_AGE:
                gain[i] = 1.0
            continue
        first, last = a, a + 1
        whole = a > 0 and step <= gap
        for b in (a - 1, a + 1):
            whole = whole and (x[b + 1] - x[b] <= gap or _stood(x, y, settled, same, b))
        if whole:
            first, last = a - 1, a + 2
        _lagrange_weights(x, first, last, t, weight)
        for k in range(y.shape[1]):
            # Weights add up to 1: of large angles only the differences are rounded.
            found[i, k] = y[a, k]
            for j in range(first, last + 1):
                found[i, k] += weight[j - first] * (y[j, k] - y[a, k])
        if not whole:
            continue
        gain[i], sd[i] = 0.0, 0.0
        for j in range(4):
            gain[i] += weight[j] * weight[j]
        beyond = 0
        for e in (a - 2, a + 3):
            b = e if e < a else a + 2  # where the way to it begins
            if e < 0 or not (x[b + 1] - x[b] <= gap or _stood(x, y, settled, same, b)):
                continue
            beyond += 1
            # The interpolant through a fifth point moves by what the cubic misses there, times ω.
            _lagrange_weights(x, first, last, x[e], other)
            ratio = 1.0
            for j in range(first, last + 1):
                ratio *= (t - x[j]) / (x[e] - x[j])
            for k in range(y.shape[1]):
                missed = y[e, k] - y[a, k]
                for j in range(first, last + 1):
                    missed -= other[j - first] * (y[j, k] - y[a, k])
                sd[i] = max(sd[i], _INTERPOLATION_FACTOR * abs(ratio * missed))
        if beyond == 0:
            gain[i], sd[i] = np.inf, np.inf


@njit(cache=True, nogil=True, error_model="numpy")
def _stood(x: Array, y: Array, settled: NDArray[np.bool_], same: float, a: int) -> bool:
    """Tell whether the table is taken to stand between poll a and the next."""
    if a < 0 or x[a + 1] - x[a] > MAX_UNREAD or not (settled[a] and settled[a + 1]):
        return False
    stands = True
    for k in range(y.shape[1]):
        stands = stands and abs(y[a + 1, k] - y[a, k]) <= same
    return stands


@njit(cache=True, nogil=True, error_model="numpy")
def _lagrange_weights(x: Array, first: int, last: int, t: float, weight: Array) -> None:
    """Write the weights at t of the polynomial through points first to last."""
    for j in range(first, last + 1):
        weight[j - first] = 1.0
        for m in range(first, last + 1):
            if m != j:
                weight[j - first] *= (t - x[m]) / (x[j] - x[m])
