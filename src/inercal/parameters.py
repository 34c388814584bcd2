"""Imperfections of a bench, declared as data.

One declaration has three uses: a simulation draws from it, an estimator has it as a nuisance
parameter with its standard deviation as the prior, and the Type B budget lists it.
"""

from dataclasses import dataclass
from typing import Literal

from inercal.units import Measured

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
        The extent over which the value is constant; values of different positions (turns, dwells,
        …) are independent.
    value : float
        Expected value.
    meaning : str
        One line for a report.
    assumed : str
        The key of a run file that states the value without "±": `sd` is then that of its last
        digit. Empty where `sd` is stated.
    attitude : bool
        Whether it only turns the sensor: no norm of readings depends on it.
    """

    name: str
    unit: str
    sd: float
    scope: Scope
    value: float = 0.0
    meaning: str = ""
    assumed: str = ""
    attitude: bool = False

    @classmethod
    def from_measured(
        cls, name: str, unit: str, constant: Measured, meaning: str, key: str = ""
    ) -> "Parameter":
        """Return a measured constant as a parameter of the run.

        Parameters
        ----------
        name, unit, meaning : str
            As of a parameter.
        constant : Measured
            SI.
        key : str
            The key of a run file that states it; empty is `name`.
        """
        assumed = constant.key_if_assumed(key or name)
        return cls(name, unit, constant.sd, "run", constant.value, meaning, assumed)


def local_gravity(gravity: Measured) -> Parameter:
    """Return the parameter "g" of a bench from its gravity, m/s²."""
    return Parameter.from_measured("g", "m/s²", gravity, "local gravity", "gravity")
