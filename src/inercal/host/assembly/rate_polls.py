"""The polls of a table of rates, and its rate between them.

Between two polls the rate is interpolated linearly. No estimator follows the samples of such a
table one by one: its states are means at steady rates. The controller of a motor has no clock, so
that an angle at a fast rate is uncertain by the rate times the jitter of the link. The table needs
no zero.

A poll is omitted where no motion within the limits explains its rate, as after a wrong digit.
"""

from collections.abc import Sequence
from math import isfinite, radians

import numpy as np
from numpy.typing import NDArray

from inercal.basics.arrays import Array
from inercal.basics.errors import InputError
from inercal.benches.motion_control import AxisMotionLimits, ControlledBench
from inercal.host.assembly.poll_record import MAX_UNREAD, PollRecord
from inercal.host.assembly.reading_plausibility import Plausibility
from inercal.host.drivers.rotary_table import TableState
from inercal.host.table_state_codec import StateArrays
from inercal.recordings import AngleQuality

MAX_IMPLAUSIBLE_RATES = 10  # in a row, beyond which the table cannot be followed
_RATE_MARGIN, _ACCELERATION_MARGIN = 1.2, 2.0  # times the limits
_BAND = radians(1.0)  # rad/s by which a servo and its readback scatter
_MAX_COMPARABLE_GAP = 0.5  # s between two readings that are compared


class RatePlausibility(Plausibility[tuple[float, Array]]):
    """Decides from their rates which readings a table can have within its limits.

    Parameters
    ----------
    limits : sequence of AxisMotionLimits
        Of each axis.
    """

    most_in_a_row = MAX_IMPLAUSIBLE_RATES

    def __init__(self, limits: Sequence[AxisMotionLimits]):
        super().__init__()
        self._limits = tuple(limits)

    def accept_state(self, state: TableState) -> bool:
        """Tell whether a reading is plausible, as a driver returned it."""
        return self.accept(state.time, np.array([axis.rate for axis in state.axes]))

    def accept(self, time: float, rates: Array) -> bool:
        """Tell whether rates, (k,) rad/s, are plausible after those before.

        A second reading that agrees with one that was rejected is accepted: the first was right.
        From a stop that was commanded until the table rests any deceleration is plausible.
        """
        now = time, rates
        before, doubted = self._accepted, self._doubted
        if self._is_possible(rates) and (
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

    def _is_possible(self, rates: Array) -> bool:
        return all(
            isfinite(rate) and abs(rate) <= _RATE_MARGIN * one.rate + _BAND
            for rate, one in zip(rates.tolist(), self._limits, strict=True)
        )

    def _agrees(self, before: tuple[float, Array], now: tuple[float, Array]) -> bool:
        interval = now[0] - before[0]
        if not 0 < interval <= _MAX_COMPARABLE_GAP:
            return True
        change = np.abs(now[1] - before[1]).tolist()
        return all(
            size <= _ACCELERATION_MARGIN * one.acceleration * interval + _BAND
            for size, one in zip(change, self._limits, strict=True)
        )


class RatePolls(PollRecord):
    """The states that a rate table has reported; its `history` contains rates, rad/s.

    Parameters
    ----------
    bench : ControlledBench
        Its limits: what is no motion within them is left out.
    """

    def __init__(self, bench: ControlledBench):
        self._plausibility = RatePlausibility(bench.axis_motion_limits)
        super().__init__(self._plausibility)

    def _values(self, came: StateArrays) -> Array:
        return came.rate

    def _plausible(
        self, time: Array, values: Array, came: StateArrays, later: NDArray[np.bool_]
    ) -> NDArray[np.bool_]:
        return np.array(
            [
                is_later and self._plausibility.accept(when, rates)
                for when, rates, is_later in zip(time.tolist(), values, later.tolist(), strict=True)
            ],
            np.bool_,
        )

    def readback(self, time: Array) -> tuple[Array, AngleQuality, NDArray[np.bool_]]:
        """Return rates at times (n,), (n, k) rad/s, and where they are known; as of `PollRecord`.

        The quality of angles is that of none: no filter uses them.
        """
        if self.history is None:
            raise InputError(
                "the table has not been polled yet; add a poll before you ask for rates"
            )
        x, y = self.history.time, self.history.value
        found = np.empty((time.size, y.shape[1]))
        for k, column in enumerate(y.T):
            found[:, k] = np.interp(time, x, column)
        after = np.minimum(np.searchsorted(x, time, "right"), x.size - 1)
        there = (time >= x[0]) & (x[after] - x[np.maximum(after - 1, 0)] <= MAX_UNREAD)
        return found, AngleQuality(np.ones(time.size), np.zeros(time.size)), there
