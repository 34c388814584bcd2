"""Limit the time for a sensor, as the user states or by the times of other sensors."""

from collections.abc import Sequence

from inercal.basics.units import format_duration

_FACTOR = 20  # times the longest time of the others
_LEAST = 60.0  # s, because a busy machine or the compilation of kernels delays any sensor
_FIRST = 600.0  # s, used before enough other times are known
_ENOUGH = 3  # number of other sensors with known times that are needed


class TimeLimit:
    """Time limit for the calibration of a sensor.

    By default, the limit is twenty times the longest time that any other sensor took, and at least
    one minute. A larger recording gets proportionally more time. Before the times of three other
    sensors are known, the limit is ten minutes.

    Parameters
    ----------
    stated : float or None
        The limit stated by the user, s; None if the user states no limit.
    """

    def __init__(self, stated: float | None = None):
        self._stated = stated
        self._count, self._longest, self._largest = 0, 0.0, 1

    def note(self, sizes: Sequence[int], seconds: Sequence[float]) -> None:
        """Record the times that sensors took.

        Parameters
        ----------
        sizes : sequence of int
            Sizes of the sensors' recordings in bytes.
        seconds : sequence of float
        """
        self._count += len(seconds)
        self._longest = max(self._longest, *seconds)
        self._largest = max(self._largest, *sizes)

    def seconds(self, size: int, *, early: bool = False) -> float:
        """Return the time limit for a sensor, s.

        Parameters
        ----------
        size : int
            Size of the sensor's recording in bytes.
        early : bool
            Whether the sensor may be stopped early, because it will be retried after other times
            are known.
        """
        if self._stated is not None:
            return self._stated
        if self._count < _ENOUGH:
            return _LEAST if early else _FIRST
        return max(_LEAST, _FACTOR * self._longest * max(1.0, size / self._largest))

    def reason(self, limit: float) -> str:
        """Describe why a sensor was stopped."""
        longest = format_duration(self._longest)
        others = f", while the others took at most {longest}" * bool(self._count)
        return (
            f"it was stopped because it took longer than {format_duration(limit)}{others}; set "
            "another limit with --timeout, and try again with --retry-failed"
        )
