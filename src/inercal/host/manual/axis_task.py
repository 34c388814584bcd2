"""What an axis that is operated by hand was told last."""

from dataclasses import dataclass
from math import inf, nan
from typing import Literal

Activity = Literal["idle", "home", "go", "jog", "stop"]


@dataclass(frozen=True)
class AxisTask:
    """What an axis was told last.

    Parameters
    ----------
    activity : "idle", "home", "go", "jog" or "stop"
        Stop: it decelerates.
    goal : float
        rad, where it was sent; NaN where it was sent nowhere.
    rate : float
        rad/s that it was told to turn at, signed in a jog.
    begun, due : float
        s of the session: when it was told, and by when it should be over.
    """

    activity: Activity = "idle"
    goal: float = nan
    rate: float = 0.0
    begun: float = -inf
    due: float = inf
