"""The time that a sensor may take, as stated or compared with the others."""

from collections.abc import Sequence

from inercal.basics.units import format_duration

_FACTOR = 20  # times what the slowest of the others took
_LEAST = 60.0  # s: a busy machine, or one that compiles kernels, delays anybody
_FIRST = 600.0  # s, until others are known
_ENOUGH = 3  # others


class TimeLimit:
    """The longest time of a sensor.

    By default it is twenty times the longest time that any other sensor took, proportionally more
    for a larger recording, and at least a minute. Until three others are known it is ten minutes.

    Parameters
    ----------
    stated : float or None
        The limit that the user states, s.
    """

    def __init__(self, stated: float | None = None):
        self._stated = stated
        self._count, self._longest, self._largest = 0, 0.0, 1

    def note(self, sizes: Sequence[int], seconds: Sequence[float]) -> None:
        """Note the times that sensors took.

        Parameters
        ----------
        sizes : sequence of int
            Bytes of their recordings.
        seconds : sequence of float
        """
        self._count += len(seconds)
        self._longest = max(self._longest, *seconds)
        self._largest = max(self._largest, *sizes)

    def seconds(self, size: int, *, early: bool = False) -> float:
        """Return the limit of a sensor, s.

        Parameters
        ----------
        size : int
            Bytes of its recording.
        early : bool
            Whether it can be tried again when others are known, so it may be stopped early.
        """
        if self._stated is not None:
            return self._stated
        if self._count < _ENOUGH:
            return _LEAST if early else _FIRST
        return max(_LEAST, _FACTOR * self._longest * max(1.0, size / self._largest))

    def reason(self, limit: float) -> str:
        """Return why a sensor was stopped, in words."""
        longest = format_duration(self._longest)
        others = f", while the others took at most {longest}" * bool(self._count)
        return (
            f"it was stopped because it took longer than {format_duration(limit)}{others}; set "
            "another limit with --timeout, and try again with --retry-failed"
        )
