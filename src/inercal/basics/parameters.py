"""Declare the imperfections of a bench as data.

Each declaration has three uses: a simulation draws from it, an estimator treats it as a nuisance
parameter with its standard deviation as the prior, and the Type B budget lists it.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from inercal.basics.arrays import Array
from inercal.basics.units import Measured, si_factor

Scope = Literal["run", "position", "turn", "dwell", "pass", "mounting", "speed"]

_DISPLAY_UNITS = {  # SI unit of a parameter and the unit in which it is printed
    "m/s²": "m/s²",
    "m": "mm",
    "(m/s²)⁻¹": "ppm/g",
    "rad": "°",
    "rad/s": "°/h",
    "1": "ppm",
    "s": "ms",
}
_FINE_UNITS = {"rad": "″", "m/s²": "µg"}
_FINE_LIMIT = 1e-3  # rad or m/s²


@dataclass(frozen=True)
class Parameter:
    """One imperfection of a bench.

    Parameters
    ----------
    name : str
    unit : str
        SI unit of `value` and `sd`.
    sd : float
        Standard deviation; 0 means exactly known.
    scope : "run", "position", "turn", "dwell", "pass", "mounting" or "speed"
        Where the value is constant. With "position", for example, the value is constant during a
        position, and the values in different positions are independent.
    value : float
        Expected value.
    meaning : str
        One-line description for a report.
    assumed : str
        The key of the run file if it states the value without "±"; `sd` then comes from the last
        digit of the value. Empty if `sd` is stated.
    attitude : bool
        Whether the imperfection only rotates the sensor and does not change the norm of readings.
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
        """Return a measured constant as a parameter that is constant during the run.

        Parameters
        ----------
        name, unit, meaning : str
            See the class.
        constant : Measured
            Value and uncertainty, SI.
        key : str
            The key of a run file that states it; empty means `name`.
        """
        assumed = constant.key_if_assumed(key or name)
        return cls(name, unit, constant.sd, "run", constant.value, meaning, assumed)


@dataclass(frozen=True)
class QualifiedParameters:
    """The results of qualifying a bench: values of its parameters, with their covariance.

    Parameters
    ----------
    names : tuple of k str
        See `Parameter.name`.
    value : tuple of k float
        Values, SI.
    covariance : k tuples of k float
        Covariance, SI. For a parameter that differs from dwell to dwell, this is the variance of a
        single value.
    determination, date : tuples of k str
        Identifier and ISO date of the determination of each parameter.
    """

    names: tuple[str, ...] = ()
    value: tuple[float, ...] = ()
    covariance: tuple[tuple[float, ...], ...] = ()
    determination: tuple[str, ...] = ()
    date: tuple[str, ...] = ()

    def std(self, name: str) -> float:
        """Return the standard deviation of one of the parameters."""
        k = self.names.index(name)
        return float(self.covariance[k][k] ** 0.5)

    def correction(self, name: str) -> float:
        """Return the value of a parameter, or 0 if it is not qualified."""
        return self.value[self.names.index(name)] if name in self.names else 0.0

    def acting(self, declared: Mapping[str, Parameter]) -> list[str]:
        """Return the names of run parameters that have an effect and are not exact."""
        return [
            name
            for name in self.names
            if name in declared and declared[name].scope == "run" and declared[name].sd > 0
        ]

    def joint_covariance(self, parameters: Sequence[Parameter]) -> Array:
        """Return the prior covariance of k bench parameters, (k, k), with `sd`² as variances."""
        result = np.diag([one.sd**2 for one in parameters])
        for a, one in enumerate(parameters):
            for b, other in enumerate(parameters):
                if a != b and one.name in self.names and other.name in self.names:
                    i, j = self.names.index(one.name), self.names.index(other.name)
                    result[a, b] = self.covariance[i][j]
        return result

    def draw(
        self, declared: Mapping[str, Parameter], rng: "np.random.Generator", trials: int
    ) -> dict[str, Array]:
        """Draw the errors of a bench for a simulation: by full name, an array (trials,) each.

        Parameters
        ----------
        declared : mapping of str to Parameter
            The parameters that have an effect, by full name.
        rng : Generator
        trials : int
        """
        draws = {name: rng.standard_normal(trials) for name in declared}
        drawn = {name: one.value + one.sd * draws[name] for name, one in declared.items()}
        joint = self.acting(declared)
        covariance = self.joint_covariance([declared[name] for name in joint])
        if np.any(covariance - np.diag(np.diagonal(covariance))):
            errors = np.linalg.cholesky(covariance) @ np.stack([draws[name] for name in joint])
            for name, error in zip(joint, errors, strict=True):
                drawn[name] = declared[name].value + error
        return drawn

    def apply(
        self, parameters: Sequence[Parameter], *, corrected: bool = False
    ) -> tuple[Parameter, ...]:
        """Return the parameters of a bench with qualified values and standard deviations.

        Gravity is unchanged: it is a stated constant of each bench.

        Parameters
        ----------
        parameters : sequence of Parameter
        corrected : bool
            Whether the bench corrects for the qualified values. The expected values of the
            remaining errors are then the same as without a qualification.
        """
        if not self.names:
            return tuple(parameters)
        return tuple(
            replace(
                one,
                sd=self.std(one.name),
                value=one.value if corrected else self.correction(one.name),
                assumed="",
            )
            if one.name in self.names and one.name != "g"
            else one
            for one in parameters
        )


NOT_QUALIFIED = QualifiedParameters()


def local_gravity(gravity: Measured) -> Parameter:
    """Return the bench parameter "g" for local gravity, m/s²."""
    return Parameter.from_measured("g", "m/s²", gravity, "local gravity", "gravity")


def display_unit(parameter: Parameter | None) -> tuple[str, float]:
    """Return the unit in which a parameter is printed, and the size of this unit in SI.

    Parameters
    ----------
    parameter : Parameter or None
        The parameter, or None for a specific force.
    """
    if parameter is None:
        return "m/s²", 1.0
    fine = abs(parameter.value) + parameter.sd < _FINE_LIMIT and parameter.unit in _FINE_UNITS
    unit = (_FINE_UNITS if fine else _DISPLAY_UNITS)[parameter.unit]
    return unit, si_factor(unit)
