"""Interface for a host that drives a plain rate table, with the sensed motion at each instant.

A run goes through one mounting after another; in each mounting, the table starts at rest, and the
fastest rate comes last. With the symbols of `inercal.benches.rate_table.simulation`, and with the
actual rate, azimuth and acceleration of the axis, the sensor senses::

    f = exp(φ) ((R + s) (−ω² out − ω' along) + g (√(1 − λ²) up − λ₁(α) out + λ₂(α) along))

ω is the rate read back times 1 + ρ + σ, where σ is interpolated between the set rates. The lean of
the axis has one fixed direction in the room, given by the lean of the first rest at the azimuth 0.
"""

from collections.abc import Mapping, Sequence
from itertools import pairwise

import numpy as np

from inercal.basics.arrays import Array
from inercal.benches.arm import outward_and_up_directions
from inercal.benches.motion_control import MotionControl, SensedMotion, SpinTask
from inercal.benches.rate_table.bench import RateTable, mounting_names, speed_names
from inercal.benches.rate_table.fixture import PLANES, group_by_mounting, is_tilted
from inercal.benches.rate_table.simulation import rotate_horizontal
from inercal.physics.frames import exp_so3
from inercal.physics.plan import Hold, Spin

_SETTLING_SECONDS = 0.25


def spin_tasks(bench: RateTable, steps: Sequence[Spin]) -> tuple[SpinTask, ...]:
    """Return the states in the order of a run, each with its mounting.

    Raises
    ------
    InputError
        The attitude of a step is not known.
    """
    outward_and_up_directions(steps)
    named = dict(zip((step.attitude for step in steps), mounting_names(steps), strict=True))
    result: list[SpinTask] = []
    for own in group_by_mounting(steps):
        name = named[own[0].attitude]
        words = f"mount the sensor as {name}: {_describe_mounting(own[0])}"
        for before, step in pairwise((None, *own)):
            assert step is not None
            change = abs(step.rate - (before.rate if before else 0.0))
            approach = change / bench.limits.acceleration
            result.append(SpinTask(step.label, step.rate, step.seconds, approach, name, words))
    return tuple(result)


def _describe_mounting(step: Spin) -> str:
    """Describe which axis is up and which is toward the centre, before the tilt if there is one."""
    assert step.attitude is not None
    up, plane = Hold("", step.attitude.up, 0.0).describe(), PLANES.get(step.attitude.name[:2])  # pyright: ignore[reportArgumentType, reportCallIssue]
    if plane is None:
        return up
    if is_tilted(step):
        return f"{up}; before the tilt {plane[0]} is toward the centre and {plane[1]} up"
    return f"{up}, {plane[0]} toward the centre"


def _motion_at_instants(
    bench: RateTable, steps: Sequence[Spin], values: Mapping[str, float]
) -> SensedMotion:
    """Return a function for the motion sensed on a rate table; see `MotionControl`."""
    speeds = dict(zip((abs(step.rate) for step in steps), speed_names(steps), strict=True))
    rates = sorted({0.0, *speeds})
    off = np.array([values.get(f"speed[{speeds.get(rate, '')}]", 0.0) for rate in rates])
    rests = [step.label for step in steps if step.rate == 0]
    lean = np.array([values[f"lean_{k}[{rests[0]}]"] if rests else 0.0 for k in (1, 2)])
    bodies: dict[str, tuple[Array, float]] = {}
    for name, step in zip(mounting_names(steps), steps, strict=True):
        (out,), (up,) = outward_and_up_directions([step])
        pose = np.array([values[f"pose_{axis}[{name}]"] for axis in "xyz"])
        body = exp_so3(pose) @ np.stack([-out, np.cross(up, -out), up], axis=-1)
        bodies[name] = body, values.get("radius", 0.0) + values.get(f"seat[{name}]", 0.0)
    first = next(iter(bodies))
    g, common, upward = values["g"], values.get("rate", 0.0), float(np.sqrt(1 - lean @ lean))

    def sensed(moved: Array, mounting: str) -> Array:
        body, radius = bodies[mounting or first]
        azimuth, rate, acceleration = moved[:, 0].T
        factor = 1 + common + np.asarray(np.interp(np.abs(rate), rates, off), dtype=np.float64)
        w, dw = rate * factor, acceleration * factor
        swing = rotate_horizontal(lean, azimuth)
        f = np.stack(
            [
                radius * w**2 + g * swing[:, 0],
                -radius * dw + g * swing[:, 1],
                np.full(len(moved), g * upward),
            ],
            axis=-1,
        )
        axis = body[:, 2]
        return np.concatenate([f @ body.T, w[:, None] * axis, dw[:, None] * axis], axis=-1)

    return sensed


MOTION_CONTROL = MotionControl(
    tasks=spin_tasks,
    readback=lambda bench: ("arm_rate",),
    quantity="rate",
    required_keys={"time": '"time"', "rate": '"50 Hz"'},
    settling=lambda bench: _SETTLING_SECONDS,
    errors=RateTable.acting_parameters,
    sensed_motion=_motion_at_instants,
)
