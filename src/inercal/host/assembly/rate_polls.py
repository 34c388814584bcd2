"""The polls of a rate table, and the interpolation of its rate.

Between two polls the rate is interpolated linearly. No sequential estimator uses these samples:
states on a rate table are means at steady rates. A motor's controller has no clock, so at a fast
rate the uncertainty of an angle is the rate times the timing jitter of the link. The table needs no
zero.

A poll is left out if no motion within the limits explains its rate, as after a corrupted digit.
"""

from collections.abc import Sequence
from math import radians

import numpy as np

from inercal.basics.arrays import Array, Bools
from inercal.basics.errors import InputError
from inercal.benches.motion_control import AxisMotionLimits, ControlledBench
from inercal.host.assembly.poll_record import MAX_UNREAD, PollRecord
from inercal.host.assembly.reading_plausibility import Plausibility
from inercal.host.drivers.rotary_table import TableState
from inercal.host.table_state_codec import StateArrays
from inercal.recordings import AngleQuality

MAX_IMPLAUSIBLE_RATES = 10  # in a row; after more, the table cannot be followed
_RATE_MARGIN, _ACCELERATION_MARGIN = 1.2, 2.0  # times the limits
_BAND = radians(1.0)  # rad/s; allowance for scatter in the servo and its readback
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
        """Return whether rates (k,) in rad/s are plausible after the earlier ones.

        If a second reading agrees with a rejected one, it is accepted, because the first was right.
        From a stop command until the table is at rest, any deceleration is plausible.
        """
        now = time, rates
        before, doubted = self._accepted, self._doubted
        if bool((np.abs(rates) <= self._rates).all()) and (  # not so for NaN
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
        Bench whose limits decide which polls are implausible and left out.
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
        """Return rates (n, k) in rad/s at times (n,), and where they are known; see `PollRecord`.

        The quality of angles is that of missing angles, because no filter uses them.
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
