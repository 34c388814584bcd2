"""What every bench offers: its imperfections as data, and the mean motion that it makes.

A bench is a frozen dataclass of what is stated of it, in SI. Methods, budgets, plans and reports
know no more of it than stands here.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import Field, dataclass, field
from pathlib import Path
from typing import Any, ClassVar, Generic, Protocol, TypeVar, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from inercal.motion import Motion
from inercal.parameters import Parameter
from inercal.sensors import Sensor
from inercal.settings import BenchSection
from inercal.units import Measured

Array = NDArray[np.float64]


class Bench(Protocol):
    """A bench as stated: a dataclass, so that `dataclasses.replace` states it otherwise."""

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

        Those of scope "dwell" are noise to an estimation; those of `Parameter.attitude` act on no
        norm of readings.

        Parameters
        ----------
        steps : sequence of Step
            Of the kinds that the bench carries out.
        sensor : Sensor
            Its axes say what is observed: without gyros what acts on rates alone is left out.
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


B = TypeVar("B", bound=Bench)


@runtime_checkable
class MeanBench(Bench, Protocol):
    """A bench whose steps are each one mean reading: a hand, an arm, a head, a table at a rate."""

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
        """Return what errors add to the readings themselves, (..., r, m) SI, or a zero, ().

        Parameters
        ----------
        steps, q
            As of `mean_motion`.
        sensor : Sensor
            Of m axes.
        """
        ...


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
    drawn : mapping of str to (trials,) array
        The bench's errors, SI, by full name.
    readback : mapping of str to (n,) or (trials, n) array
        What the bench reads back, SI.
    """

    time: Array
    motion: Motion
    labels: NDArray[np.str_]
    drawn: dict[str, Array]
    readback: Mapping[str, Array] = field(default_factory=dict[str, Array])


@dataclass(frozen=True, eq=False)
class Simulated:
    """A simulation of a sensor on a bench.

    Parameters
    ----------
    done : SimulatedMotion
    sensor : Sensor
        With the noise that is still to be drawn.
    drift : (..., n, m) array or None
        Of its biases, SI, drawn by the bench's part of the simulation.
    """

    done: SimulatedMotion
    sensor: Sensor
    drift: Array | None = None


@dataclass(frozen=True)
class Effect:
    """A known effect that a bench corrects for.

    Parameters
    ----------
    name : str
    field : str
        Of the bench, that holds its value.
    absent : Measured or float
        The field's value without the effect.
    unit, per : str and float
        The value as printed: unit, and how many of it one SI unit is.
    on_rates : bool
        Whether gyros alone feel it.
    """

    name: str
    field: str
    absent: Measured | float
    unit: str
    per: float
    on_rates: bool = False


@dataclass(frozen=True)
class Vocabulary:
    """What reports and messages call things on a kind of bench.

    Parameters
    ----------
    row : str
        One row of the observations, "state or mounting".
    turner : str
        What turns the sensor, "table".
    rows : str
        The rows at rates, "states".
    """

    row: str = "position or turn"
    turner: str = "arm"
    rows: str = "rows"


def _possible(bench: Bench, steps: Sequence[Any]) -> str:
    return ""


@dataclass(frozen=True)
class Kind(Generic[B]):
    """A kind of bench: all that the rest of the package knows of it.

    Parameters
    ----------
    name : str
        [bench] kind.
    bench : type
        A dataclass, `Bench`.
    section : type
        [bench] of a run file, a `BenchSection` with the key `kind`.
    build : callable
        From the section, and the folder in which files lie that it names, to the bench.
    steps : tuple of type
        The kinds of steps that it carries out.
    simulate : callable
        From bench, steps, samples per second, generator, number of trials, sensor, and whether the
        sensor stays in the hand between steps.
    seconds : callable
        How long steps last at most, s.
    words : Vocabulary
    effects : tuple of Effect
        That a budget lists.
    refuses_budget : callable
        Returns why a budget of a plan is not possible; "" where it is.
    """

    name: str
    bench: type[B]
    section: type[BenchSection]
    build: Callable[[Any, Path], B]
    steps: tuple[type, ...]
    simulate: Callable[[B, Sequence[Any], float, np.random.Generator, int, Sensor, bool], Simulated]
    seconds: Callable[[B, Sequence[Any]], float]
    words: Vocabulary = Vocabulary()
    effects: tuple[Effect, ...] = ()
    refuses_budget: Callable[[B, Sequence[Any]], str] = _possible


def stacked(rows: Sequence[Mapping[str, Array]], shape: tuple[int, ...]) -> dict[str, Array]:
    """Return derivatives of all r steps, (..., r, 3), from those of each, by full name.

    Parameters
    ----------
    rows : sequence of r mappings of str to (..., 3) array
        A name that a row lacks is zero there.
    shape : tuple of int
        (..., 3), of one row.
    """
    names = dict.fromkeys(name for row in rows for name in row)
    nothing = np.zeros(shape)
    return {
        name: np.stack([np.broadcast_to(row.get(name, nothing), shape) for row in rows], axis=-2)
        for name in names
    }
