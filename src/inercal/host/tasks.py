"""The steps of a plan with absolute angles, so that the host can repeat a step.

After an outage the host repeats the interrupted step from its beginning. A `Rotation` is relative
to the present angle of the table; a `Task` states that angle, cumulative over turns, from the zero
of homing.
"""

from collections.abc import Sequence
from dataclasses import dataclass

from inercal.benches.turntable.bench import Turntable
from inercal.benches.turntable.simulation import path_profile
from inercal.plan import Rotation, TableStep

Angles = tuple[float, ...]


@dataclass(frozen=True)
class Task:
    """One step of a plan.

    Parameters
    ----------
    label : str
        Of the section that it leaves.
    start, end : tuple of float
        Angles of all axes, outermost first, rad: brought there first; there when it is done.
    rate : float
        rad/s of the turn from start to end; 0 of a stay.
    seconds : float
        Length of the section; a turn's is what its limits make of it.
    approach : float
        How long the way to `start` takes from the step before, s.
    """

    label: str
    start: Angles
    end: Angles
    rate: float
    seconds: float
    approach: float


def plan_tasks(bench: Turntable, steps: Sequence[TableStep]) -> tuple[Task, ...]:
    """Return the steps made absolute, from all axes at zero.

    Raises
    ------
    InputError
        As `inercal.benches.turntable.simulation.path_profile`.
    """
    way = path_profile(bench, steps)
    angles: list[list[float]] = way.evaluate(way.ends)[0].tolist()
    ends: list[float] = way.ends.tolist()
    result: list[Task] = []
    now: Angles = (0.0,) * len(bench.axes)
    at, approach, coming = 0.0, 0.0, iter(steps)
    for label, end, there in zip(way.labels, ends, map(tuple, angles), strict=True):
        if label:
            step = next(coming)
            rate = step.rate if isinstance(step, Rotation) else 0.0
            result.append(Task(label, now, there, rate, end - at, approach))
            approach = 0.0
        else:
            approach = end - at
        now, at = there, end
    return tuple(result)
