"""The steps of a plan on a turntable in absolute angles, so that a host can repeat a step.

After an outage the host repeats the interrupted step from its beginning. A `Rotation` is relative
to the current angle of the table. A task therefore states absolute angles, which are cumulative
over turns and counted from the zero found by homing.
"""

from collections.abc import Mapping, Sequence
from operator import attrgetter

import numpy as np

from inercal.basics.arrays import Array
from inercal.benches.motion_control import Angles, MotionControl, SensedMotion, TurnTask
from inercal.benches.turntable.attitude import true_attitude
from inercal.benches.turntable.bench import Turntable
from inercal.benches.turntable.rest_timing import settling_time
from inercal.benches.turntable.simulation import path_profile
from inercal.physics.earth import earth_rate_up_north
from inercal.physics.plan import Rotation, Step, TableStep, table_steps


def plan_tasks(bench: Turntable, steps: Sequence[TableStep]) -> tuple[TurnTask, ...]:
    """Return the steps in absolute angles, starting with all axes at zero.

    Raises
    ------
    InputError
        `inercal.benches.turntable.simulation.path_profile` refuses the steps.
    """
    way = path_profile(bench, steps)
    angles: list[list[float]] = way.evaluate(way.ends)[0].tolist()
    ends: list[float] = way.ends.tolist()
    result: list[TurnTask] = []
    now: Angles = (0.0,) * len(bench.axes)
    at, approach, coming = 0.0, 0.0, iter(steps)
    for label, end, there in zip(way.labels, ends, map(tuple, angles), strict=True):
        if label:
            step = next(coming)
            rate = step.rate if isinstance(step, Rotation) else 0.0
            result.append(TurnTask(label, now, there, rate, end - at, approach))
            approach = 0.0
        else:
            approach = end - at
        now, at = there, end
    return tuple(result)


def sensed_motion(
    bench: Turntable, steps: Sequence[Step], values: Mapping[str, float]
) -> SensedMotion:
    """Return a function for the motion sensed on a turntable with errors; see `MotionControl`."""
    # Numba is loaded for the first simulation, not for each run file.
    from inercal.benches.turntable import _sensed_kernel as kernel

    k = len(bench.axes)
    up, north = earth_rate_up_north(bench.latitude)
    letters = np.array(["xyz".index(a) for a in bench.axes])
    squares = np.array([values[f"square_{i + 1}"] for i in range(k - 1)], dtype=np.float64)
    # With right angles and zero angles, the attitude is that of the base.
    level = {name: np.asarray(values[name]) for name in ("lean_x", "lean_y", "azimuth")}
    level |= {f"square_{i + 1}": np.zeros(()) for i in range(k - 1)}
    arguments = (
        letters,
        3 - letters[:-1] - letters[1:],
        squares,
        np.ascontiguousarray(true_attitude(bench, np.zeros((1, k)), level)[0]),
        np.array([0.0, north, up]),
        values["g"],
        np.array([values[f"lever_{a}"] for a in "xyz"]),
    )

    def sensed(moved: Array, mounting: str) -> Array:
        out = np.empty((len(moved), 9))
        kernel.sensed_motion(moved, *arguments, out)
        return out

    return sensed


MOTION_CONTROL = MotionControl(
    tasks=lambda bench, steps: plan_tasks(bench, table_steps(steps)),
    readback=attrgetter("names"),
    quantity="angle",
    required_keys={"time": '"time"', "rate": '"200 Hz"', "label": '"step"', "hold": '"hold"'},
    settling=settling_time,
    errors=lambda bench, steps: bench.acting_parameters(),
    sensed_motion=sensed_motion,
)
