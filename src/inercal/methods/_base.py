"""What a method is: a plan, the coefficients it sees, and named estimators."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

from inercal.benches import Hand
from inercal.errors import InputError
from inercal.estimate import Estimate, Gaussian
from inercal.plan import Step
from inercal.recording import Observations
from inercal.sensors import Sensor


class Estimator(Protocol):
    """From observations to an estimate of the sensor's coefficients, in their order."""

    def __call__(
        self,
        observations: Observations,
        sensor: Sensor,
        bench: Hand,
        steps: Sequence[Step],
        priors: Sequence[Gaussian] = (),
    ) -> Estimate:
        """Return the estimate; raise NotObserved where the data do not support it."""
        ...


@dataclass(frozen=True)
class Method:
    """A way to calibrate.

    Parameters
    ----------
    name : str
    sees : tuple of str
        The groups of coefficients that it finds by default; all that it can find.
    rates : bool
        Whether it uses gyros.
    plan : callable
        Nominal steps; keyword arguments are the method's own (seconds, angle).
    estimators : mapping
        By name; the first is the default.
    source : str
    """

    name: str
    sees: tuple[str, ...]
    rates: bool
    plan: Callable[..., tuple[Step, ...]]
    estimators: Mapping[str, Estimator]
    source: str

    def prepare(self, sensor: Sensor, coefficients: Sequence[str] = ()) -> Sensor:
        """Return the part of the sensor the method calibrates, with the chosen coefficients.

        Raises
        ------
        InputError
            The sensor lacks axes the method needs, or a coefficient is beyond the method.
        """
        part = sensor if self.rates else sensor.only("f")
        kinds = {axis.measures for axis in part.axes}
        if kinds != ({"f", "w"} if self.rates else {"f"}):
            need = "accelerometers and gyros" if self.rates else "accelerometers"
            raise InputError(f"method {self.name} needs {need}; sensor {sensor.name} lacks them")
        seen = part.with_coefficients(*self.sees)
        if not coefficients:
            return seen
        chosen = part.with_coefficients(*coefficients)
        beyond = [name for name in chosen.coefficients if name not in seen.coefficients]
        if beyond:
            raise InputError(
                f"method {self.name} cannot see {', '.join(beyond)}: it sees {', '.join(self.sees)}"
            )
        return chosen

    def estimator(self, name: str) -> Estimator:
        """Return an estimator by name ("" is the default).

        Raises
        ------
        InputError
            No such estimator; the message lists those there are.
        """
        if name and name not in self.estimators:
            raise InputError(
                f"method {self.name} has no estimator {name!r}; it has {', '.join(self.estimators)}"
            )
        return self.estimators[name or next(iter(self.estimators))]
