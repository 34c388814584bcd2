"""Imperfections of a bench, declared as data.

One declaration serves three uses: a simulation draws from it, an estimation carries it as a
nuisance with its standard deviation as the prior, and the Type B budget lists it.
"""

from dataclasses import dataclass
from typing import Literal

Scope = Literal["run", "position", "turn", "dwell", "pass", "mounting", "speed"]


@dataclass(frozen=True)
class Parameter:
    """One imperfection.

    Parameters
    ----------
    name : str
    unit : str
        Unit of `value` and `sd`, in SI.
    sd : float
        Standard deviation; 0 is exactly known.
    scope : "run", "position", "turn", "dwell", "pass", "mounting" or "speed"
        What shares one value; another position (turn, dwell, …) draws another, independent one.
    value : float
        Expected value.
    meaning : str
        One line for a report.
    assumed : str
        The key of a run file that states the value without "±": `sd` is then of its last digit.
        Empty where `sd` is stated.
    attitude : bool
        Whether it turns the sensor and does nothing else: no norm of readings depends on it.
    """

    name: str
    unit: str
    sd: float
    scope: Scope
    value: float = 0.0
    meaning: str = ""
    assumed: str = ""
    attitude: bool = False
