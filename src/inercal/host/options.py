"""Options of a run that the operator sets when it starts; the run file has all others."""

from typing import NamedTuple


class RunOptions(NamedTuple):
    """Options of a run that the operator sets.

    Parameters
    ----------
    speed : float or None
        Largest number of seconds that a simulated bench advances per second; None: no limit.
    temperature : (float, float) or None
        Lowest and highest temperature of the IMU, K; outside them the run pauses.
    patience : float
        Time without data of the IMU after which the run ends, s.
    """

    speed: float | None = None
    temperature: tuple[float, float] | None = None
    patience: float = 120.0


DEFAULT_OPTIONS = RunOptions()
