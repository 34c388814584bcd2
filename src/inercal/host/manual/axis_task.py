"""The last command of an axis that is operated by hand."""

from dataclasses import dataclass
from math import inf, nan
from typing import Literal

Activity = Literal["idle", "home", "go", "jog", "stop"]


@dataclass(frozen=True)
class AxisTask:
    """The last command of an axis.

    Parameters
    ----------
    activity : "idle", "home", "go", "jog" or "stop"
        Stop: it decelerates.
    goal : float
        Commanded angle, rad; NaN where none is commanded.
    rate : float
        Commanded rate, rad/s; signed in a jog.
    begun, due : float
        s of the session: the time of the command, and the time limit of the motion.
    """

    activity: Activity = "idle"
    goal: float = nan
    rate: float = 0.0
    begun: float = -inf
    due: float = inf
