"""The contract of every bench: its imperfections as data, and the mean motion of its steps.

A bench is a frozen dataclass of the stated values, in SI. Methods, budgets, plans and reports use
nothing of a bench but these types.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import Field, dataclass, field
from math import inf
from typing import Any, ClassVar, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from inercal.basics.arrays import Array
from inercal.basics.errors import InputError
from inercal.basics.parameters import Parameter
from inercal.basics.units import Measured
from inercal.estimation.lazy_value import LazyMapping, LazyValue
from inercal.physics.motion import Motion
from inercal.physics.sensors import Sensor

_Derivatives = Callable[[], tuple[Mapping[str, Array], Mapping[str, Array]]]  # of f and of ω


class Bench(Protocol):
    """A bench as stated: a dataclass, so that `dataclasses.replace` changes a stated value."""

    __dataclass_fields__: ClassVar[dict[str, Field[Any]]]

    @property
    def gravity(self) -> Measured:
        """Local gravity, m/s²."""
        ...

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """The imperfections, as data."""
        ...

    def nuisances(self, steps: Sequence[Any], sensor: Sensor) -> Mapping[str, Parameter]:
        """Return the parameters that act on these steps, by full name such as "pose_x[XY30]".

        An estimator counts those of scope "dwell" as noise; those of `Parameter.attitude` act on
        no norm of readings.

        Parameters
        ----------
        steps : sequence of Step
            Of the types that the bench carries out.
        sensor : Sensor
            Its axes are what is observed: without gyros, parameters that act only on rates are
            omitted.
        """
        ...


@dataclass(frozen=True, eq=False)
class MeanMotion:
    """The mean motion of each of r steps, with derivatives.

    Parameters
    ----------
    motion : Motion
        f, m/s², and ω, rad/s, in the sensor's frame, (..., r, 3); leading axes are trials.
    df, dw : mapping of str to (..., r, 3) array
        ∂f and ∂ω by the bench's errors, by full name; those missing are zero.
    """

    motion: Motion
    df: Mapping[str, Array] = field(default_factory=dict[str, Array])
    dw: Mapping[str, Array] = field(default_factory=dict[str, Array])

    @classmethod
    def with_lazy_derivatives(cls, motion: Motion, derivatives: _Derivatives) -> "MeanMotion":
        """Return a motion whose df and dw are worked out when they are read.

        A simulation of many trials reads the motion only, which takes a quarter of the time.
        """
        both = LazyValue(derivatives)
        return cls(motion, LazyMapping(lambda: both()[0]), LazyMapping(lambda: both()[1]))

    @property
    def f(self) -> Array:
        """Mean specific force, (..., r, 3) m/s²."""
        return self.motion.f

    @property
    def w(self) -> Array:
        """Mean angular rate, (..., r, 3) rad/s."""
        return self.motion.w


@runtime_checkable
class MeanBench(Bench, Protocol):
    """A bench of which each step gives one mean reading: a hand, an arm, a head, a rate table."""

    def mean_motion(self, steps: Sequence[Any], q: Mapping[str, Array]) -> MeanMotion:
        """Return the mean motion of each of r steps.

        Parameters
        ----------
        steps : sequence of r Step
        q : mapping of str to (...) array
            Errors by full name, SI; those missing are as stated.

        Raises
        ------
        InputError
            A step whose attitude is not known.
        """
        ...

    def reading_offsets(
        self, steps: Sequence[Any], sensor: Sensor, q: Mapping[str, Array]
    ) -> Array:
        """Return what errors of the bench add to the readings, (..., r, m) SI, or a zero, ().

        Parameters
        ----------
        steps, q
            As of `mean_motion`.
        sensor : Sensor
            Of m axes.
        """
        ...


def require_possible_values(
    bench: str, positive: Mapping[str, float], deviations: Mapping[str, float]
) -> None:
    """Refuse values of a bench that no bench can have.

    Parameters
    ----------
    bench : str
        What the message begins with, "rate table".
    positive, deviations : mapping of str to float
        Values that must be > 0, and standard deviations, which must be >= 0, by name.

    Raises
    ------
    InputError
        Its `key` is the name of the first value that is not possible.
    """
    for name, value in positive.items():
        if not 0 < value < inf:
            raise InputError(f"{bench}: {name} is {value:g}; it must be greater than 0", key=name)
    for name, sd in deviations.items():
        if not 0 <= sd < inf:
            text = f"the standard deviation of {name} is {sd:g}; it must be 0 or greater"
            raise InputError(f"{bench}: {text}", key=name)


def concatenate_motions(parts: Sequence[Motion]) -> Motion:
    """Return f and ω of consecutive motions, (trials, n, 3) each, as one motion."""
    f, w = ([getattr(part, name) for part in parts] for name in ("f", "w"))
    return Motion(np.concatenate(f, axis=-2), np.concatenate(w, axis=-2))


@dataclass(frozen=True, eq=False)
class SimulatedMotion:
    """A plan carried out in simulation.

    Parameters
    ----------
    time : (n,) array
        s, by the recording's clock.
    motion : Motion
        f and ω in the sensor's frame, (trials, n, 3).
    labels : (n,) array of str
        The step of each sample; empty between steps.
    bench_errors : mapping of str to (trials,) array
        The bench's errors, SI, by full name.
    readback : mapping of str to (n,) or (trials, n) array
        Readback of the bench, SI.
    """

    time: Array
    motion: Motion
    labels: NDArray[np.str_]
    bench_errors: dict[str, Array]
    readback: Mapping[str, Array] = field(default_factory=dict[str, Array])


@dataclass(frozen=True, eq=False)
class SensorSimulation:
    """A simulation of a sensor on a bench.

    Parameters
    ----------
    simulated_motion : SimulatedMotion
    sensor : Sensor
        With the noise that the caller has still to draw.
    drift : (..., n, m) array or None
        Of its biases, SI, where the simulation of the bench draws it.
    """

    simulated_motion: SimulatedMotion
    sensor: Sensor
    drift: Array | None = None


def stack_derivatives(
    rows: Sequence[Mapping[str, Array]], shape: tuple[int, ...]
) -> dict[str, Array]:
    """Return the derivatives of r steps as arrays (..., r, 3), by full name.

    Parameters
    ----------
    rows : sequence of r mappings of str to (..., 3) array
        A name that a row lacks is zero there.
    shape : tuple of int
        (..., 3), of one row.
    """
    result: dict[str, Array] = {}
    for k, row in enumerate(rows):
        for name, value in row.items():
            if name not in result:
                result[name] = np.zeros((*shape[:-1], len(rows), shape[-1]))
            result[name][..., k, :] = value
    return result
