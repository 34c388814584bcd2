"""Simulate a rate table: as in a recording, one mounting follows another.

In each mounting the table rests at a random azimuth, then turns at the mounting's speeds from the
slowest to the fastest, and stops. The symbols are those of `inercal.benches.rate_table.bench`. With
the azimuth α relative to the rest, the acceleration ω' of the table and along = up × (−out), the
sensor senses::

    f = exp(φ) ((R + s) (−ω² out − ω' along) + g (√(1 − λ²) up − λ₁(α) out + λ₂(α) along))

The lean has a fixed direction in the room, so (λ₁, λ₂) rotates by −α and varies as a sine once per
turn. Between two speeds the rate follows 3s² − 2s³, with the largest acceleration half way.

Samples are labelled with the name of the mounting. The recording omits the time for remounting.
The table reads back the commanded rate; the error of the true rate is random.
"""

from collections.abc import Mapping, Sequence
from math import pi

import numpy as np

from inercal.basics.arrays import Array
from inercal.benches.arm import outward_and_up_directions
from inercal.benches.contract import SimulatedMotion, concatenate_motions
from inercal.benches.rate_table.bench import RateTable, mounting_names, speed_names
from inercal.benches.rate_table.fixture import group_by_mounting
from inercal.physics.frames import exp_so3
from inercal.physics.motion import Motion
from inercal.physics.plan import Spin

SPIN_UP = 2.0  # rad/s², largest acceleration
_SETTLING = 2.0  # s at a speed, or at rest, in addition to the dwell in the plan
_IDLE = 1.0  # s at rest before and after, which is too short for a state


def simulate_table_motion(
    bench: RateTable,
    steps: Sequence[Spin],
    rate_hz: float,
    rng: np.random.Generator,
    trials: int = 1,
) -> SimulatedMotion:
    """Simulate the motion in each trial, and the readback "arm_rate", (n,) rad/s.

    Parameters
    ----------
    bench : RateTable
        The bench. Its parameters are drawn from normal distributions with their stated standard
        deviations. One lean per trial and a random azimuth for each rest are drawn, so that the
        lean in each rest has its stated standard deviation.
    steps : sequence of Spin
        Steps whose attitudes are known. Mountings are in the order of their first steps.
    rate_hz : float
        Samples per second.
    rng : Generator
    trials : int
        Number of trials, which is the leading axis of the drawn errors and the motion.

    Raises
    ------
    InputError
        The attitude of a step is not known.
    """
    declared = bench.acting_parameters(steps)
    drawn = bench.qualified.draw(declared, rng, trials)
    tilts = bench.lean * rng.standard_normal((trials, 2))
    named = dict(zip((step.attitude for step in steps), mounting_names(steps), strict=True))
    set_to = dict(zip((step.rate for step in steps), speed_names(steps), strict=True))
    off = {rate: drawn.get(f"speed[{speed}]", np.zeros(trials)) for rate, speed in set_to.items()}
    parts: list[Motion] = []
    commanded: list[Array] = []
    labels: list[str] = []
    for own in group_by_mounting(steps):
        lean = rotate_horizontal(tilts, rng.uniform(0, 2 * pi, trials))
        for step in own:
            if step.rate == 0:
                drawn |= {f"lean_{k + 1}[{step.label}]": lean[:, k] for k in (0, 1)}
        profile = _profile(own, off, rate_hz)
        name = named[own[0].attitude]
        parts.append(_sensed_motion(bench, own[0], name, drawn, profile, lean, rate_hz))
        commanded.append(profile[0])
        labels += [name] * profile[0].size
    time = np.arange(len(labels)) / rate_hz
    readback = {"arm_rate": np.concatenate(commanded)}
    return SimulatedMotion(time, concatenate_motions(parts), np.array(labels), drawn, readback)


def table_plan_duration(bench: RateTable, steps: Sequence[Spin]) -> float:
    """Return the duration of these steps, from the first mounting's rest to the last one's, s."""
    return sum(
        _IDLE * 2 + sum(step.seconds + _SETTLING for step in own) + sum(_ramp_durations(own))
        for own in group_by_mounting(steps)
    )


def _ramp_durations(steps: Sequence[Spin]) -> list[float]:
    """Return the duration of each ramp between speeds, from rest and back to rest, s."""
    rates = [0.0, *(step.rate for step in steps), 0.0]
    return (1.5 * np.abs(np.diff(rates)) / SPIN_UP).tolist()


def _profile(
    steps: Sequence[Spin], off: Mapping[float, Array], rate_hz: float
) -> tuple[Array, Array, Array]:
    """Return the commanded rate, its derivative, and the ratio of true to commanded rate.

    All three belong to one mounting. Rate and derivative are (n,). The ratio, (trials, n), changes
    between speeds in the same way as the rate. `off` is the relative error of each rate, (trials,).
    """
    rest = round(_IDLE * rate_hz)
    still = np.zeros(rest)
    rates = [0.0, *(step.rate for step in steps), 0.0]
    factors = [1 + off[step.rate] for step in (steps[0], *steps, steps[-1])]
    pieces: list[tuple[Array, Array, Array]] = [(still, still, _repeat_factor(factors[0], rest))]
    for k, length in enumerate(_ramp_durations(steps)):
        n = round(length * rate_hz)
        s = (np.arange(n) + 0.5) / max(n, 1)
        share, change = 3 * s**2 - 2 * s**3, rates[k + 1] - rates[k]
        slope = 6 * s * (1 - s) * rate_hz / max(n, 1)
        before, after = factors[k][:, None], factors[k + 1][:, None]
        pieces.append(
            (rates[k] + change * share, change * slope, before + (after - before) * share)
        )
        if k < len(steps):
            hold = round((_SETTLING + steps[k].seconds) * rate_hz)
            level = np.full(hold, rates[k + 1])
            pieces.append((level, np.zeros(hold), _repeat_factor(factors[k + 1], hold)))
    pieces.append((still, still, _repeat_factor(factors[-1], rest)))
    commanded, slope, factor = (
        np.concatenate([piece[k] for piece in pieces], axis=-1) for k in range(3)
    )
    return commanded, slope, factor


def _repeat_factor(factor: Array, n: int) -> Array:
    return np.repeat(factor[:, None], n, axis=1)


def _sensed_motion(
    bench: RateTable,
    step: Spin,
    name: str,
    drawn: Mapping[str, Array],
    profile: tuple[Array, Array, Array],
    lean: Array,
    rate_hz: float,
) -> Motion:
    """Return f and ω in one mounting, (trials, n, 3); the lean is (trials, 2)."""
    commanded, slope, factor = profile
    nothing: Array = np.zeros(len(lean))
    common = drawn.get("rate", nothing)[:, None]
    rate = commanded * (factor + common)
    azimuth = np.cumsum(rate, axis=-1) / rate_hz
    radius = drawn.get("radius", nothing + bench.radius.value)[:, None]
    radius = radius + drawn.get(f"seat[{name}]", nothing)[:, None]
    g = drawn["g"][:, None]
    swing = rotate_horizontal(lean[:, None], azimuth)
    inwards = radius * rate**2 + g * swing[..., 0]
    forwards = -radius * slope * (factor + common) + g * swing[..., 1]
    upwards = np.broadcast_to(g * np.sqrt(1 - (lean**2).sum(-1, keepdims=True)), rate.shape)
    (out,), (up,) = outward_and_up_directions([step])
    nominal = np.stack([-out, np.cross(up, -out), up], axis=-1)  # from table to body
    pose = np.stack([drawn[f"pose_{axis}[{name}]"] for axis in "xyz"], axis=-1)
    body = exp_so3(pose) @ nominal
    f = np.stack([inwards, forwards, upwards], axis=-1) @ np.swapaxes(body, -1, -2)
    return Motion(f, rate[..., None] * body[:, None, :, 2])


def rotate_horizontal(vector: Array, azimuth: Array) -> Array:
    """Transform a room vector, (..., 2), to the frame of a table turned by an azimuth."""
    c, s = np.cos(azimuth), np.sin(azimuth)
    x, y = vector[..., 0], vector[..., 1]
    return np.stack([x * c + y * s, y * c - x * s], axis=-1)
