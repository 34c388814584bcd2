"""A plan by hand in simulation: the true motion, sample by sample, with the bench's errors drawn.

Between steps the sensor moves smoothly (minimum jerk) from one attitude to the next. The samples
of a hold or a turn have its label, those of a move none.
"""

from collections.abc import Sequence

import numpy as np

from inercal.basics.arrays import Array
from inercal.benches.contract import SimulatedMotion, concatenate_motions
from inercal.benches.hand.bench import (
    Hand,
    hold_tilt,
    sensed_motion,
    tangent_vectors,
    tilted_direction,
)
from inercal.physics.motion import Motion
from inercal.physics.plan import HandStep, Hold, Turn

MOVE_SECONDS = 2.0
PAUSE_SECONDS = 1.5  # at rest before and after a turn, unlabelled
_SETTLE = 0.25  # s at rest at either end of a turn's section


def simulate_hand_motion(
    bench: Hand,
    steps: Sequence[HandStep],
    rate_hz: float,
    rng: np.random.Generator,
    trials: int = 1,
    *,
    carried: bool = False,
) -> SimulatedMotion:
    """Return the motion of each trial; trials share times and labels.

    Parameters
    ----------
    bench : Hand
        Its parameters are drawn from normal distributions of their stated deviations.
    steps : sequence of HandStep
    rate_hz : float
        Samples per second by the recording's clock.
    rng : Generator
    trials : int
        Length of the leading axis of what is drawn and of the motion.
    carried : bool
        Whether the sensor stays in the hand between holds: its azimuth, and with it the earth's
        level rate, then follows its motion; otherwise each position has an independent azimuth.
    """
    drawn = bench.qualified.draw(bench.acting_parameters(steps, rates=True), rng, trials)
    if carried:
        drawn |= _earth_rates_at_holds([step for step in steps if isinstance(step, Hold)], drawn)
    parts: list[tuple[Array, Array, str]] = []
    up = None
    for step in steps:
        q = drawn | _up_and_force(step, drawn)
        if up is not None:
            parts.append((*_transfer_motion(up, q["up"], drawn["g"], rate_hz), ""))
        up = q["up"]
        n = max(round(step.seconds * rate_hz), 1)
        mean, steady = sensed_motion(step, n / rate_hz, q), _constant_rate(step, q)
        profile = _turn_profile(n, rate_hz) if isinstance(step, Turn) else np.ones(n)
        f = np.repeat(mean.f[:, None], n, axis=1)
        w = steady[:, None] + (mean.w - steady)[:, None] * profile[:, None]
        pause = round(PAUSE_SECONDS * rate_hz) if isinstance(step, Turn) else 0
        still = (f[:, :1].repeat(pause, axis=1), steady[:, None].repeat(pause, axis=1), "")
        parts += [still, (f, w, step.label), still]
    labels = np.concatenate([np.full(f.shape[1], label) for f, _, label in parts])
    motion = concatenate_motions([Motion(f, w) for f, w, _ in parts])
    return SimulatedMotion(np.arange(labels.size) / rate_hz, motion, labels, drawn)


def _earth_rates_at_holds(holds: Sequence[Hold], drawn: dict[str, Array]) -> dict[str, Array]:
    """Return the earth's level rate at each hold, turned as the moves turn the body."""
    found: dict[str, Array] = {}
    level, before = np.zeros(0), np.zeros(0)
    for hold in holds:
        d, names = tangent_vectors(hold.up), [f"earth{k}[{hold.label}]" for k in (1, 2)]
        up = _up_and_force(hold, drawn)["up"]
        if not found:
            level = np.stack([drawn[name] for name in names], axis=-1) @ d
        else:
            axis, angle = _shortest_rotation(before, up)
            level = _rotate_vectors(axis, angle[:, None], level)[:, 0]
        found |= {name: level @ row for name, row in zip(names, d, strict=True)}
        before = up
    return found


def _up_and_force(step: HandStep, drawn: dict[str, Array]) -> dict[str, Array]:
    """Return the body's up during a step and, for a turn, its specific force: up along the axis."""
    if isinstance(step, Hold):
        direction, tangent = step.up, hold_tilt(drawn, step.label)
    else:
        direction = step.axis
        tangent = np.stack([drawn[f"axis{k}[{step.label}]"] for k in (1, 2)], axis=-1)
    up = tilted_direction(direction, tangent)[0]
    extra = {"up": up}
    if isinstance(step, Turn):
        force = drawn["g"][:, None] * up
        extra |= {f"force_{a}[{step.label}]": force[:, k] for k, a in enumerate("xyz")}
    return extra


def _constant_rate(step: HandStep, q: dict[str, Array]) -> Array:
    """Return the part of the rate, (trials, 3), that does not follow the turn's profile."""
    if isinstance(step, Hold):
        return sensed_motion(step, 1.0, q).w
    own = [q.get(f"turn_on_{a}[{step.label}]", np.zeros(1)) for a in "xyz"]
    return q["earth_up"][:, None] * q["up"] + np.stack(own, axis=-1)


def _shortest_rotation(start: Array, end: Array) -> tuple[Array, Array]:
    """Return axis, (trials, 3), and angle, (trials,), of the shortest rotation of up to up."""
    axis = np.cross(start, end)
    size = np.linalg.norm(axis, axis=-1, keepdims=True)
    aside = np.cross(start, np.eye(3)[np.argmin(np.abs(start[0]))])
    axis = np.where(size > 1e-12, axis, aside)  # from face to opposite face: any level axis
    axis = axis / np.linalg.norm(axis, axis=-1, keepdims=True)
    return axis, np.arctan2((np.cross(start, end) * axis).sum(-1), (start * end).sum(-1))


def _rotate_vectors(axis: Array, angles: Array, vector: Array) -> Array:
    """Return vectors, (trials, n, 3), turned by angles, (trials, n), about axes (Rodrigues)."""
    cos, sin = np.cos(angles)[..., None], np.sin(angles)[..., None]
    along = axis * (axis * vector).sum(-1, keepdims=True)
    return along[:, None] + (vector - along)[:, None] * cos + np.cross(axis, vector)[:, None] * sin


def _minimum_jerk(s: Array) -> Array:
    """Return the rate of a rest-to-rest move of unit length and duration at 0 ≤ s ≤ 1."""
    return 30 * s**2 * (1 - s) ** 2


def _turn_profile(n: int, rate_hz: float) -> Array:
    """Return the rate of a turn over its mean, (n,): rest, minimum jerk, rest."""
    at_rest = min(round(_SETTLE * rate_hz), n // 4)
    moving = n - 2 * at_rest
    profile = np.zeros(n)
    profile[at_rest : at_rest + moving] = _minimum_jerk((np.arange(moving) + 0.5) / moving)
    return profile / profile.mean()


def _transfer_motion(start: Array, end: Array, g: Array, rate_hz: float) -> tuple[Array, Array]:
    """Return f and ω, (trials, n, 3), while the body's up goes from `start` to `end`, (trials, 3).

    Up turns by +θ about a in the body when the body turns by −θ about a.
    """
    n = round(MOVE_SECONDS * rate_hz)
    axis, angle = _shortest_rotation(start, end)
    s = (np.arange(n) + 0.5) / n
    travelled = angle[:, None] * (10 * s**3 - 15 * s**4 + 6 * s**5)
    ups = _rotate_vectors(axis, travelled, start)
    rate = -angle[:, None] * _minimum_jerk(s) * rate_hz / n
    return g[:, None, None] * ups, rate[..., None] * axis[:, None]
