"""Simulate a rate platform, which runs through its sections one after another.

Each section begins at the azimuth of its setting, and its rate is constant. The earth's rate
rotates relative to the case while the table turns. The recording omits the time between sections in
the same setting. Between settings, and before each pose, the case is turned over by hand within
three seconds; these samples have no label.
"""

from collections.abc import Sequence

import numpy as np

from inercal.basics.arrays import Array
from inercal.benches.contract import SensorSimulation, SimulatedMotion, concatenate_motions
from inercal.benches.rate_platform.bench import RatePlatform
from inercal.benches.rate_platform.level_rate import level_earth_rate
from inercal.benches.rate_platform.mean_motion import sensed_motion
from inercal.benches.rate_platform.sections import PlatformStep, RateDwell
from inercal.physics.motion import Motion
from inercal.physics.sensors import Sensor

_LEAST = 2  # fewest samples in a section
_HANDLING = 3.0  # s
_TO_AND_FRO = 0.3  # rad
_PARALLEL = 1e-9  # times the product of two specific forces


def simulate_sections(
    bench: RatePlatform,
    steps: Sequence[PlatformStep],
    rate_hz: float,
    rng: np.random.Generator,
    trials: int,
    sensor: Sensor,
    carried: bool,
) -> SensorSimulation:
    """Simulate the motion in each trial, and return it with the sensor.

    Parameters
    ----------
    bench : RatePlatform
        The bench. Its errors are drawn from normal distributions with their stated standard
        deviations.
    steps : sequence of RateDwell or Pose
    rate_hz : float
        Samples per second.
    rng : Generator
    trials : int
        Number of trials, which is the leading axis of the drawn errors and the motion.
    sensor : Sensor
        The sensor, whose axes and coefficients determine which errors act.
    carried : bool
        Not used, because a fixture holds the sensor.

    Raises
    ------
    InputError
        An error of the bench acts but is not stated.
    """
    declared = bench.nuisances(steps, sensor)
    drawn = bench.qualified.draw(declared, rng, trials)
    still = {n: one for n, one in drawn.items() if not n.startswith("earth_")}
    base = sensed_motion(bench, steps, still).motion
    parts: list[Motion] = []
    labels: list[str] = []
    for k, step in enumerate(steps):
        if k and _is_set_anew(steps[k - 1], step):
            turning = _turned_over(base.f[..., k - 1, :], base.f[..., k, :], rate_hz)
            parts.append(turning)
            labels += [""] * turning.w.shape[-2]
        n = max(round(step.seconds * rate_hz), _LEAST)
        f, w = (np.repeat(one[..., k : k + 1, :], n, axis=-2) for one in (base.f, base.w))
        if isinstance(step, RateDwell):
            middle: Array = (np.arange(n, dtype=np.float64) + 0.5) / rate_hz
            w = w + _level_earth_rate(step, drawn, middle)
        parts.append(Motion(f, w))
        labels += [step.label] * n
    time = np.arange(len(labels)) / rate_hz
    done = SimulatedMotion(time, concatenate_motions(parts), np.array(labels), drawn)
    return SensorSimulation(done, sensor)


def _is_set_anew(before: PlatformStep, step: PlatformStep) -> bool:
    """Return whether the case is moved to another setting or pose before a section."""
    if isinstance(before, RateDwell) and isinstance(step, RateDwell):
        return before.place != step.place
    return True


def _turned_over(before: Array, after: Array, rate_hz: float) -> Motion:
    """Return the motion while the case is turned from one specific force to another by hand."""
    n = max(round(_HANDLING * rate_hz), _LEAST)
    s = ((np.arange(n) + 0.5) / n)[:, None]
    first, last = before[:, None], after[:, None]
    axis = np.cross(first, last)
    size = np.linalg.norm(axis, axis=-1, keepdims=True)
    lengths = np.linalg.norm(first, axis=-1, keepdims=True)
    angle = np.arctan2(size, (first * last).sum(axis=-1, keepdims=True))
    aside = np.cross(first, np.eye(3)[int(np.argmin(np.abs(before[0])))])
    axis = np.where(size > _PARALLEL * lengths**2, axis, aside)
    axis = axis / np.linalg.norm(axis, axis=-1, keepdims=True)
    # If the case is taken off and set back in the same attitude, it turns back and forth.
    done = angle * s**3 * (10 - 15 * s + 6 * s**2) + _TO_AND_FRO * np.sin(2 * np.pi * s)
    speed = angle * 30 * s**2 * (1 - s) ** 2 + _TO_AND_FRO * 2 * np.pi * np.cos(2 * np.pi * s)
    along = np.cos(done) * first + np.sin(done) * np.cross(axis, first)
    # In the case frame, the upward direction turns in the opposite sense to the case.
    return Motion(along, -axis * speed * rate_hz / n)


def _level_earth_rate(step: RateDwell, drawn: dict[str, Array], time: Array) -> Array:
    """Return the horizontal earth rate in the case frame, (trials, n, 3) rad/s."""
    parts = [drawn.get(f"earth_{k}[{step.place}]", np.zeros(1)) for k in (1, 2)]
    return np.einsum("naj,jt->tna", level_earth_rate(step, time), np.stack(parts))
