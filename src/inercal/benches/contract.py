"""Define what every bench must provide: its imperfections, and the mean motion of its steps.

A bench is a frozen dataclass of the stated values, in SI. Methods, budgets, plans and reports use
a bench only through these types.
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
    """A bench: a dataclass of stated values, which `dataclasses.replace` can change."""

    __dataclass_fields__: ClassVar[dict[str, Field[Any]]]

    @property
    def gravity(self) -> Measured:
        """Local gravity, m/s²."""
        ...

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """The imperfections of the bench, as data."""
        ...

    def nuisances(self, steps: Sequence[Any], sensor: Sensor) -> Mapping[str, Parameter]:
        """Return the parameters that act on these steps, by full name such as "pose_x[XY30]".

        An estimator treats parameters with the scope "dwell" as noise. Parameters whose
        `Parameter.attitude` is true do not change the norm of the readings.

        Parameters
        ----------
        steps : sequence of Step
            Steps of the types that the bench carries out.
        sensor : Sensor
            The sensor on the bench. If it has no gyros, parameters that act only on rates are
            omitted.
        """
        ...


@dataclass(frozen=True, eq=False)
class MeanMotion:
    """The mean motion during each of r steps, and its derivatives for the bench's errors.

    Parameters
    ----------
    motion : Motion
        f in m/s² and ω in rad/s, in the sensor's frame, (..., r, 3); leading axes are trials.
    df, dw : mapping of str to (..., r, 3) array
        Derivatives of f and ω with respect to the bench's errors, by the full name of the error. A
        missing derivative is zero.
    """

    motion: Motion
    df: Mapping[str, Array] = field(default_factory=dict[str, Array])
    dw: Mapping[str, Array] = field(default_factory=dict[str, Array])

    @classmethod
    def with_lazy_derivatives(cls, motion: Motion, derivatives: _Derivatives) -> "MeanMotion":
        """Return a motion whose df and dw are computed when they are first read.

        A simulation of many trials reads only the motion and therefore takes a quarter of the time.
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
    """A bench on which each step gives one mean reading, such as a hand or a rate table."""

    def mean_motion(self, steps: Sequence[Any], q: Mapping[str, Array]) -> MeanMotion:
        """Return the mean motion during each of r steps.

        Parameters
        ----------
        steps : sequence of r Step
        q : mapping of str to (...) array
            Values of errors, SI, by full name. A missing error keeps its stated value.

        Raises
        ------
        InputError
            The attitude of a step is not known.
        """
        ...

    def reading_offsets(
        self, steps: Sequence[Any], sensor: Sensor, q: Mapping[str, Array]
    ) -> Array:
        """Return the offsets that the bench's errors add to the readings.

        The array has the shape (..., r, m), in SI, or is a zero of shape () if there are none.

        Parameters
        ----------
        steps, q
            The same as for `mean_motion`.
        sensor : Sensor
            The sensor, with m axes.
        """
        ...


class NoReadingOffsets:
    """The base of a bench on which no error adds an offset to the readings."""

    def reading_offsets(
        self, steps: Sequence[Any], sensor: Sensor, q: Mapping[str, Array]
    ) -> Array:
        """Return zero."""
        return np.zeros(())


def require_possible_values(
    bench: str, positive: Mapping[str, float], deviations: Mapping[str, float]
) -> None:
    """Refuse physically impossible values for a bench.

    Parameters
    ----------
    bench : str
        Start of the message, such as "rate table".
    positive, deviations : mapping of str to float
        Values that must be > 0 and standard deviations that must be >= 0, by name.

    Raises
    ------
    InputError
        A value is impossible. The error's `key` is the name of the first such value.
    """
    for name, value in positive.items():
        if not 0 < value < inf:
            raise InputError(f"{bench}: {name} is {value:g}; it must be greater than 0", key=name)
    for name, sd in deviations.items():
        if not 0 <= sd < inf:
            text = f"the standard deviation of {name} is {sd:g}; it must be 0 or greater"
            raise InputError(f"{bench}: {text}", key=name)


def concatenate_motions(parts: Sequence[Motion]) -> Motion:
    """Join consecutive motions, whose f and ω have the shape (trials, n, 3), into one motion."""
    f, w = ([getattr(part, name) for part in parts] for name in ("f", "w"))
    return Motion(np.concatenate(f, axis=-2), np.concatenate(w, axis=-2))


@dataclass(frozen=True, eq=False)
class SimulatedMotion:
    """The motion of the sensor during a simulated plan.

    Parameters
    ----------
    time : (n,) array
        Time of each sample on the recording's clock, s.
    motion : Motion
        f and ω in the sensor's frame, (trials, n, 3).
    labels : (n,) array of str
        Label of the step to which each sample belongs; empty between steps.
    bench_errors : mapping of str to (trials,) array
        Simulated errors of the bench, SI, by full name.
    readback : mapping of str to (n,) or (trials, n) array
        Readback that the bench records, SI.
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
        The sensor, with the noise that the caller still has to draw.
    drift : (..., n, m) array or None
        Drift of the sensor's biases, SI, if the simulation of the bench draws it.
    """

    simulated_motion: SimulatedMotion
    sensor: Sensor
    drift: Array | None = None


def stack_derivatives(
    rows: Sequence[Mapping[str, Array]], shape: tuple[int, ...]
) -> dict[str, Array]:
    """Stack the derivatives of r steps into one array (..., r, 3) per full name.

    Parameters
    ----------
    rows : sequence of r mappings of str to (..., 3) array
        Derivatives of each step. A name that is missing in a step gives zeros there.
    shape : tuple of int
        Shape of the derivatives of one step, (..., 3).
    """
    result: dict[str, Array] = {}
    for k, row in enumerate(rows):
        for name, value in row.items():
            if name not in result:
                result[name] = np.zeros((*shape[:-1], len(rows), shape[-1]))
            result[name][..., k, :] = value
    return result
