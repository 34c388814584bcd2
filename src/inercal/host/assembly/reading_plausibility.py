"""Rejects table readings that imply impossible motion; a corrupted digit looks like this.

The digits in a controller's reply have no checksum. Each reading is therefore compared, axis by
axis, with the last accepted reading, which is older by Δt. The controller states the readback θ,
the rate ω and the following error e; ω_max and α_max are the limits of the bench::

    |Δθ| ≤ 1.2 ω_max Δt + n                                      at any time
    |Δθ − (ω₀ + ω₁) Δt/2| ≤ 2 α_max Δt (Δt/2 + τ) + |ω| Δt/20 + n  by the stated rates
    |Δθ/Δt − Δθ₀/Δt₀| ≤ 2 α_max (Δt + Δt₀)/2 + 2 n/min(Δt, Δt₀)    by the previous motion
    |Δ(θ + e)| ≤ 10″ + n                                          if all axes are settled in both

n is six standard deviations of the readback's noise plus the resolution of the digits, and τ is the
possible delay of the readback. Values that the controller does not state are not checked.

A servo may decelerate faster than the limits of the bench. If two successive readings agree with
each other and are possible after the last accepted reading, they are therefore accepted. From a
stop command until the table is at rest, only the first inequality applies.

`Plausibility` counts the rejected readings; a subclass compares them.
"""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import isfinite, nan, radians
from typing import ClassVar, Generic, TypeVar

from inercal.benches.turntable.bench import Turntable
from inercal.host.drivers.rotary_table import TableState

R = TypeVar("R")  # type of a reading in comparisons


class Plausibility(ABC, Generic[R]):
    """Checks the successive readings of one table.

    Attributes
    ----------
    rejected : int
        Number of rejected readings so far.
    in_a_row : int
        Number of rejected readings since the last accepted reading.
    """

    most_in_a_row: ClassVar[int]

    def __init__(self):
        self.rejected, self.in_a_row = 0, 0
        self._accepted: R | None = None
        self._doubted: R | None = None
        self._stopping = False  # whether a stop was commanded and is not yet complete

    @property
    def is_fault(self) -> bool:
        """Whether so many successive readings are implausible that the table cannot be followed."""
        return self.in_a_row >= self.most_in_a_row

    @property
    def fault_text(self) -> str:
        """Message to the operator about the fault."""
        return (
            f"{self.in_a_row} readings of the table in a row imply motion beyond its limits: an "
            "encoder jumps, or digits of its replies are wrong"
        )

    def restart(self) -> None:
        """Do not compare the next reading with earlier readings, because the host was away."""
        self._accepted = self._doubted = None
        self.in_a_row = 0
        self._stopping = True

    def expect_stop(self) -> None:
        """Allow any deceleration until the table is at rest; a stop may exceed the limits."""
        self._stopping = True

    @abstractmethod
    def accept_state(self, state: TableState) -> bool:
        """Return whether a reading that a driver returned is plausible."""

    def _accept(self, now: R) -> None:
        self._accepted, self._doubted, self.in_a_row = now, None, 0

    def _reject(self, now: R) -> None:
        """Remember a rejected reading; if the next reading agrees with it, both are accepted."""
        self._doubted = now
        self.rejected += 1
        self.in_a_row += 1


MAX_IMPLAUSIBLE_READINGS = 5  # successive readings; the same number may fail
_RATE_MARGIN = 1.2  # times the limit of the bench, as in the interlocks
_ACCELERATION_MARGIN = 2.0  # times the limit of the bench; a servo overshoots when a ramp begins
_RATE_SHARE = 0.05  # fraction of a stated rate, because controllers average it over several cycles
NOISE_FACTOR = 6.0  # standard deviations
_RESOLUTION = radians(1e-4)  # rad; controllers may state rates and angles with few digits
_SETTLED_ANGLE = radians(10 / 3600)  # rad; a settled servo may still move by this angle
_MAX_COMPARABLE_GAP = 1.0  # s; after a longer time, a reading is not compared with earlier readings
_FEW_INTERVALS = 3.0  # times the previous interval; longer intervals are not compared


@dataclass(frozen=True)
class AxisReading:
    """One axis in one reading, in rad and rad/s; NaN if a value is not stated."""

    angle: float
    rate: float
    following_error: float


@dataclass(frozen=True)
class _Reading:
    """A reading, and the motion since the previous reading."""

    time: float
    axes: tuple[AxisReading, ...]
    settled: bool
    interval: float = nan
    rates: tuple[float, ...] = ()


class ReadingPlausibility(Plausibility[_Reading]):
    """Checks the successive readings of one table.

    Parameters
    ----------
    bench : Turntable
        Bench that states the limits, the noise and the latency.
    """

    most_in_a_row = MAX_IMPLAUSIBLE_READINGS

    def __init__(self, bench: Turntable):
        super().__init__()
        self._limits = tuple(
            (_RATE_MARGIN * one.rate, _ACCELERATION_MARGIN * one.acceleration)
            for one in bench.axis_motion_limits
        )
        self._noise = NOISE_FACTOR * bench.white + _RESOLUTION
        self._latency = abs(bench.latency.value) + 3 * bench.latency.sd

    def accept_state(self, state: TableState) -> bool:
        """Return whether a reading that a driver returned is plausible."""
        homed = all(axis.homed for axis in state.axes)
        axes = [
            AxisReading(axis.angle if homed else nan, axis.rate, axis.following_error)
            for axis in state.axes
        ]
        return self.accept(state.time, axes, settled=all(axis.settled for axis in state.axes))

    def accept(self, time: float, axes: Sequence[AxisReading], *, settled: bool) -> bool:
        """Return whether a reading is plausible after the earlier readings.

        Parameters
        ----------
        time : float
            Time by the table's clock, s. It must be later than the previous reading.
        axes : sequence of AxisReading
            All axes. If the zero of an axis is unknown, its angle is NaN and is not compared.
        settled : bool
            Whether all axes report that they hold a position.
        """
        now = _Reading(time, tuple(axes), settled)
        before, doubted = self._accepted, self._doubted
        if not all(isfinite(axis.angle) for axis in axes):
            self.restart()
            return True
        if before is None or not 0 < time - before.time <= _MAX_COMPARABLE_GAP:
            if before is None or time > before.time:
                self._accept(now)
            return True
        if self._agree(before, now) or (
            doubted is not None and self._is_possible(before, now) and self._agree(doubted, now)
        ):
            self._accept(now)
            return True
        self._reject(now)
        return False

    def _accept(self, now: _Reading) -> None:
        self._stopping &= not now.settled
        before = self._accepted if self._doubted is None else None
        if before is not None and now.time - before.time <= _MAX_COMPARABLE_GAP:
            interval = now.time - before.time
            rates = tuple(
                (one.angle - other.angle) / interval
                for one, other in zip(now.axes, before.axes, strict=True)
            )
            now = replace(now, interval=interval, rates=rates)
        super()._accept(now)

    def _is_possible(self, before: _Reading, now: _Reading) -> bool:
        interval = now.time - before.time
        return all(
            abs(one.angle - other.angle) <= rate * interval + self._noise
            for one, other, (rate, _) in zip(now.axes, before.axes, self._limits, strict=True)
        )

    def _agree(self, before: _Reading, now: _Reading) -> bool:
        """Return whether one reading may follow another on all axes."""
        if not 0 < now.time - before.time <= _MAX_COMPARABLE_GAP:
            return False
        return self._is_possible(before, now) and (
            self._stopping
            or all(self._agrees_on_axis(before, now, i) for i in range(len(now.axes)))
        )

    def _agrees_on_axis(self, before: _Reading, now: _Reading, i: int) -> bool:
        last, axis, acceleration = before.axes[i], now.axes[i], self._limits[i][1]
        interval, moved = now.time - before.time, axis.angle - last.angle
        if isfinite(last.rate) and isfinite(axis.rate):
            most = acceleration * interval * (interval / 2 + self._latency)
            most += _RATE_SHARE * max(abs(last.rate), abs(axis.rate)) * interval + self._noise
            if abs(moved - interval * (last.rate + axis.rate) / 2) > most:
                return False
        if before.rates and interval <= _FEW_INTERVALS * before.interval:
            most = acceleration * (interval + before.interval) / 2
            most += 2 * self._noise / min(interval, before.interval)
            if abs(moved / interval - before.rates[i]) > most:
                return False
        errors = axis.following_error - last.following_error
        if now.settled and before.settled and isfinite(errors):
            return abs(moved + errors) <= _SETTLED_ANGLE + self._noise
        return True
