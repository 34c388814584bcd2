"""Interpolates the angles of a turntable, or the rate of a rate table, between its polls.

The angle of a turntable is interpolated by a cubic through the four unevenly spaced polls around a
time. The error of the cubic is estimated from the change that a fifth poll causes in the
interpolated value. While the table holds an angle, it is polled less often, and the angle of the
nearest poll is used. Each epoch of a filter (ten per second) then has a separate poll, so the noise
of the epochs is independent.

Next to a gap while the table turns, the interpolation is linear and is marked, because the table
may have stopped in the gap. A poll is omitted if no motion within the limits explains it
(`reading_plausibility`).

Between two polls of a rate table, the rate is interpolated linearly. No sequential estimator uses
these samples, because states on a rate table are means at steady rates. The controller of a motor
has no clock, so at a fast rate the uncertainty of an angle is the rate times the timing jitter of
the link. The zero position of the table
need not be known. A poll is omitted if no motion within the limits explains its
rate, for example after a corrupted digit.
"""
# Numba's decorator is not typed.
# pyright: reportUntypedFunctionDecorator=false

from collections.abc import Sequence
from math import inf, nan, radians

import numpy as np

from inercal.basics.arrays import Array, Bools
from inercal.basics.errors import InputError
from inercal.benches.motion_control import AxisMotionLimits, ControlledBench
from inercal.benches.turntable import Turntable
from inercal.estimation.kernel_options import njit
from inercal.host.assembly.poll_record import MAX_UNREAD, PollRecord
from inercal.host.assembly.reading_plausibility import (
    NOISE_FACTOR,
    AxisReading,
    Plausibility,
    ReadingPlausibility,
)
from inercal.host.drivers.rotary_table import StateArrays, TableState
from inercal.methods.turntable.model import EPOCH_PERIOD
from inercal.recordings import AngleQuality

POLL_INTERVAL = 0.02  # s between polls while the table turns, on real and simulated benches
HOLD_POLL_FACTOR = 4  # the poll interval is this factor longer during a hold
# In poll intervals: if a single poll is missing, the cubic continues and its error estimate grows.
_GAP_POLLS = 2.5
SAME_ANGLE = 5e-5  # rad, 10″; largest change of the angles at rest, apart from noise
_MAX_POLL_AGE = EPOCH_PERIOD / 2  # s from a poll; within this time, only one epoch uses the poll
# Error of the cubic divided by the change that a fifth poll causes. Both are rms values over all
# positions of a step in acceleration among evenly spaced polls (0.0097 and 0.0071 of this step
# times the interval²).
_INTERPOLATION_FACTOR = 1.4


class TablePolls(PollRecord):
    """The polls of a turntable, and the interpolation of its angles.

    Parameters
    ----------
    poll : float
        Time between two polls, s.
    bench : Turntable
        Bench whose limits and noise decide which polls are implausible and therefore omitted.
    """

    def __init__(self, poll: float, bench: Turntable):
        self._plausibility = ReadingPlausibility(bench)
        super().__init__(self._plausibility)
        self._gap, self._same_angle = _GAP_POLLS * poll, SAME_ANGLE + NOISE_FACTOR * bench.white

    def _values(self, came: StateArrays) -> Array:
        # Angles count from the zero that homing finds. They are unknown while a table searches for
        # this zero.
        return np.where(came.homed[:, None], came.angle, nan)

    def _plausible(self, time: Array, values: Array, came: StateArrays, later: Bools) -> Bools:
        """Return which polls are plausible as motion of the table, (n,)."""
        columns = zip(
            time.tolist(), came.settled.tolist(), later.tolist(), values.tolist(),
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

    def readback(self, time: Array) -> tuple[Array, AngleQuality, Bools]:
        """Return angles, (n, k), rad, at times, (n,), their uncertainty, and which are known.

        The times must be before `complete_until`.
        """
        if self.history is None:
            raise InputError(
                "the table has not been polled yet; add a poll before you ask for angles"
            )
        found = np.zeros((time.size, self.history.value.shape[1]))
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
    settled: Bools,
    gap: float,
    same: float,
    found: Array,
    gain: Array,
    sd: Array,
    there: Bools,
) -> None:
    """Compute angles at ascending times, their uncertainty and whether they are known, in place."""
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
            # The weights add up to 1, so it is sufficient to interpolate differences, which reduces
            # rounding errors of large angles.
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
            b = e if e < a else a + 2  # the interval to this poll begins here
            if e < 0 or not (x[b + 1] - x[b] <= gap or _stood(x, y, settled, same, b)):
                continue
            beyond += 1
            # A fifth point changes the interpolated value by the error of the cubic at this point
            # times the ratio of ω.
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
def _stood(x: Array, y: Array, settled: Bools, same: float, a: int) -> bool:
    """Return whether the table is assumed to be at rest between poll a and the next poll."""
    if a < 0 or x[a + 1] - x[a] > MAX_UNREAD or not (settled[a] and settled[a + 1]):
        return False
    stands = True
    for k in range(y.shape[1]):
        stands = stands and abs(y[a + 1, k] - y[a, k]) <= same
    return stands


@njit(cache=True, nogil=True, error_model="numpy")
def _lagrange_weights(x: Array, first: int, last: int, t: float, weight: Array) -> None:
    """Compute, in place, the weights at t of the polynomial through points first to last."""
    for j in range(first, last + 1):
        weight[j - first] = 1.0
        for m in range(first, last + 1):
            if m != j:
                weight[j - first] *= (t - x[m]) / (x[j] - x[m])


MAX_IMPLAUSIBLE_RATES = 10  # in succession; after more, the table cannot be followed
_RATE_MARGIN, _ACCELERATION_MARGIN = 1.2, 2.0  # times the limits of the bench
_BAND = radians(1.0)  # rad/s; allows for scatter of the servo and the readback
_MAX_COMPARABLE_GAP = 0.5  # s; longest time between two readings that are compared


class RatePlausibility(Plausibility[tuple[float, Array]]):
    """Decides whether the rates in readings are possible within the limits of a table.

    Parameters
    ----------
    limits : sequence of AxisMotionLimits
        Limits of each axis.
    """

    most_in_a_row = MAX_IMPLAUSIBLE_RATES

    def __init__(self, limits: Sequence[AxisMotionLimits]):
        super().__init__()
        self._rates = _RATE_MARGIN * np.array([one.rate for one in limits]) + _BAND
        self._accelerations = _ACCELERATION_MARGIN * np.array([one.acceleration for one in limits])

    def accept_state(self, state: TableState) -> bool:
        """Return whether a reading, as returned by a driver, is plausible."""
        return self.accept(state.time, np.array([axis.rate for axis in state.axes]))

    def accept(self, time: float, rates: Array) -> bool:
        """Return whether rates, (k,), rad/s, are plausible after the earlier rates.

        If a second reading agrees with a rejected reading, it is accepted, because the first was
        correct. From a stop command until the table is at rest, any deceleration is plausible.
        """
        now = time, rates
        before, doubted = self._accepted, self._doubted
        if bool((np.abs(rates) <= self._rates).all()) and (  # false for NaN
            before is None
            or self._stopping
            or self._agrees(before, now)
            or (doubted and self._agrees(doubted, now))
        ):
            self._stopping &= bool((np.abs(rates) > _BAND).any())
            self._accept(now)
            return True
        self._reject(now)
        return False

    def _agrees(self, before: tuple[float, Array], now: tuple[float, Array]) -> bool:
        interval = now[0] - before[0]
        if not 0 < interval <= _MAX_COMPARABLE_GAP:
            return True
        return bool((np.abs(now[1] - before[1]) <= self._accelerations * interval + _BAND).all())


class RatePolls(PollRecord):
    """The polls of a rate table; `history` contains its rates, rad/s.

    Parameters
    ----------
    bench : ControlledBench
        Bench whose limits decide which polls are implausible and therefore omitted.
    """

    def __init__(self, bench: ControlledBench):
        self._plausibility = RatePlausibility(bench.axis_motion_limits)
        super().__init__(self._plausibility)

    def _values(self, came: StateArrays) -> Array:
        return came.rate

    def _plausible(self, time: Array, values: Array, came: StateArrays, later: Bools) -> Bools:
        return np.array(
            [
                is_later and self._plausibility.accept(when, rates)
                for when, rates, is_later in zip(time.tolist(), values, later.tolist(), strict=True)
            ],
            np.bool_,
        )

    def readback(self, time: Array) -> tuple[Array, AngleQuality, Bools]:
        """Return rates, (n, k), rad/s, at times, (n,), and which are known; see `PollRecord`.

        The quality is the same as for missing angles, because no filter uses the rates.
        """
        if self.history is None:
            raise InputError(
                "the table has not been polled yet; add a poll before you ask for rates"
            )
        x, y = self.history.time, self.history.value
        columns: list[Array] = [np.interp(time, x, column) for column in y.T]
        after = np.minimum(np.searchsorted(x, time, "right"), x.size - 1)
        there = (time >= x[0]) & (x[after] - x[np.maximum(after - 1, 0)] <= MAX_UNREAD)
        quality = AngleQuality(np.ones(time.size), np.zeros(time.size))
        return np.stack(columns, axis=-1), quality, there
