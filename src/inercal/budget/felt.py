"""What each bench makes a sensor feel, step by step, at given errors of the bench.

One row a step, the mean over it: the readings that a calibration would work on, without noise.
"""

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from inercal.benches import (
    Bench,
    Centrifuge,
    DividingHead,
    Hand,
    RateTable,
    Turntable,
    dividing_head,
    rate_table,
)
from inercal.benches.arm import felt_vector
from inercal.benches.hand import felt, tilted
from inercal.errors import InputError
from inercal.motion import Motion
from inercal.parameters import Parameter
from inercal.plan import HandStep, Hold, Index, Position, Rotation, Spin, Step, Turn
from inercal.sensors import Sensor

Array = NDArray[np.float64]
_STEPS: Mapping[type[Bench], tuple[type, ...]] = {
    Hand: (Hold, Turn),
    Centrifuge: (Spin,),
    DividingHead: (Index,),
    RateTable: (Spin,),
    Turntable: (Position, Rotation),
}


def require_possible(bench: Bench, steps: Sequence[Step]) -> None:
    """Refuse a plan that does not say what the sensor feels.

    Raises
    ------
    InputError
        No steps, steps of another bench, or attitudes on the arm that are not known.
    """
    if isinstance(bench, Turntable):
        raise InputError(
            "a budget is of means, and a turntable's filters follow every sample: inercal plan "
            "turntable-kalman says what a path gives"
        )
    if not steps:
        raise InputError("a budget needs a plan; this one has no steps")
    if not all(isinstance(step, _STEPS[type(bench)]) for step in steps):
        raise InputError("the plan's steps are for another bench than the one that is stated")
    if isinstance(bench, Centrifuge) and bench.platform != "locked":
        raise InputError(
            "a budget of a counter-rotating platform is not there: simulate its runs instead"
        )
    if any(isinstance(step, Spin) and step.attitude is None for step in steps):
        raise InputError(
            "a budget needs a plan with attitudes ([method] attitudes and rates): a table of means "
            "does not say in which ones it was taken"
        )


def parameters(bench: Bench, steps: Sequence[Step], sensor: Sensor) -> dict[str, Parameter]:
    """Return the bench's parameters that act on these steps, by full name.

    Parameters
    ----------
    bench, steps
        As `require_possible` lets pass.
    sensor : Sensor
    """
    if isinstance(bench, Centrifuge):
        spins = [step for step in steps if isinstance(step, Spin)]
        return bench.nuisances(spins, vectors=True, dwells=True)
    if isinstance(bench, DividingHead):
        return bench.nuisances(_indexed(steps), sensor.channels)
    if isinstance(bench, RateTable):
        return bench.nuisances(_spun(steps))
    if isinstance(bench, Turntable):
        return bench.nuisances()
    rates = any(axis.measures == "w" for axis in sensor.axes)
    return bench.nuisances([step for step in steps if isinstance(step, Hold | Turn)], rates=rates)


def _spun(steps: Sequence[Step]) -> list[Spin]:
    return [step for step in steps if isinstance(step, Spin)]


def _indexed(steps: Sequence[Step]) -> list[Index]:
    return [step for step in steps if isinstance(step, Index)]


def motion(bench: Bench, steps: Sequence[Step], q: Mapping[str, Array]) -> Motion:
    """Return the mean motion of each of r steps, f and ω (..., r, 3).

    Parameters
    ----------
    bench, steps
        As `require_possible` lets pass.
    q : mapping of str to (...) array
        The bench's parameters by full name, SI; `parameters` lists them.
    """
    if isinstance(bench, Centrifuge):
        made = felt_vector(bench, [step for step in steps if isinstance(step, Spin)], q)
        return Motion(made.f, made.w)
    if isinstance(bench, DividingHead):
        return Motion(dividing_head.felt(bench, _indexed(steps), q).f)
    if isinstance(bench, RateTable):
        return Motion(rate_table.felt(bench, _spun(steps), q).f)
    rows = [
        felt(step, step.seconds, _with_force(step, q))
        for step in steps
        if isinstance(step, Hold | Turn)
    ]
    whole = np.broadcast_arrays(*(row.f for row in rows), *(row.w for row in rows))
    return Motion(np.stack(whole[: len(rows)], axis=-2), np.stack(whole[len(rows) :], axis=-2))


def drift(bench: Bench, steps: Sequence[Step], sensor: Sensor, q: Mapping[str, Array]) -> Array:
    """Return what biases have drifted by at each step, (..., r, m) m/s²; 0 where none does."""
    if not isinstance(bench, DividingHead):
        return np.zeros(())
    return dividing_head.drifted(_indexed(steps), sensor.channels, q)


def _with_force(step: HandStep, q: Mapping[str, Array]) -> Mapping[str, Array]:
    """Return q with the mean specific force of a turn: gravity along the axis, which stands up."""
    if isinstance(step, Hold):
        return q
    zero = np.zeros(())
    pair = [q.get(f"axis{k}[{step.label}]", zero) for k in (1, 2)]
    force = q["g"][..., None] * tilted(step.axis, np.stack(np.broadcast_arrays(*pair), -1))[0]
    return {**q, **{f"force_{a}[{step.label}]": force[..., k] for k, a in enumerate("xyz")}}
