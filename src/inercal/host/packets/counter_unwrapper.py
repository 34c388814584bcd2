"""Unwraps counters and clocks that restart at zero, and detects lost packets by their steps."""

from dataclasses import dataclass
from enum import IntFlag
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

_MAX_STEP = 2.0**62  # a longer step is not a step


class Flag(IntFlag):
    """Properties of a packet that a reader must know."""

    SATURATED = 1  # a reading at its full scale
    INVALID = 2  # a reading that the device calls none; it is NaN
    GAP = 4  # packets were lost before this one
    REPEATED = 8  # same counter as the packet before
    OUT_OF_ORDER = 16  # a counter below that of the packet before
    STATUS = 32  # the device's status is not that of good data


class UnwrappedValues(NamedTuple):
    """Values that were counted on, (n,); flags of the packets, (n,) uint8; packets lost."""

    values: NDArray[Any]
    flags: NDArray[np.uint8]
    lost: int


def flag_array(where: NDArray[np.bool_], flag: Flag) -> NDArray[np.uint8]:
    """Return a flag where something holds."""
    return where.astype(np.uint8) * np.uint8(flag)


@dataclass
class CounterUnwrapper:
    """Follows a raw counter or clock through one stream.

    Parameters
    ----------
    modulus : float
        Where it starts again at 0; 0: never.
    step : float
        From packet to packet; 0: unknown, and nothing is said of the steps.
    """

    modulus: float
    step: float
    _last: float | int | None = None
    _wrap_count: int = 0

    def unwrap(self, raw: NDArray[Any]) -> UnwrappedValues:
        """Count on: a step of half the modulus or more is one back.

        Parameters
        ----------
        raw : (n,) array of int64 or float64
            Those that follow the ones of the call before.
        """
        flags = np.zeros(raw.size, np.uint8)
        if not raw.size:
            return UnwrappedValues(raw, flags, 0)
        before = np.concatenate([raw[:1] if self._last is None else [self._last], raw[:-1]])
        step = np.subtract(raw, before, dtype=np.float64)
        # A clock that is a real number may come out of a false packet as NaN or beyond all sense.
        step = np.where(np.abs(step) < _MAX_STEP, step, 0.0)
        values = raw
        if self.modulus:
            # Whole turns are counted, not steps added up: the values of a clock stay exact.
            turns = np.floor(0.5 - step / self.modulus).astype(np.int64)
            step += turns * self.modulus
            total = self._wrap_count + np.cumsum(turns)
            values = raw + total * raw.dtype.type(self.modulus)
            self._wrap_count = int(total[-1])
        known = slice(1 if self._last is None else 0, None)
        self._last = raw[-1]
        if not self.step:
            return UnwrappedValues(values, flags, 0)
        passed = np.rint(step[known] / self.step)
        flags[known] |= flag_array(passed > 1, Flag.GAP)
        flags[known] |= flag_array(step[known] == 0, Flag.REPEATED)
        flags[known] |= flag_array(step[known] < 0, Flag.OUT_OF_ORDER)
        return UnwrappedValues(values, flags, int(np.sum(np.maximum(passed - 1, 0))))
