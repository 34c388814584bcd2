"""What an operator may say of a run, beside what is in its run file."""

from typing import NamedTuple


class RunOptions(NamedTuple):
    """What an operator may say of a run.

    Parameters
    ----------
    speed : float or None
        Most seconds of a simulated bench in one of the wall's; None is as fast as it goes.
    temperature : (float, float) or None
        K that the IMU must stay within.
    patience : float
        s that an IMU may be gone before the run ends.
    """

    speed: float | None = None
    temperature: tuple[float, float] | None = None
    patience: float = 120.0


DEFAULT_OPTIONS = RunOptions()
